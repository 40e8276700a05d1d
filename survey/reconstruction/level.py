"""Level of a map: the error of height that all of the map shares, and what one known height leaves of it.

A rover sees shapes. Unless a receiver, a stake or a benchmark states its height, the level of the map is that of the prior,
which is mostly the largest part of the map's absolute error. `Tie` is one known height. Plans and maps state the same ties.
"""

from typing import NamedTuple

import numpy as np


class Tie(NamedTuple):
    """A known height that holds the level of a map.

    `name`: what it is, in words. `sigma_m`: standard deviation of its height [m]. `is_read_off_map`: whether it is compared
    with the map beside it, whose own error enters; the rover measures others in passing.
    """

    name: str
    sigma_m: float
    is_read_off_map: bool = False

    def left_m(self, level_m: float, rmse_m: float) -> float:
        """Return the standard deviation of the level that the tie leaves [m].

        `level_m`: that without it [m]. `rmse_m`: error of the map beside its level [m].

        >>> round(TIES["checkpoint"].left_m(1.0, 0.4), 2), round(TIES["stake"].left_m(1.0, 0.4), 2)
        (0.37, 0.03)
        """
        own_m = np.hypot(self.sigma_m, rmse_m if self.is_read_off_map else 0.0)
        return float(level_m * own_m / np.hypot(level_m, own_m))


TIES: dict[str, Tie] = {
    "checkpoint": Tie("one checkpoint", 0.03, is_read_off_map=True),
    "stake": Tie("one stake or RTK", 0.03),
    "benchmark": Tie("a known benchmark", 0.01),
}
"""Known heights by name: a point beside the route and a stake are surveyed to 3 cm, as is a path with RTK."""

r"""Age of a map of moving ice: how its error grows when the map of an epoch is used at other times.

Left as it is, the map errs after a time τ by what the surface has changed at each place,

.. math::  e(x, \tau) = e(x, 0) - \tau (g \cdot v + a)

with g the slope of the map, v the velocity and a the lowering, whose errors count too.
"""

from typing import Any, NamedTuple, Self

import numpy as np

from survey.data.dem import Dem
from survey.data.ice.motion import DAY_S, IceMotion

AGE = "map_age"
"""Name of the age among the diagnostics of a map."""


class MapAge(NamedTuple):
    """RMSE of a map at its epoch, and the growth of its error.

    Parameters
    ----------
    epoch_s : float
        Epoch in seconds of the recording.
    speed_m_per_day, speed_sigma_m_per_day : float
        Velocity in the middle of the map and its standard deviation along the flow [m/day].
    lowering_m_per_day, lowering_sigma_m_per_day : float
        Lowering there and its standard deviation [m/day].
    rmse_m : float
        Claimed RMSE at the epoch [m].
    growth_m_per_day : float
        Root mean square change of the surface at fixed places, with its error [m/day].
    """

    epoch_s: float
    speed_m_per_day: float
    speed_sigma_m_per_day: float
    lowering_m_per_day: float
    lowering_sigma_m_per_day: float
    rmse_m: float
    growth_m_per_day: float

    @classmethod
    def of(cls, mean: Dem, std: Dem, motion: IceMotion) -> Self:
        """Return the age of a map.

        Parameters
        ----------
        mean, std : Dem
            Map of the epoch and its standard deviation [m].
        motion : IceMotion
            Motion after the map.

        Returns
        -------
        MapAge
            Over the nodes with a height.
        """
        east, north = mean.gradient()
        known = np.isfinite(east) & np.isfinite(north) & np.isfinite(std.elevation)
        xy = mean.grid().xy[known.ravel()]
        by_rates = np.column_stack([-east[known], -north[known], np.ones(len(xy))])
        change = np.sum(by_rates * motion.rates(xy), axis=1)
        day = motion.derivatives(xy, np.full(len(xy), motion.epoch_s + DAY_S))
        by = np.einsum("na,nar->nr", by_rates, day)
        variance = np.einsum("nr,rs,ns->n", by, motion.spread, by)
        middle = xy.mean(axis=0, keepdims=True)
        (*velocity, rise), sigma = motion.rates(middle)[0], motion.rates_sigma(middle)[0]
        return cls(
            motion.epoch_s,
            float(np.hypot(*velocity)),
            float(sigma[:2].max()),
            float(-rise),
            float(sigma[2]),
            float(np.sqrt(np.mean(std.elevation[known] ** 2))),
            float(np.sqrt(np.mean(change**2 + variance))),
        )

    def hours_within(self, limit_m: float) -> float:
        """Return for how long before and after the epoch the RMSE stays below a limit [h].

        Parameters
        ----------
        limit_m : float
            Largest RMSE [m].

        Returns
        -------
        float
            0 where the map exceeds it at its epoch, infinite where the surface does not change.

        Examples
        --------
        >>> round(MapAge(0.0, 2.0, 0.1, 0.05, 0.02, 0.3, 0.4).hours_within(0.5), 6)
        24.0
        """
        left = limit_m**2 - self.rmse_m**2
        if left <= 0.0:
            return 0.0
        return (
            float(24.0 * np.sqrt(left) / self.growth_m_per_day)
            if self.growth_m_per_day > 0.0
            else float("inf")
        )

    def facts(self) -> dict[str, Any]:
        """Return the numbers by name, for the record.

        Returns
        -------
        dict
            Input of `from_facts`.
        """
        return self._asdict()

    @classmethod
    def from_facts(cls, facts: dict[str, Any]) -> Self:
        """Return the age of recorded numbers.

        Parameters
        ----------
        facts : dict
            As `facts` returns them.

        Returns
        -------
        MapAge
            Equal to the one recorded.
        """
        return cls(**facts)

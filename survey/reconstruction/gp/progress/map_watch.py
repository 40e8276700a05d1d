"""Progress of a map, and its expected time."""

import logging
import math
import time
from typing import NamedTuple

import numpy as np

from survey.core.arrays import Progress
from survey.data.grid import Grid
from survey.reconstruction.gp.learned import MOST_AT_ONCE, Learned

logger = logging.getLogger(__name__)
# The time of smaller maps is not stated, unless they are mapped in tiles.
_N_LARGE = 2_000_000
_N_TIMED = 100_000
# Support codes and calibration, beside the distances to the nearest points.
_BESIDE_DISTANCES = 1.2
# Cross-validation where it is not counted, and writing.
_BESIDE_MAPPING = 1.15


class MapWatch(NamedTuple):
    """Nodes that a map will have, and a progress callback.

    Parameters
    ----------
    grid : Grid
        Nodes of the map.
    progress : callable, optional
        Progress callback.
    """

    grid: Grid
    progress: Progress | None = None

    def announce(self, learned: Learned, learning_s: float) -> None:
        """Log the expected time of a large map, or of one in tiles.

        Parameters
        ----------
        learned : Learned
            State of the model that is to be mapped.
        learning_s : float
            Time of learning it, what is still to be learned included [s].
        """
        rows, columns = self.grid.shape
        process = learned.process
        if rows * columns < _N_LARGE and not process.divides_site:
            return
        mapping_s = process.expected_s(self.grid.x, self.grid.y) + _finishing_s(learned, self.grid)
        text = _time_text(learning_s + _BESIDE_MAPPING * mapping_s)
        if process.divides_site:
            logger.warning(
                "the site is too large for one solve and is mapped in %d tiles, which takes about %s",
                process.record()["n_tiles"],
                text,
            )
        else:
            logger.warning("a map of %d nodes takes about %s", rows * columns, text)


def _finishing_s(learned: Learned, grid: Grid) -> float:
    """Return the expected time of the distances and support codes of all nodes [s]."""
    rows, columns = grid.shape
    n_rows = min(max(_N_TIMED // columns, 1), rows)
    middle = (rows - n_rows) // 2
    nodes = np.stack(np.meshgrid(grid.x, grid.y[middle : middle + n_rows]), axis=-1).reshape(-1, 2)
    began = time.perf_counter()
    learned.nearest_m(nodes[:1])
    prepared = time.perf_counter()
    learned.nearest_m(nodes)
    preparing_s = prepared - began
    over_nodes_s = max(time.perf_counter() - prepared - preparing_s, 0.0) * rows / n_rows
    return _BESIDE_DISTANCES * over_nodes_s + preparing_s * math.ceil(rows * columns / MOST_AT_ONCE)


def _time_text(seconds: float) -> str:
    return f"{seconds / 60.0:.0f} min" if seconds > 90.0 else f"{seconds:.0f} s"

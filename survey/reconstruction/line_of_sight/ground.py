r"""Which returns of a scan are ground, where trees, walls and cables hang over it.

A return is ground if no other lies so far below it that the ground would have to rise more steeply
than m between the two (Vosselman 2000, *Slope based filtering of laser altimetry data*):

.. math::  z_i \le \min_j (z_j + m \, d_{ij}) + c

A map of heights has one height over every place; returns from what overhangs it would be mapped as hills.
"""

import numpy as np
from numba import njit

from survey.core.arrays import BoolArray, FloatArray
from survey.core.errors import CapacityError

_STEEPEST, _LEAST_M = 1.2, 0.3
_CELL_M = 0.25
_MOST_CELLS = 50_000_000
# Two sweeps there and back carry a height around every corner that ground has.
_N_SWEEPS = 2


def ground(xyz: FloatArray) -> BoolArray:
    """Return which points (N, 3) [m] are ground (N,), by their heights over the lowest ones around.

    A point is ground up to 0.3 m above cones that rise by 1.2 (50°) from the lowest point in every cell
    of 0.25 m. Distances run along the cells in eight directions, which makes them up to 8 % too long.

    Raises
    ------
    CapacityError
        Points over more than 50 million cells.

    Notes
    -----
    Lines of sight are not used, so that they can be tested against the result. The edges of steps, boulders
    and ice walls go too where they rise by more than 0.3 m at once: what is left is what a map of heights
    can hold. A roof so wide that its middle is far from all ground stays, and a cluster of returns from
    under the ground takes the ground about it away.

    Examples
    --------
    A branch 3 m above a slope of 0.5:

    >>> slope = np.column_stack([np.arange(9.0), np.zeros(9), 0.5 * np.arange(9.0)])
    >>> slope[4, 2] += 3.0
    >>> ground(slope)
    array([ True,  True,  True,  True, False,  True,  True,  True,  True])
    """
    cell = np.floor(xyz[:, :2] / _CELL_M).astype(np.int64)
    cell -= cell.min(axis=0)
    n_east, n_north = (int(n) for n in cell.max(axis=0) + 1)
    if n_east * n_north > _MOST_CELLS:
        raise CapacityError(
            f"ground is classified on cells of {_CELL_M:g} m, and the points spread over {n_east} × {n_north} of them; "
            "cut off the points that are far from the others."
        )
    lowest = np.full((n_east, n_north), np.inf)
    np.minimum.at(lowest, tuple(cell.T), xyz[:, 2])
    _rise(lowest, _STEEPEST * _CELL_M)
    found: BoolArray = xyz[:, 2] <= lowest[tuple(cell.T)] + _LEAST_M
    return found


@njit(cache=True)
def _rise(height: FloatArray, rise_m: float) -> None:
    """Lower every cell to the cones over all others, which rise so much from cell to cell."""
    rows, columns = height.shape
    for _ in range(_N_SWEEPS):
        for j in range(rows):
            for i in range(columns):
                _lower(height, j, i, -1, rise_m)
        for j in range(rows - 1, -1, -1):
            for i in range(columns - 1, -1, -1):
                _lower(height, j, i, 1, rise_m)


@njit(cache=True, inline="always")
def _lower(height: FloatArray, j: int, i: int, way: int, rise_m: float) -> None:
    """Lower a cell to the cones over the four neighbours that a sweep has passed."""
    rows, columns = height.shape
    low, askew_m = height[j, i], np.sqrt(2.0) * rise_m
    if 0 <= i + way < columns:
        low = min(low, height[j, i + way] + rise_m)
    if 0 <= j + way < rows:
        low = min(low, height[j + way, i] + rise_m)
        if i > 0:
            low = min(low, height[j + way, i - 1] + askew_m)
        if i < columns - 1:
            low = min(low, height[j + way, i + 1] + askew_m)
    height[j, i] = low

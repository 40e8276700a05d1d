"""Cells of a boustrophedon decomposition: swaths joined without crossing a border."""

import numpy as np

from planners.driving.swath_ends import ends_of
from planners.swaths.swaths import axes_of
from survey.core.arrays import FloatArray, IntArray


def cells(swaths: list[FloatArray], heading_deg: float) -> IntArray:
    """Group straight swaths into the cells of a boustrophedon decomposition (Choset 2000).

    Swaths on neighbouring lines belong to one cell when each is the other's only
    neighbour; a line that splits, merges, begins or ends starts a new cell.

    Parameters
    ----------
    swaths : list of (2, 2) ndarray
        As `swaths_on` returns them [m].
    heading_deg : float
        Their heading, counter-clockwise from east [deg].

    Returns
    -------
    (N,) ndarray of int
        The cell of each swath, counted from 0 in the order of the lines.
    """
    along, left = axes_of(heading_deg)
    ends = ends_of(swaths).reshape(-1, 2, 2)
    u = np.sort(ends @ along, axis=1)
    line = np.unique(np.round(-(ends[:, 0] @ left), 3), return_inverse=True)[1]
    cell = np.full(len(swaths), -1, dtype=np.int64)
    n_cells = 0
    for i in range(len(swaths)):
        before = _beside(u, i, np.flatnonzero(line == line[i] - 1))
        if len(before) == 1 and len(_beside(u, before[0], np.flatnonzero(line == line[i]))) == 1:
            cell[i] = cell[before[0]]
        else:
            cell[i], n_cells = n_cells, n_cells + 1
    return cell


def _beside(u: FloatArray, i: int, others: IntArray) -> IntArray:
    """Return those of `others` whose stretch along the heading overlaps that of swath `i`."""
    beside: IntArray = others[(u[others, 0] < u[i, 1]) & (u[others, 1] > u[i, 0])]
    return beside

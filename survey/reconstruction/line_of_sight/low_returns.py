"""Rejection of isolated returns below the ground.

Multiple reflections and faulty ranges leave single returns metres below the ground. A filter that keeps the lowest
returns, or a line of sight to such a return, would cut a hole as wide as it is deep, so they are left out first.
"""

import numpy as np
from scipy.spatial import cKDTree

from survey.core import BoolArray, FloatArray, IntArray
from survey.data import SurfacePoints

# Neighbours in plan that state where the ground is.
_N_NEIGHBOURS = 24
# Candidates lie below the median of the cells around their own by more than this [m].
_CELL_M, _LEAST_M = 4.0, 0.5
_SIGMAS, _QUARTILES_TO_SIGMA = 4.0, 1.349
# Returns at one depth beside each other that are a pit or a crevasse: the point itself and three more.
_N_COMPANIONS, _COMPANION_M = 3, 1.0
_MOST_CANDIDATES_AT_ONCE = 50_000


def without_low_returns(points: SurfacePoints) -> tuple[SurfacePoints, int]:
    """Return the points without isolated low ones, and the number of those.

    >>> level = np.column_stack([np.random.default_rng(0).uniform(0.0, 9.0, (300, 2)), np.zeros(300)])
    >>> level[7, 2] = -10.0
    >>> without_low_returns(SurfacePoints(level, sigma_m=0.02, crs="EPSG:32608"))[1]
    1
    """
    low = isolated_low(points.xyz)
    n_low = int(low.sum())
    return (points.select(~low), n_low) if n_low else (points, 0)


def isolated_low(xyz: FloatArray) -> BoolArray:
    """Return which points (N, 3) [m] lie alone below the ground, as (N,).

    A point is low if it lies below the median of its 24 nearest neighbours in plan by more than 0.5 m and by more
    than four of their standard deviations, taken from their quartiles. It is isolated if fewer than three of them
    lie within 1 m of its height, so that pits and crevasses with several returns stay.

    `xyz` (N, 3): easting, northing and height [m]. Returns (N,) bool: True for isolated low points; all False
    for fewer than 25 points.

    A pit that gave fewer than four returns cannot be distinguished from faulty ranges and is left out.

    >>> xyz = np.column_stack([np.random.default_rng(0).uniform(0.0, 9.0, (300, 2)), np.zeros(300)])
    >>> xyz[[7, 8], 2] = -10.0
    >>> np.flatnonzero(isolated_low(xyz))
    array([7, 8])
    """
    low = np.zeros(len(xyz), dtype=bool)
    if len(xyz) <= _N_NEIGHBOURS:
        return low
    candidates = _candidates(xyz)
    if not len(candidates):
        return low
    tree = cKDTree(xyz[:, :2])
    for first in range(0, len(candidates), _MOST_CANDIDATES_AT_ONCE):
        some = candidates[first : first + _MOST_CANDIDATES_AT_ONCE]
        low[some] = _alone_below(xyz, some, tree)
    return low


def _candidates(xyz: FloatArray) -> IntArray:
    """Return the numbers of the points that may be low: below the median of a cell around, or with few around."""
    cell = np.floor((xyz[:, :2] - xyz[:, :2].min(axis=0)) / _CELL_M).astype(np.int64)
    n_north = int(cell[:, 1].max()) + 3
    key = (cell[:, 0] + 1) * n_north + cell[:, 1] + 1
    order = np.lexsort((xyz[:, 2], key))
    cells, start, count = np.unique(key[order], return_index=True, return_counts=True)
    median = xyz[order[start + count // 2], 2]
    highest, n_around = median.copy(), count.copy()
    for shift in (-n_north - 1, -n_north, -n_north + 1, -1, 1, n_north - 1, n_north, n_north + 1):
        at = np.minimum(np.searchsorted(cells, cells + shift), len(cells) - 1)
        is_there = cells[at] == cells + shift
        highest = np.where(is_there, np.maximum(highest, median[at]), highest)
        n_around = n_around + np.where(is_there, count[at], 0)
    own = np.searchsorted(cells, key)
    return np.flatnonzero((xyz[:, 2] < highest[own] - _LEAST_M) | (n_around[own] <= _N_NEIGHBOURS))


def _alone_below(xyz: FloatArray, some: IntArray, tree: cKDTree) -> BoolArray:
    """Judge some points by their nearest neighbours in plan."""
    index = np.asarray(tree.query(xyz[some, :2], k=_N_NEIGHBOURS + 1)[1])
    near, own = xyz[index, 2], xyz[some, 2]
    lower, middle, upper = np.quantile(near, (0.25, 0.5, 0.75), axis=1)
    allowed = np.maximum(_LEAST_M, _SIGMAS * (upper - lower) / _QUARTILES_TO_SIGMA)
    companions = (np.abs(near - own[:, None]) <= _COMPANION_M).sum(axis=1) - 1
    alone: BoolArray = (own < middle - allowed) & (companions < _N_COMPANIONS)
    return alone

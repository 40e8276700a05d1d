"""Detection of returns far from all their neighbours (ghosts) in one scan."""

import numpy as np
from numba import njit

from survey.core.arrays import BoolArray, FloatArray, IntArray

# A neighbourhood is 3 × 3 cells; where it holds too few points, one of cells four times as wide is asked.
_CELL_M, _WIDER = 1.0, 4.0
_N_LEAST = 6
_N_ASKED = 32
_N_COMPANIONS = 3
LEAST_M = 0.3
_SIGMAS = 4.0
_QUARTILES_TO_SIGMA = 1.349


def ghosts(xyz: FloatArray) -> BoolArray:
    """Return which points of a scan (N, 3) [m] are ghosts (N,).

    A ghost lies farther from the median height of its neighbours, within 1 to 2 m, than
    0.3 m and four of their standard deviations, taken from their quartiles, and fewer than
    three of them lie within 0.3 m of its height: the top of a pile is not alone. Where fewer than six points are
    near, those within 4 to 8 m are asked; without six there, a point is accepted.

    Examples
    --------
    >>> xy = np.random.default_rng(0).uniform(0.0, 5.0, (200, 2))
    >>> xyz = np.column_stack([xy, 0.1 * xy[:, 0]])
    >>> xyz[17, 2] -= 10.0
    >>> np.flatnonzero(ghosts(xyz))
    array([17])
    """
    x, y, z = (np.ascontiguousarray(axis) for axis in xyz.T)
    near, n_near = _beside_neighbours(x, y, z, _CELL_M)
    alone = n_near < _N_LEAST
    if alone.any():
        far, n_far = _beside_neighbours(x, y, z, _CELL_M * _WIDER)
        near = np.where(alone, (n_far >= _N_LEAST) & far, near)
    return near


def _beside_neighbours(
    x: FloatArray, y: FloatArray, z: FloatArray, cell_m: float
) -> tuple[BoolArray, IntArray]:
    """Return which points lie far from their neighbourhood's median, and how many points it holds."""
    key, n_east = _cells(x, y, cell_m)
    order = _sorted(key) if key.max() < 4 * len(key) + 1000 else np.argsort(key, kind="stable")
    return _judged(z, key, order, n_east)


@njit(cache=True)
def _cells(x: FloatArray, y: FloatArray, cell_m: float) -> tuple[IntArray, int]:
    """Return the number of every point's cell, and the cells in a row; a rim of empty ones spares the search its edges."""
    west, south = np.floor(x.min() / cell_m), np.floor(y.min() / cell_m)
    n_east = int(np.floor(x.max() / cell_m) - west) + 3
    key = np.empty(len(x), dtype=np.int64)
    for k in range(len(x)):
        i, j = int(np.floor(x[k] / cell_m) - west), int(np.floor(y[k] / cell_m) - south)
        key[k] = (j + 1) * n_east + i + 1
    return key, n_east


@njit(cache=True)
def _sorted(key: IntArray) -> IntArray:
    """Return the order of the points by their cell, equal ones as they came, by counting."""
    first = np.zeros(key.max() + 2, dtype=np.int64)
    for cell in key:
        first[cell + 1] += 1
    first = np.cumsum(first)
    order = np.empty(len(key), dtype=np.int64)
    for k in range(len(key)):
        order[first[key[k]]] = k
        first[key[k]] += 1
    return order


@njit(cache=True)
def _judged(z: FloatArray, key: IntArray, order: IntArray, n_east: int) -> tuple[BoolArray, IntArray]:
    """Judge every point by the median of the 3 × 3 cells around its own."""
    n = len(z)
    far = np.zeros(n, dtype=np.bool_)
    n_near = np.zeros(n, dtype=np.int64)
    keys = key[order]
    k = 0
    while k < n:
        own, first = keys[k], k
        while k < n and keys[k] == own:
            k += 1
        total = 0
        spans = np.empty((3, 2), dtype=np.int64)
        for row in range(3):
            start = own + (row - 1) * n_east - 1
            spans[row, 0] = np.searchsorted(keys, start)
            spans[row, 1] = np.searchsorted(keys, start + 3)
            total += spans[row, 1] - spans[row, 0]
        stride = (total + _N_ASKED - 1) // _N_ASKED
        heights = np.empty(total // stride + 1)
        m, count = 0, 0
        for row in range(3):
            for a in range(spans[row, 0], spans[row, 1]):
                if count % stride == 0:
                    heights[m] = z[order[a]]
                    m += 1
                count += 1
        asked = np.sort(heights[:m])
        middle = asked[m // 2]
        allowed = max(LEAST_M, _SIGMAS * (asked[3 * m // 4] - asked[m // 4]) / _QUARTILES_TO_SIGMA)
        for a in range(first, k):
            height = z[order[a]]
            n_near[order[a]] = total
            if abs(height - middle) > allowed:
                companions = -1
                for row in range(3):
                    for b in range(spans[row, 0], spans[row, 1]):
                        companions += abs(z[order[b]] - height) <= LEAST_M
                far[order[a]] = companions < _N_COMPANIONS
    return far, n_near

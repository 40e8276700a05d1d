"""Random signs that depend on the place alone, so that neighbouring tiles draw the same errors where they overlap."""

import numpy as np
from numba import njit

from survey.core.arrays import FloatArray, IntArray

N_LAYERS = 6


@njit(cache=True, inline="always")
def _mixed(key: np.uint64) -> np.uint64:
    """Return 64 well-mixed bits (the finaliser of SplitMix64)."""
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return key ^ (key >> np.uint64(31))


@njit(cache=True, inline="always")
def _place(column: int, row: int, salt: int) -> np.uint64:
    key = _mixed(np.uint64(column) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(salt))
    return _mixed(key ^ (np.uint64(row) * np.uint64(0xD1B54A32D192ED03)))


@njit(cache=True)
def place_signs(west: int, south: int, draw: int, out: FloatArray) -> None:
    """Set `out` (6, rows, columns) to signs of the nodes of a window: one hash for the six signs of a node."""
    for j in range(out.shape[1]):
        for i in range(out.shape[2]):
            bits = _place(west + i, south + j, draw)
            for layer in range(N_LAYERS):
                out[layer, j, i] = 1.0 if (bits >> np.uint64(layer)) & np.uint64(1) else -1.0


@njit(cache=True)
def add_point_errors(
    points: FloatArray, cells: IntArray, strip: IntArray, draw: int, out: FloatArray
) -> None:
    """Add errors of the points to `out` (rows, columns) whose covariance is the data's stencil.

    The columns of `points` (N, 4) are lattice coordinates, height and weight [1/m²]; `cells` (N, 2) are column and row counted
    from the origin of the CRS, so that a point has the same sign in every window.
    """
    rows, columns = out.shape
    for k in range(len(points)):
        u, v, _, w = points[k]
        i, j = int(np.floor(u)), int(np.floor(v))
        i -= i == columns - 1 and u == i
        j -= j == rows - 1 and v == j
        if i < 0 or j < 0 or i >= columns - 1 or j >= rows - 1:
            continue
        bits = _mixed(_place(cells[k, 0], cells[k, 1], 1000 + draw) ^ np.uint64(strip[k]))
        e = np.sqrt(w) if bits & np.uint64(1) else -np.sqrt(w)
        s, t = u - i, v - j
        out[j, i] += e * (1 - s) * (1 - t)
        out[j, i + 1] += e * s * (1 - t)
        out[j + 1, i] += e * (1 - s) * t
        out[j + 1, i + 1] += e * s * t


@njit(cache=True)
def chosen(column: IntArray, row: IntArray, side: int, share: float) -> IntArray:
    """Return 1 (N,) for the cells of randomly chosen squares of `side` cells that make up a share of all, else 0."""
    out = np.zeros(len(column), np.int64)
    limit = np.uint64(share * 2.0**53)
    for k in range(len(column)):
        bits = _place(column[k] // side, row[k] // side, 77)
        out[k] = 1 if (bits >> np.uint64(11)) < limit else 0
    return out

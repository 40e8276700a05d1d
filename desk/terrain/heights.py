"""Heights at places, interpolated between the cells of the terrain."""

import numpy as np

from desk.terrain.levels import level_for
from desk.terrain.pyramid import ElevationPyramid
from survey.core.arrays import FloatArray

_MOST_CELLS = 4_000_000


def heights_at(pyramid: ElevationPyramid, places: FloatArray) -> FloatArray:
    """Interpolate bilinearly on the finest level on which all places fit into memory.

    `places` (N, 2): easting and northing [m]. Returns (N,): height [m]; NaN off the terrain and beside
    unknown cells.
    """
    t, (n_rows, n_columns) = pyramid.transform, pyramid.shape
    column, row = (places[:, 0] - t.c) / t.a, (places[:, 1] - t.f) / t.e
    inside = (
        np.isfinite(places).all(axis=1) & (column >= 0) & (column <= n_columns) & (row >= 0) & (row <= n_rows)
    )
    heights = np.full(len(places), np.nan)
    if not inside.any():
        return heights
    column, row = column[inside], row[inside]
    level = level_for(float(np.ptp(column)), float(np.ptp(row)), _MOST_CELLS)
    u, v = column / 2**level - 0.5, row / 2**level - 0.5
    first_u, first_v = int(np.floor(u.min())), int(np.floor(v.min()))
    size = (int(v.max()) - first_v + 3, int(u.max()) - first_u + 3)
    heights[inside] = _between(pyramid.window(level, first_v, first_u, *size), u - first_u, v - first_v)
    return heights


def _between(cells: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """Interpolate between the centres of cells; beside an unknown cell the nearest one counts."""
    i, j = np.floor(v).astype(np.int64), np.floor(u).astype(np.int64)
    s, t = u - j, v - i
    upper = cells[i, j] * (1 - s) + cells[i, j + 1] * s
    lower = cells[i + 1, j] * (1 - s) + cells[i + 1, j + 1] * s
    nearest = cells[i + (t >= 0.5), j + (s >= 0.5)]
    blended = upper * (1 - t) + lower * t
    return np.where(np.isfinite(blended), blended, nearest)

"""Levels of a raster: means of squares of cells, and the level that is fine enough."""

import numpy as np

from survey.core.arrays import FloatArray


def level_for(width: float, height: float, most_cells: int) -> int:
    """Return the finest level on which a window of so many cells of the raster has few enough cells.

    Returns: 0 for the cells of the raster themselves.

    >>> level_for(100.0, 100.0, 20_000), level_for(1000.0, 1000.0, 20_000)
    (0, 3)
    """
    level = 0
    while (width / 2**level + 3) * (height / 2**level + 3) > most_cells:
        level += 1
    return level


def block_means(values: FloatArray, n: int) -> FloatArray:
    """Average squares of n × n cells over the cells that are known; NaN where none is.

    `values` (H, W): NaN where nothing is known. Returns (ceil(H / n), ceil(W / n)): means.

    >>> block_means(np.array([[1.0, 3.0, 5.0], [np.nan, 2.0, 7.0]]), 2)
    array([[2., 6.]])
    """
    if n == 1:
        return values
    height, width = values.shape
    if height % n or width % n:
        values = np.pad(values, ((0, -height % n), (0, -width % n)), constant_values=np.nan)
    blocks = values.reshape(values.shape[0] // n, n, values.shape[1] // n, n)
    known = np.isfinite(blocks)
    if known.all():
        means: FloatArray = blocks.mean(axis=(1, 3))
        return means
    counts = known.sum(axis=(1, 3))
    sums = np.where(known, blocks, 0.0).sum(axis=(1, 3))
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)

"""Differences between strips in the cells that two of them have seen, summed up over blocks of cells."""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from survey.core.arrays import FloatArray, IntArray
from survey.reconstruction.tiled.cells.rasters import mean_heights, slopes
from survey.reconstruction.tiled.layout import CellWindow

SUMS = ("n", "e", "v", "ee", "ev", "vv", "d", "de", "dv", "dd")
"""Sums over the cells of a block: number, slope eastwards and northwards [m/m], their products, the difference [m],
its products with the slopes, its square."""
OVERLAP = np.dtype(
    [
        *(("first", "<u4"), ("second", "<u4"), ("x", "<f8"), ("y", "<f8")),
        *(
            ("block_row", "<i8"),
            ("block_column", "<i8"),
            ("scatter", "<f8"),
            ("sampling", "<f8"),
            ("raw", "<f8"),
            ("placed", "<f8"),
        ),
        *((name, "<f8") for name in SUMS),
    ]
)
"""A block of cells that two strips have seen, as far as it lies in a tile: keys of the strips, mean place [m], number of the
block, robust variance of the cells'
differences first minus second [m²], the part of it that their points' scatter explains [m²], sums over the cells of the
difference of mean heights [m] and of the part of it that other places of the points in the cell make [m], and `SUMS`."""
BLOCK_CELLS = 32
_LEAST_CELLS = 8
_OUTLIER_SIGMAS = 4.0
_MAD_TO_SIGMA = 1.4826
# A difference beyond this is no strip error but a tree, a snow bank or ice that moved.
_LARGEST_M = 20.0
_SLOPE_PART = 1.0 / 12.0


def detrended_variance(cells: npt.NDArray[np.void], window: CellWindow) -> FloatArray:
    """Return the variance of heights in each cell (N,) [m²] without the part that the slope makes."""
    sloped = _SLOPE_PART * np.sum(slopes_at(cells, window) ** 2, axis=1)
    rest: FloatArray = np.maximum(cells["variance"] - sloped, 0.0)
    return rest


def usual_variance(variance: FloatArray, n: IntArray) -> float:
    """Return the median variance of a point about the ground [m²], of cells of at least four points; NaN for none.

    The median of a variance of few points is smaller than its mean; it is corrected by Wilson and Hilferty's formula.
    """
    many = n >= 4
    if not many.any():
        return float("nan")
    shrinkage = (1.0 - 2.0 / (9.0 * (n[many] - 1.0))) ** 3
    return float(np.median(variance[many] / shrinkage))


def shrunk_variance(variance: FloatArray, n: IntArray, usual_m2: float) -> FloatArray:
    """Return variances (N,) [m²] drawn towards the usual one, which counts as much as four points."""
    own, usual = n - 1.0, 4.0
    shrunk: FloatArray = (own * variance + usual * usual_m2) / (own + usual)
    return shrunk


def overlaps(
    cells: npt.NDArray[np.void], window: CellWindow, cell_m: float, point_variance_m2: FloatArray
) -> npt.NDArray[np.void]:
    """Return the blocks of a tile in which two strips overlap.

    Parameters
    ----------
    cells : (N,) ndarray of CELL
        Cells of the tile, by rows, columns and strips.
    window : CellWindow
        The tile.
    cell_m : float
        Side of a cell [m].
    point_variance_m2 : (N,) ndarray
        Variance of a point in each cell [m²].

    Returns
    -------
    (M,) ndarray of OVERLAP
        By pairs of strips and blocks. Heights are brought to the same place in the cell by the slope.
    """
    slope = slopes_at(cells, window)
    level = cells["z"] - slope[:, 0] * (cells["x"] - 0.5) - slope[:, 1] * (cells["y"] - 0.5)
    found: list[tuple[float, ...]] = []
    for a, b in _pairs(cells):
        difference = level[a] - level[b]
        sampling = point_variance_m2[a] / cells["n"][a] + point_variance_m2[b] / cells["n"][b]
        raw = cells["z"][a] - cells["z"][b]
        near = np.abs(difference) < _LARGEST_M
        values = np.column_stack([difference, sampling, slope[a] / cell_m, raw])[near]
        found += list(_blocks(cells[a[near]], cells["strip"][b[near]], values, cell_m))
    found.sort(key=lambda block: block[:4])
    return np.array(found, OVERLAP)


def slopes_at(cells: npt.NDArray[np.void], window: CellWindow) -> FloatArray:
    """Return the rise per cell eastwards and northwards at every cell (N, 2) [m]."""
    east, north = slopes(mean_heights(cells, window, np.zeros(len(cells))))
    row, column = cells["row"] - window.south, cells["column"] - window.west
    return np.column_stack([east[row, column], north[row, column]])


def _pairs(cells: npt.NDArray[np.void]) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield the indices of neighbouring entries, one, two, three … apart, that are of one cell."""
    apart = 1
    while apart < len(cells):
        a, b = cells[:-apart], cells[apart:]
        same = np.flatnonzero((a["row"] == b["row"]) & (a["column"] == b["column"]))
        if len(same) == 0:
            return
        yield same, same + apart
        apart += 1


def _blocks(
    cells: npt.NDArray[np.void], other: npt.NDArray[np.uint32], values: FloatArray, cell_m: float
) -> Iterator[tuple[float, ...]]:
    """Yield the blocks of cells; the columns of `values` are difference, sampling variance, slopes, raw difference."""
    row, column = cells["row"] // BLOCK_CELLS, cells["column"] // BLOCK_CELLS
    order = np.lexsort((column, row, other, cells["strip"]))
    keys = np.column_stack([cells["strip"], other, row, column])[order]
    changes = 1 + np.flatnonzero((np.diff(keys, axis=0) != 0).any(axis=1))
    for rows in np.split(order, changes):
        if len(rows) < _LEAST_CELLS:
            continue
        x, y = ((cells[a][rows].mean() + 0.5) * cell_m for a in ("column", "row"))
        first = rows[0]
        number = int(row[first]), int(column[first])
        yield (
            int(cells["strip"][first]),
            int(other[first]),
            float(x),
            float(y),
            *number,
            *_summed(values[rows]),
        )


def _summed(values: FloatArray) -> tuple[float, ...]:
    """Return scatter, sampling variance, sums of raw differences and `SUMS` of a block, without its outliers."""
    middle = np.median(values[:, 0])
    sigma = _MAD_TO_SIGMA * np.median(np.abs(values[:, 0] - middle))
    d, sampling, e, v, raw = values[np.abs(values[:, 0] - middle) <= _OUTLIER_SIGMAS * sigma].T
    sums = (len(d), e.sum(), v.sum(), e @ e, e @ v, v @ v, d.sum(), d @ e, d @ v, d @ d)
    return (
        float(sigma**2),
        float(sampling.mean()),
        float(raw.sum()),
        float((raw - d).sum()),
        *map(float, sums),
    )

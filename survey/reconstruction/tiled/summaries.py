"""Summary of a tile: differences between strips, differences to control points, and means for the long relief.

`summarise` reduces the points of a tile to cells and writes what they contribute to the parameters that all tiles share.
`overlaps` takes the differences between strips in the cells that two of them have seen, summed over blocks of cells.
`control_differences` compares strips with control points, such as GNSS measurements, by a plane through the cells about
each.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from survey.core import FloatArray, IntArray, replacing
from survey.reconstruction.tiled.cells import (
    STEP_M,
    blunders_in,
    cell_statistics,
    conflicts_in,
    mean_heights,
    slopes,
    sorted_points,
    write_cells,
)
from survey.reconstruction.tiled.job import Control, TiledJob
from survey.reconstruction.tiled.layout import CellWindow, MapTile

USUAL_M2 = 0.05**2
"""Variance of a point about the ground [m²] where no cell shows it."""


def summarise(job: TiledJob, tile: MapTile) -> int:
    """Write the cells and the summary of a tile; return the number of cells. A summary that is there stays."""
    if job.summary_file(tile).exists():
        return 0
    layout, window = job.layout, job.layout.window(tile)
    files = sorted_points(job.sorted_folder, list(job.pieces), tile)
    found = blunders_in(layout, tile, files)
    cells = cell_statistics(layout, tile, files, found.rows)
    variance = detrended_variance(cells, window)
    usual = usual_variance(variance, cells["n"])
    cells["variance"] = variance
    write_cells(job.cells_file(tile), cells)
    per_point = shrunk_variance(variance, cells["n"], usual if np.isfinite(usual) else USUAL_M2)
    slope = slopes_at(cells, window) / layout.cell_m
    control = job.control.within(window, layout.cell_m)
    arrays: dict[str, Any] = {
        "overlaps": overlaps(cells, window, layout.cell_m, per_point),
        "control": control_differences(cells, layout.cell_m, per_point, slope, control),
        "strips": _strip_table(cells, layout.cell_m),
        "blocks": relief_blocks(cells, slope, window, layout.cell_m, job.config.coarse_cells),
        "blunders": np.column_stack([found.xy, found.above_m]),
        "conflicts": conflicts_in(
            layout, tile, files, float(np.sqrt(usual if np.isfinite(usual) else USUAL_M2))
        ),
        "usual_m2": np.array([usual, float((cells["n"] >= 4).sum())]),
    }
    with replacing(job.summary_file(tile)) as draft:
        np.savez(draft, **arrays)
    return len(cells)


def _strip_table(cells: npt.NDArray[np.void], cell_m: float) -> FloatArray:
    """Return key, number of cells, and sums of x, y, x² and y² [m] of every strip (S, 6)."""
    keys, index = np.unique(cells["strip"], return_inverse=True)
    x, y = ((cells[axis] + 0.5) * cell_m for axis in ("column", "row"))
    sums = [np.bincount(index, weight) for weight in (np.ones(len(x)), x, y, x * x, y * y)]
    return np.column_stack([keys, *sums])


def relief_blocks(
    cells: npt.NDArray[np.void], slope: FloatArray, window: CellWindow, cell_m: float, side: int
) -> FloatArray:
    """Return the means of the cells of each strip over blocks (N, 7).

    The columns are the key of the strip, the number of its cells, their mean place (2) and height [m], and slopes (2) [m/m].

    `cells` (N,): cells of the tile. `slope` (N, 2): slopes [m/m]. `cell_m`: side of a cell [m].
    """
    keys, strip = np.unique(cells["strip"], return_inverse=True)
    row, column = (cells["row"] - window.south) // side, (cells["column"] - window.west) // side
    rows, columns = -(-window.rows // side), -(-window.columns // side)
    flat = (strip * rows + row) * columns + column
    x, y = ((cells[a].astype(np.float64) + cells[b]) * cell_m for a, b in (("column", "x"), ("row", "y")))
    n = np.bincount(flat, minlength=len(keys) * rows * columns)
    present = np.flatnonzero(n)
    means = [np.bincount(flat, v)[present] / n[present] for v in (x, y, cells["z"], slope[:, 0], slope[:, 1])]
    return np.column_stack([keys[present // (rows * columns)], n[present], *means])


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
# Standard deviation of normal errors over their median absolute deviation.
_MAD_TO_SIGMA = 1.4826
# A difference beyond this is no strip error but a tree, a snow bank or ice that moved.
_LARGEST_M = 20.0
# Variance of a place anywhere in a cell, over its side squared.
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

    `cells` (N,): cells of the tile, by rows, columns and strips. `cell_m`: side of a cell [m].
    `point_variance_m2` (N,): variance of a point in each cell [m²]. Returns (M,): by pairs of strips and
    blocks. Heights are brought to the same place in the cell by the slope.
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


_REACH_CELLS = 1.6
_LEAST_CELLS_OF_PLANE = 5


def control_differences(
    cells: npt.NDArray[np.void],
    cell_m: float,
    point_variance_m2: FloatArray,
    slope: FloatArray,
    control: Control,
) -> npt.NDArray[np.void]:
    """Return the differences of strips and control points, each by a plane through the cells about it.

    `cells` (N,): cells of the tile. `cell_m`: side of a cell [m]. `point_variance_m2` (N,): variance of a
    point in each cell [m²]. `slope` (N, 2): slopes [m/m]. Returns (M,): with `second` 0 and `n` 1. A control
    point that several strips see counts once in all.
    """
    x, y = ((cells[a] + cells[b]) * cell_m for a, b in (("column", "x"), ("row", "y")))
    found: list[tuple[float, ...]] = []
    for (px, py, pz), sigma_m in zip(control.xyz, control.sigma_m, strict=True):
        near = np.flatnonzero(
            (np.abs(x - px) < _REACH_CELLS * cell_m) & (np.abs(y - py) < _REACH_CELLS * cell_m)
        )
        rows = []
        for key in np.unique(cells["strip"][near]):
            own = near[cells["strip"][near] == key]
            if len(own) < _LEAST_CELLS_OF_PLANE:
                continue
            noise = point_variance_m2[own] / cells["n"][own]
            z, fit_m2 = _plane_at(np.column_stack([x[own] - px, y[own] - py]), cells["z"][own], noise)
            e, v = slope[own].mean(axis=0)
            rows.append((int(key), z - pz, fit_m2, float(e), float(v)))
        for key, d, fit_m2, e, v in rows:
            variance = fit_m2 + len(rows) * sigma_m**2
            sums = (1.0, e, v, e * e, e * v, v * v, d, d * e, d * v, d * d)
            # Each control point is a block of its own.
            number = round(py / STEP_M), round(px / STEP_M)
            found.append((key, 0, px, py, *number, variance, variance, d, 0.0, *sums))
    return np.array(found, OVERLAP)


def _plane_at(xy: FloatArray, z: FloatArray, noise_m2: FloatArray) -> tuple[float, float]:
    """Return the height of the plane through cells above the origin [m] and its variance [m²].

    What the plane leaves of the cells' heights is relief that is alike in neighbouring cells: it counts in full.
    """
    design = np.column_stack([np.ones(len(xy)), xy])
    solution, *_ = np.linalg.lstsq(design, z, rcond=None)
    misfit = float(np.sum((z - design @ solution) ** 2)) / max(len(z) - 3, 1)
    return float(solution[0]), max(misfit, float(noise_m2.mean()))

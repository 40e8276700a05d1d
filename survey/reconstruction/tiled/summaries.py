"""Cells of a tile, and what they contribute to the errors of strips and to the long relief."""

from typing import Any

import numpy as np
import numpy.typing as npt

from survey.core.arrays import FloatArray
from survey.core.files.writing import replacing
from survey.reconstruction.tiled.cells.sorting import sorted_points
from survey.reconstruction.tiled.cells.statistics import cell_statistics, write_cells
from survey.reconstruction.tiled.job import TiledJob
from survey.reconstruction.tiled.layout import CellWindow, MapTile
from survey.reconstruction.tiled.strips.control import control_differences
from survey.reconstruction.tiled.strips.overlaps import (
    detrended_variance,
    overlaps,
    shrunk_variance,
    slopes_at,
    usual_variance,
)

_USUAL_M2 = 0.05**2


def summarise(job: TiledJob, tile: MapTile) -> int:
    """Write the cells and the summary of a tile; return the number of cells. A summary that is there stays."""
    if job.summary_file(tile).exists():
        return 0
    layout, window = job.layout, job.layout.window(tile)
    files = sorted_points(job.sorted_folder, list(job.pieces), tile)
    cells = cell_statistics(layout, tile, files)
    variance = detrended_variance(cells, window)
    usual = usual_variance(variance, cells["n"])
    cells["variance"] = variance
    write_cells(job.cells_file(tile), cells)
    per_point = shrunk_variance(variance, cells["n"], usual if np.isfinite(usual) else _USUAL_M2)
    slope = slopes_at(cells, window) / layout.cell_m
    control = job.control.within(window, layout.cell_m)
    arrays: dict[str, Any] = {
        "overlaps": overlaps(cells, window, layout.cell_m, per_point),
        "control": control_differences(cells, layout.cell_m, per_point, slope, control),
        "strips": _strip_table(cells, layout.cell_m),
        "blocks": relief_blocks(cells, slope, window, layout.cell_m, job.config.coarse_cells),
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

    Parameters
    ----------
    cells : (N,) ndarray of CELL
        Cells of the tile.
    slope : (N, 2) ndarray
        Slopes [m/m].
    window : CellWindow
        The tile.
    cell_m : float
        Side of a cell [m].
    side : int
        Cells along a side of a block, a divisor of the tile's.
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

"""Statistics of cells: number, mean place, mean height and variance of the points of each strip in each cell."""

from bisect import bisect_left
from collections.abc import Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from survey.core.arrays import FloatArray, IntArray
from survey.core.files.writing import replacing
from survey.reconstruction.tiled.cells.sorting import STEP_M, read_sorted
from survey.reconstruction.tiled.layout import CellWindow, MapTile, TileLayout

CELL = np.dtype(
    [
        ("row", "<i4"),
        ("column", "<i4"),
        ("strip", "<u4"),
        ("n", "<u4"),
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f8"),
        ("variance", "<f4"),
    ]
)
"""A cell seen by a strip: row and column counted from the origin of the CRS, key of the strip, number of points, mean
place in the cell (0 to 1), mean height [m], and variance of the heights within the cell [m²]."""
_AT_ONCE = 2_000_000
_STRIPS_AT_ONCE = 8
_N, _X, _Y, _Z, _M2 = range(5)


def cell_statistics(layout: TileLayout, tile: MapTile, files: Sequence[Path]) -> npt.NDArray[np.void]:
    """Return the cells of a tile that hold points, for each strip, by rows, columns and strips.

    Parameters
    ----------
    layout : TileLayout
        Tiles of the map.
    tile : MapTile
        The tile.
    files : sequence of pathlib.Path
        Its sorted points; they are read in this order, which fixes the rounding.

    Returns
    -------
    (N,) ndarray of `CELL`
        Cells with their statistics.

    Raises
    ------
    InputError
        A file was cut off.
    """
    window = layout.window(tile)
    parts = [read_sorted(file) for file in files]
    strips = np.unique(np.concatenate([np.unique(part["strip"]) for part in parts] or [np.zeros(0, "<u4")]))
    groups = np.split(strips, range(_STRIPS_AT_ONCE, len(strips), _STRIPS_AT_ONCE))
    cells = np.concatenate([_of_strips(group, parts, window, layout.cell_m) for group in groups])
    return cells[np.lexsort((cells["strip"], cells["column"], cells["row"]))]


def _of_strips(
    strips: npt.NDArray[np.uint32], parts: Sequence[npt.NDArray[np.void]], window: CellWindow, cell_m: float
) -> npt.NDArray[np.void]:
    """Return the cells of some strips."""
    sums = np.zeros((len(strips), window.rows, window.columns, 5))
    for part in parts:
        for first in range(0, len(part), _AT_ONCE):
            points = part[first : first + _AT_ONCE]
            points = points[np.isin(points["strip"], strips)]
            x, y = (points[axis] * (STEP_M / cell_m) for axis in ("x", "y"))
            _add_points(x, y, points["z"] * STEP_M, np.searchsorted(strips, points["strip"]), sums)
    return _as_cells(sums, strips, window)


@njit(cache=True)
def _add_points(x: FloatArray, y: FloatArray, z: FloatArray, strip: IntArray, sums: FloatArray) -> None:
    """Add points to number, means, and sum of squared deviations of their cells (Welford's recurrence)."""
    rows, columns = sums.shape[1:3]
    for k in range(len(x)):
        # Rounding to millimetres may put a point upon the far edge.
        j, i = min(max(int(y[k]), 0), rows - 1), min(max(int(x[k]), 0), columns - 1)
        cell = sums[strip[k], j, i]
        cell[0] += 1.0
        cell[1] += (x[k] - i - cell[1]) / cell[0]
        cell[2] += (y[k] - j - cell[2]) / cell[0]
        before = z[k] - cell[3]
        cell[3] += before / cell[0]
        cell[4] += before * (z[k] - cell[3])


def _as_cells(sums: FloatArray, strips: Any, window: CellWindow) -> npt.NDArray[np.void]:
    row, column, strip = np.nonzero(np.moveaxis(sums[..., _N], 0, -1))
    found = sums[strip, row, column]
    cells = np.empty(len(found), CELL)
    cells["row"], cells["column"] = row + window.south, column + window.west
    cells["strip"], cells["n"] = strips[strip], found[:, _N]
    cells["x"], cells["y"], cells["z"] = found[:, _X], found[:, _Y], found[:, _Z]
    cells["variance"] = found[:, _M2] / np.maximum(found[:, _N] - 1.0, 1.0)
    return cells


def write_cells(path: Path, cells: npt.NDArray[np.void]) -> None:
    """Write cells in place of what stood there, by one rename."""
    with replacing(path) as draft:
        np.save(draft.with_suffix(".npy"), cells)


def read_rows(path: Path, first: int, last: int) -> npt.NDArray[np.void]:
    """Return the cells of a tile in rows from `first` to before `last`, read from the disk; none where there is no file."""
    if not path.exists():
        return np.zeros(0, CELL)
    cells: npt.NDArray[np.void] = np.load(path, mmap_mode="r")
    begin, end = (bisect_left(cells, row, key=itemgetter("row")) for row in (first, last))
    return np.array(cells[begin:end])


def cells_in(folder: Path, layout: TileLayout, tile: MapTile, window: CellWindow) -> npt.NDArray[np.void]:
    """Return the cells in a window about a tile, from the files of the tiles about it."""
    reach = max(layout.window(tile).west - window.west, layout.window(tile).south - window.south, 0)
    east = window.west + window.columns - layout.window(tile).west - layout.window(tile).columns
    north = window.south + window.rows - layout.window(tile).south - layout.window(tile).rows
    found = []
    for other in layout.near(tile, max(reach, east, north)):
        cells = read_rows(folder / f"{other.name}.npy", window.south, window.south + window.rows)
        column = cells["column"] - window.west
        found.append(cells[(column >= 0) & (column < window.columns)])
    return np.concatenate(found)

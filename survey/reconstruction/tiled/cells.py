"""Points of a large survey sorted to tiles on disk, and their statistics in cells.

A piece of a file is read in chunks; its points are appended to one file per tile in a draft folder, which is put in
place by one rename. A piece that is there is not done again, so that a killed pass goes on where it was.
`cell_statistics` reduces the points of a tile to the number, mean place, mean height and variance of each strip in each
cell, without the blunders that `blunders_in` finds. `mean_heights` and `slopes` are rasters of the cells of a window, over all strips.
"""

import os
import shutil
from bisect import bisect_left
from collections.abc import Sequence
from itertools import pairwise
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.ndimage import binary_dilation, maximum_filter, minimum_filter, uniform_filter

from survey.core import BoolArray, FloatArray, InputError, IntArray, replacing
from survey.core.files import write_refusal
from survey.io.point_chunks import PointChunk, read_chunks
from survey.io.point_classes import is_left_out
from survey.reconstruction.observations import (
    LEAST_TESTED,
    MOST_TESTED,
    NO_BLUNDERS,
    Blunders,
    least_blunder_m,
)
from survey.reconstruction.tiled.layout import CellWindow, MapTile, TileLayout

_PIECE_POINTS = 2_500_000
_FILE_BITS = 16
_CLASSES_FROM = 3_000_000


class Piece(NamedTuple):
    """Points of a file that are sorted together.

    `file`: path of the file. `number`: number of the file among the sources. `first`, `n`: first point and
    number of points. `ground_class`: class of the points to use; all but noise where None. `metres`: in a unit of the
    places and of the heights of the file.
    """

    file: str
    number: int
    first: int
    n: int
    ground_class: int | None
    metres: tuple[float, float] = (1.0, 1.0)

    @property
    def name(self) -> str:
        """Name of the folder of its sorted points."""
        return f"f{self.number:05d}_p{self.first:012d}"


def pieces_of(
    file: Path, number: int, n_points: int, ground_class: int | None, metres: tuple[float, float] = (1.0, 1.0)
) -> list[Piece]:
    """Return the pieces of a file: equal parts of at most 2.5 million points.

    >>> [piece.n for piece in pieces_of(Path("a.laz"), 0, 6_500_000, None)]
    [2166667, 2166667, 2166666]
    """
    n_parts = -(-n_points // _PIECE_POINTS)
    ends = [-(-k * n_points // n_parts) for k in range(n_parts + 1)]
    return [
        Piece(str(file), number, first, end - first, ground_class, metres) for first, end in pairwise(ends)
    ]


def holds_class(file: Path, n_points: int, wanted: int) -> bool:
    """Return whether a file holds points of a class among its first three million."""
    n = min(n_points, _CLASSES_FROM)
    return any((chunk.classes == wanted).any() for chunk in read_chunks(file, 0, n))


def strip_keys(strip: npt.NDArray[np.uint16], file_number: int) -> npt.NDArray[np.uint32]:
    """Return keys of strips: the flight line's number, or the file where a point states none.

    `strip` (N,): number of the flight line; 0 for none. Returns (N,): equal keys for equal strips, over all
    files.
    """
    own = strip.astype(np.uint32)
    return np.where(own > 0, own, np.uint32((file_number + 1) << _FILE_BITS)).astype(np.uint32)


def strip_name(key: int) -> str:
    """Return the name of a strip: the number of its flight line, or that of its file counted from 1.

    >>> strip_name(8705), strip_name(2 << 16)
    ('8705', 'file 2')
    """
    return str(key) if key < 1 << _FILE_BITS else f"file {key >> _FILE_BITS}"


POINT = np.dtype([("x", "<i4"), ("y", "<i4"), ("z", "<i4"), ("strip", "<u4")])
"""A sorted point: millimetres from the tile's south-west corner, height in millimetres, and the key of its strip."""
STEP_M = 1e-3
_HIGHEST_M = 2.0e6


def sort_piece(layout: TileLayout, folder: Path, piece: Piece) -> int:
    """Sort the points of a piece to files of their tiles; return how many points were used."""
    target = folder / piece.name
    if target.exists():
        return _n_sorted(target)
    draft = folder / f".{piece.name}.{os.getpid()}"
    shutil.rmtree(draft, ignore_errors=True)
    try:
        draft.mkdir(parents=True)
        for chunk in read_chunks(piece.file, piece.first, piece.n, piece.metres):
            _append(chunk, layout, draft, piece)
        _put_in_place(draft, target)
    except OSError as error:
        raise write_refusal(target, error) from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return _n_sorted(target)


def _put_in_place(draft: Path, target: Path) -> None:
    """Rename the draft; another worker that was given the same piece may have been faster."""
    try:
        draft.rename(target)
    except OSError:
        if not target.exists():
            raise


def _n_sorted(target: Path) -> int:
    return sum(file.stat().st_size for file in target.iterdir()) // POINT.itemsize


def _append(chunk: PointChunk, layout: TileLayout, draft: Path, piece: Piece) -> None:
    used = _is_used(chunk, piece.ground_class)
    xyz, strip = chunk.xyz[used], chunk.strip[used]
    if len(xyz) == 0:
        return
    if np.abs(xyz[:, 2]).max() > _HIGHEST_M:
        raise InputError(
            f"the point file {piece.file} holds a height of {np.abs(xyz[:, 2]).max():.6g} m; it is damaged, get it again."
        )
    cells = np.floor(xyz[:, :2] / layout.cell_m).astype(np.int64)
    number = layout.tile_numbers(cells)
    order = np.argsort(number, kind="stable")
    present, starts = np.unique(number[order], return_index=True)
    for tile_number, rows in zip(present.tolist(), np.split(order, starts[1:]), strict=True):
        if tile_number >= 0:
            tile = MapTile(*divmod(tile_number, layout.shape[1]))
            records = _records(xyz[rows], strip[rows], layout, tile, piece.number)
            with (draft / f"{tile.name}.bin").open("ab") as stream:
                stream.write(records.tobytes())


def _is_used(chunk: PointChunk, ground_class: int | None) -> BoolArray:
    if ground_class is not None:
        of_ground: BoolArray = chunk.classes == ground_class
        return of_ground
    return ~is_left_out(chunk.classes)


def _records(
    xyz: FloatArray, strip: npt.NDArray[np.uint16], layout: TileLayout, tile: MapTile, file_number: int
) -> npt.NDArray[np.void]:
    window = layout.window(tile)
    corner = np.array([window.west, window.south]) * layout.cell_m
    records = np.empty(len(xyz), POINT)
    records["x"], records["y"] = np.round((xyz[:, :2] - corner) / STEP_M).T
    records["z"] = np.round(xyz[:, 2] / STEP_M)
    records["strip"] = strip_keys(strip, file_number)
    return records


def sorted_points(folder: Path, pieces: list[Piece], tile: MapTile) -> list[Path]:
    """Return the files of a tile's sorted points, in the order of the pieces."""
    files = [folder / piece.name / f"{tile.name}.bin" for piece in pieces]
    return [file for file in files if file.exists()]


def read_sorted(file: Path) -> npt.NDArray[np.void]:
    """Return sorted points of a tile, mapped and not read."""
    if file.stat().st_size % POINT.itemsize:
        raise InputError(f"the sorted points {file} were cut off; remove the folder {file.parent} and go on.")
    return np.memmap(file, POINT, "r")


def present_tiles(folder: Path, pieces: list[Piece], layout: TileLayout) -> list[MapTile]:
    """Return the tiles that hold at least one point."""
    names = {file.stem for piece in pieces for file in (folder / piece.name).iterdir()}
    return [tile for tile in layout.tiles if tile.name in names]


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
_MANY_IN_CELL = 3
_N, _X, _Y, _Z, _M2 = range(5)


def cell_statistics(
    layout: TileLayout, tile: MapTile, files: Sequence[Path], left_out: IntArray | None = None
) -> npt.NDArray[np.void]:
    """Return the cells of a tile that hold points, for each strip, by rows, columns and strips.

    `left_out` (K,) int: numbers of points that are left out, counted through all files. Returns (N,): cells
    with their statistics.
    """
    window = layout.window(tile)
    parts = [read_sorted(file) for file in files]
    if left_out is not None and len(left_out):
        starts = np.cumsum([0, *(len(part) for part in parts)])
        parts = [
            np.delete(part, left_out[(left_out >= first) & (left_out < first + len(part))] - first)
            for part, first in zip(parts, starts, strict=False)
        ]
    strips = np.unique(np.concatenate([np.unique(part["strip"]) for part in parts] or [np.zeros(0, "<u4")]))
    groups = np.split(strips, range(_STRIPS_AT_ONCE, len(strips), _STRIPS_AT_ONCE))
    cells = np.concatenate([_of_strips(group, parts, window, layout.cell_m) for group in groups])
    return cells[np.lexsort((cells["strip"], cells["column"], cells["row"]))]


def blunders_in(layout: TileLayout, tile: MapTile, files: Sequence[Path]) -> Blunders:
    """Return the points of a tile whose height is a blunder.

    Where cells hold many points, only points in cells with a large range of heights, or beside such cells, are tested.
    """
    window = layout.window(tile)
    parts = [read_sorted(file) for file in files]
    n = sum(len(part) for part in parts)
    if n < LEAST_TESTED:
        return NO_BLUNDERS
    low, high = _ranges(parts, window, layout.cell_m)
    is_seen = np.isfinite(low)
    least_m = least_blunder_m(low[is_seen])
    large = np.ones(low.shape, dtype=bool)
    if n >= _MANY_IN_CELL * is_seen.sum() or n > MOST_TESTED:
        lowest = minimum_filter(low, 3, mode="constant", cval=np.inf)
        highest = maximum_filter(high, 3, mode="constant", cval=-np.inf)
        large = binary_dilation(highest - lowest > least_m, iterations=2)
        if not large.any():
            return NO_BLUNDERS
    starts = np.cumsum([0, *(len(part) for part in parts)])
    tested = np.concatenate(
        [
            start + np.flatnonzero(large[_cells_of(part, window, layout.cell_m)])
            for part, start in zip(parts, starts, strict=False)
        ]
    )
    if not LEAST_TESTED <= len(tested) <= MOST_TESTED:
        return NO_BLUNDERS
    chosen = np.concatenate(
        [
            part[tested[(tested >= start) & (tested < start + len(part))] - start]
            for part, start in zip(parts, starts, strict=False)
        ]
    )
    corner = np.array([window.west, window.south]) * layout.cell_m
    xy = np.column_stack([chosen["x"], chosen["y"]]) * STEP_M + corner
    found = Blunders.among(np.column_stack([xy, chosen["z"] * STEP_M]), 0.0, least_m)
    return found._replace(rows=tested[found.rows])


CONFLICT = np.dtype(
    [("x", "<f8"), ("y", "<f8"), ("n", "<i8"), ("low", "<f8"), ("high", "<f8"), ("scatter", "<f8")]
)
"""A place [m] that holds heights which contradict one another: their number, range and standard deviation [m]."""
_TIMES_SCATTER, _LEAST_SCATTER_M = 5.0, 0.1


def conflicts_in(
    layout: TileLayout, tile: MapTile, files: Sequence[Path], usual_m: float
) -> npt.NDArray[np.void]:
    """Return the places of a tile, equal to the millimetre, whose heights scatter by far more than is usual in a cell [m]."""
    parts = [read_sorted(file) for file in files]
    x, y, z = (np.concatenate([np.asarray(part[axis], np.int64) for part in parts]) for axis in "xyz")
    place = x << 32 | y
    ordered = np.sort(place)
    several = np.flatnonzero(np.isin(place, ordered[1:][np.diff(ordered) == 0]))
    order = several[np.lexsort((z[several], place[several]))]
    x, y, z = x[order], y[order], z[order] * STEP_M
    starts = np.flatnonzero(np.diff(place[order], prepend=-1))
    n = np.diff(starts, append=len(x))
    mean = np.add.reduceat(z, starts) / n
    scatter = np.sqrt(np.add.reduceat((z - np.repeat(mean, n)) ** 2, starts) / np.maximum(n - 1, 1))
    chosen = np.flatnonzero(scatter > max(_TIMES_SCATTER * usual_m, _LEAST_SCATTER_M))
    found = np.zeros(len(chosen), CONFLICT)
    first, window = starts[chosen], layout.window(tile)
    found["x"] = x[first] * STEP_M + window.west * layout.cell_m
    found["y"] = y[first] * STEP_M + window.south * layout.cell_m
    found["n"], found["scatter"] = n[chosen], scatter[chosen]
    found["low"], found["high"] = z[first], z[first + n[chosen] - 1]
    return found


def _ranges(
    parts: Sequence[npt.NDArray[np.void]], window: CellWindow, cell_m: float
) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest height in each cell (H, W) [m]; infinite where a cell holds no point."""
    shape = window.rows, window.columns
    low, high = np.full(shape, np.inf), np.full(shape, -np.inf)
    for part in parts:
        for first in range(0, len(part), _AT_ONCE):
            points = part[first : first + _AT_ONCE]
            cell, z = _cells_of(points, window, cell_m), points["z"] * STEP_M
            np.minimum.at(low, cell, z)
            np.maximum.at(high, cell, z)
    return low, high


def _cells_of(points: npt.NDArray[np.void], window: CellWindow, cell_m: float) -> tuple[IntArray, IntArray]:
    """Return row and column in the window of the cell of each point."""
    row, column = ((points[axis] * (STEP_M / cell_m)).astype(np.int64) for axis in ("y", "x"))
    return row.clip(0, window.rows - 1), column.clip(0, window.columns - 1)


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


def mean_heights(cells: npt.NDArray[np.void], window: CellWindow, offset_m: FloatArray) -> FloatArray:
    """Return the mean height of the points of each cell (rows, columns) [m]; NaN for cells without any.

    `cells` (N,): cells in the window. `offset_m` (N,): subtracted from the heights [m].
    """
    flat = (cells["row"] - window.south).astype(np.int64) * window.columns + cells["column"] - window.west
    n = np.bincount(flat, cells["n"], window.rows * window.columns)
    total = np.bincount(flat, cells["n"] * (cells["z"] - offset_m), window.rows * window.columns)
    heights: FloatArray = np.full(len(n), np.nan)
    np.divide(total, n, out=heights, where=n > 0)
    return heights.reshape(window.shape)


def filled(heights: FloatArray, width: int) -> FloatArray:
    """Return the moving average (rows, columns) of known heights over a square of cells; NaN where none is known."""
    known = np.isfinite(heights)
    level = float(heights[known].mean()) if known.any() else 0.0
    share = uniform_filter(known.astype(np.float64), width, mode="constant")
    total = uniform_filter(np.where(known, heights - level, 0.0), width, mode="constant")
    average = np.full(heights.shape, np.nan)
    np.divide(total, share, out=average, where=share > 0.5 / width**2)
    return average + level


def slopes(heights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rise per cell eastwards and northwards (rows, columns) [m] of averaged heights; 0 where unknown."""
    smooth = filled(heights, 3)
    if min(smooth.shape) < 2:
        return np.zeros(smooth.shape), np.zeros(smooth.shape)
    north: FloatArray = np.gradient(smooth, axis=0)
    east: FloatArray = np.gradient(smooth, axis=1)
    return np.nan_to_num(east), np.nan_to_num(north)

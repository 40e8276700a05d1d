"""Sorting of points to tiles on disk, in one pass over the point files.

A piece of a file is read in chunks; its points are appended to one file per tile in a draft folder, which is put in
place by one rename. A piece that is there is not done again, so that a killed pass goes on where it was.
"""

import os
import shutil
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from survey.core.arrays import BoolArray, FloatArray
from survey.core.errors import CapacityError, InputError
from survey.core.files.writing import write_refusal
from survey.io.points.chunks import PointChunk, read_chunks
from survey.reconstruction.tiled.layout import MapTile, TileLayout

POINT = np.dtype([("x", "<i4"), ("y", "<i4"), ("z", "<i4"), ("strip", "<u4")])
"""A sorted point: millimetres from the tile's south-west corner, height in millimetres, and the key of its strip."""
STEP_M = 1e-3
_PIECE_POINTS = 10_000_000
_FILE_BITS = 16
_CLASSES_FROM = 3_000_000
_NOISE = (7, 18)
_HIGHEST_M = 2.0e6
# Cells with their strips, solutions and maps of a tile, beside the sorted points.
_BYTES_PER_CELL = 90


class Piece(NamedTuple):
    """Points of a file that are sorted together.

    Parameters
    ----------
    file : str
        Path of the file.
    number : int
        Number of the file among the sources.
    first, n : int
        First point and number of points.
    ground_class : int or None
        Class of the points to use; all but noise where None.
    """

    file: str
    number: int
    first: int
    n: int
    ground_class: int | None

    @property
    def name(self) -> str:
        """Name of the folder of its sorted points."""
        return f"f{self.number:05d}_p{self.first:012d}"


def pieces_of(file: Path, number: int, n_points: int, ground_class: int | None) -> list[Piece]:
    """Return the pieces of a file: equal parts of at most 10 million points.

    Examples
    --------
    >>> [piece.n for piece in pieces_of(Path("a.laz"), 0, 25_000_000, None)]
    [8333334, 8333333, 8333333]
    """
    n_parts = -(-n_points // _PIECE_POINTS)
    ends = [-(-k * n_points // n_parts) for k in range(n_parts + 1)]
    return [Piece(str(file), number, first, end - first, ground_class) for first, end in pairwise(ends)]


def holds_class(file: Path, n_points: int, wanted: int) -> bool:
    """Return whether a file holds points of a class among its first three million."""
    n = min(n_points, _CLASSES_FROM)
    return any((chunk.classes == wanted).any() for chunk in read_chunks(file, 0, n))


def disk_bytes(n_points: int, n_cells: int) -> int:
    """Return the disk space that sorted points and cells take.

    Examples
    --------
    >>> disk_bytes(1_000_000_000, 100_000_000)
    25000000000
    """
    return n_points * POINT.itemsize + n_cells * _BYTES_PER_CELL


def require_disk(folder: Path, n_points: int, n_cells: int) -> int:
    """Return the disk space that the work takes, or refuse one that is not free.

    Parameters
    ----------
    folder : pathlib.Path
        An existing folder on the disk.
    n_points, n_cells : int
        Points of the survey and cells of the map.

    Returns
    -------
    int
        Bytes.

    Raises
    ------
    CapacityError
        Less space is free.
    """
    needed = disk_bytes(n_points, n_cells)
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise CapacityError(
            f"the work takes {needed / 1e9:.3g} GB of disk for {n_points:,} points and {n_cells:,} cells, and {free / 1e9:.3g} GB "
            f"are free at {folder}; free space, or choose another disk with --out."
        )
    return needed


def sort_piece(layout: TileLayout, folder: Path, piece: Piece) -> int:
    """Sort the points of a piece to files of their tiles; return how many points were used.

    Parameters
    ----------
    layout : TileLayout
        Tiles of the map.
    folder : pathlib.Path
        Folder in which the folder of the piece appears by one rename; one that is there is not written again.
    piece : Piece
        The points.

    Raises
    ------
    InputError
        The file is damaged, its heights are no heights, or the disk is full.
    """
    target = folder / piece.name
    if target.exists():
        return _n_sorted(target)
    draft = folder / f".{piece.name}.{os.getpid()}"
    shutil.rmtree(draft, ignore_errors=True)
    try:
        draft.mkdir(parents=True)
        for chunk in read_chunks(piece.file, piece.first, piece.n):
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
    return ~np.isin(chunk.classes, _NOISE)


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


def strip_keys(strip: npt.NDArray[np.uint16], file_number: int) -> npt.NDArray[np.uint32]:
    """Return keys of strips: the flight line's number, or the file where a point states none.

    Parameters
    ----------
    strip : (N,) ndarray of uint16
        Number of the flight line; 0 for none.
    file_number : int
        Number of the file among the sources.

    Returns
    -------
    (N,) ndarray of uint32
        Equal keys for equal strips, over all files.
    """
    own = strip.astype(np.uint32)
    return np.where(own > 0, own, np.uint32((file_number + 1) << _FILE_BITS)).astype(np.uint32)


def strip_name(key: int) -> str:
    """Return the name of a strip: the number of its flight line, or that of its file counted from 1.

    Examples
    --------
    >>> strip_name(8705), strip_name(2 << 16)
    ('8705', 'file 2')
    """
    return str(key) if key < 1 << _FILE_BITS else f"file {key >> _FILE_BITS}"


def sorted_points(folder: Path, pieces: list[Piece], tile: MapTile) -> list[Path]:
    """Return the files of a tile's sorted points, in the order of the pieces."""
    files = [folder / piece.name / f"{tile.name}.bin" for piece in pieces]
    return [file for file in files if file.exists()]


def read_sorted(file: Path) -> npt.NDArray[np.void]:
    """Return sorted points of a tile, mapped and not read.

    Raises
    ------
    InputError
        The file was cut off.
    """
    if file.stat().st_size % POINT.itemsize:
        raise InputError(f"the sorted points {file} were cut off; remove the folder {file.parent} and go on.")
    return np.memmap(file, POINT, "r")


def present_tiles(folder: Path, pieces: list[Piece], layout: TileLayout) -> list[MapTile]:
    """Return the tiles that hold at least one point."""
    names = {file.stem for piece in pieces for file in (folder / piece.name).iterdir()}
    return [tile for tile in layout.tiles if tile.name in names]


__all__ = [
    "POINT",
    "STEP_M",
    "Piece",
    "disk_bytes",
    "holds_class",
    "pieces_of",
    "present_tiles",
    "read_sorted",
    "require_disk",
    "sort_piece",
    "sorted_points",
    "strip_keys",
    "strip_name",
]

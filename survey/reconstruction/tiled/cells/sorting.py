"""Sorting of points to tiles on disk, in one pass over the point files.

A piece of a file is read in chunks; its points are appended to one file per tile in a draft folder, which is put in
place by one rename. A piece that is there is not done again, so that a killed pass goes on where it was.
"""

import os
import shutil
from pathlib import Path

import numpy as np
import numpy.typing as npt

from survey.core.arrays import BoolArray, FloatArray
from survey.core.errors import InputError
from survey.core.files.writing import write_refusal
from survey.io.points.chunks import PointChunk, read_chunks
from survey.reconstruction.tiled.cells.pieces import Piece, strip_keys
from survey.reconstruction.tiled.layout import MapTile, TileLayout

POINT = np.dtype([("x", "<i4"), ("y", "<i4"), ("z", "<i4"), ("strip", "<u4")])
"""A sorted point: millimetres from the tile's south-west corner, height in millimetres, and the key of its strip."""
STEP_M = 1e-3
_NOISE = (7, 18)
_HIGHEST_M = 2.0e6


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

"""Adler-32 checksums of deflate-compressed TIFF blocks, which GDAL does not compare."""

import zlib
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any

from survey.core.files.library_messages import DamagedError
from survey.io.file_kinds import RASTER_DRIVERS
from survey.io.vrt import VrtPart, raster_parts

_TIFF = ("GTiff", "COG")
_SLICE = 1 << 16


def refuse_damaged_blocks(source: Any, file: Path, band: int, window: Sequence[int]) -> None:
    """Compare the checksums of the deflate-compressed blocks of a TIFF band that a window touches.

    GDAL returns the values of a block whose checksum is wrong, without a warning. Blocks of
    other compressions carry no checksum and pass. The sources of a VRT are compared in the same way.

    Parameters
    ----------
    source : rasterio.DatasetReader
        The opened file.
    file : pathlib.Path
        Where it is.
    band : int
        Counted from 1.
    window : sequence of int
        First column, first row, width and height [cells].

    Raises
    ------
    DamagedError
        A block that does not unpack, or whose checksum differs.
    """
    if source.driver == "VRT":
        for part in raster_parts(file, band, window):
            _refuse_damaged_part(part)
    if source.driver not in _TIFF or source.profile.get("compress") != "deflate":
        return
    with file.open("rb") as stream:
        for place, offset, size in _blocks(source, band, window):
            stream.seek(offset)
            if not _is_sound(stream.read(size)):
                raise DamagedError(f"the checksum of block {place} does not fit its content")


def _refuse_damaged_part(part: VrtPart) -> None:
    """Compare the blocks of a source of a VRT, and name the source where one is damaged."""
    import rasterio

    column, row, columns, rows = part.window
    with rasterio.open(part.file, driver=RASTER_DRIVERS[part.file.suffix.lower()]) as source:
        if not 1 <= part.band <= source.count:
            raise DamagedError(f"its source {part.file.name} has no band {part.band}")
        width, height = min(columns, source.width - column), min(rows, source.height - row)
        try:
            refuse_damaged_blocks(source, part.file, part.band, (column, row, width, height))
        except DamagedError as error:
            raise DamagedError(f"its source {part.file.name}: {error}") from error


def _blocks(source: Any, band: int, window: Sequence[int]) -> Iterator[tuple[str, int, int]]:
    """Yield name, offset and size [bytes] of the blocks that the file holds; sparse ones are left out."""
    height, width = source.block_shapes[band - 1]
    column, row, columns, rows = window
    for i, j in product(
        range(row // height, -(-(row + rows) // height)),
        range(column // width, -(-(column + columns) // width)),
    ):
        offset = source.get_tag_item(f"BLOCK_OFFSET_{j}_{i}", "TIFF", bidx=band)
        size = source.get_tag_item(f"BLOCK_SIZE_{j}_{i}", "TIFF", bidx=band)
        if offset and size:
            yield f"{i}, {j}", int(offset), int(size)


def _is_sound(packed: bytes) -> bool:
    """Return whether a zlib stream ends with the checksum of its content; only a slice of it is in memory at a time."""
    unpacker = zlib.decompressobj()
    rest, went_on = packed, True
    try:
        while went_on and not unpacker.eof:
            # The last input may be taken in while there is still output to come.
            went_on = bool(unpacker.decompress(rest, _SLICE)) or bool(rest)
            rest = unpacker.unconsumed_tail
    except zlib.error:
        return False
    return unpacker.eof

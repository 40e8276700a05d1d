"""Checks of LAS and LAZ headers against the size of the file, before memory is taken."""

import os
import struct
from pathlib import Path
from typing import Any

import lazrs

from survey.core.errors import InputError

# Bytes of the longest header, and of the shortest record before and after the points.
_HEAD, _RECORD, _LATE_RECORD = 375, 54, 60
# Points that are all alike shrink to little in LAZ, but hardly to less than this share.
_LAZ_RATIO = 400
# Where the record of LAZ lists the packed items, and how many layers each kind of item has in a chunk.
_ITEMS, _LAYERED = 34, 3
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
_EXTRA_BYTES = 14


def check_claim(file: Path, n_points: int, point_bytes: int, ratio: int = 1) -> None:
    """Refuse a header that claims more points than the file can hold."""
    if n_points * max(point_bytes, 1) > file.stat().st_size * ratio:
        raise InputError(
            f"the point file {file} claims {n_points:,} points of {point_bytes} bytes but has {file.stat().st_size:,} bytes; it was cut off."
        )


def check_las_records(file: Path) -> None:
    """Refuse a header of more records (before the points, and after them in LAS 1.4) than the file has room for."""
    with file.open("rb") as stream:
        head = stream.read(_HEAD)
    if len(head) < 104:
        raise InputError(f"the point file {file} is damaged or no LAS (its header is cut off); get it again.")
    n_bytes = file.stat().st_size
    (header_bytes,) = struct.unpack_from("<H", head, 94)
    first_point, n_records = struct.unpack_from("<II", head, 96)
    claims = [header_bytes + _RECORD * n_records <= first_point <= n_bytes]
    if head[25] >= 4 and len(head) >= 247:
        first_late, n_late = struct.unpack_from("<QI", head, 235)
        claims.append(n_late == 0 or first_late + _LATE_RECORD * n_late <= n_bytes)
    if not all(claims):
        raise _too_much(file, "records")


def check_las_points(file: Path, header: Any) -> None:
    """Refuse more points, chunks or layers of packed points than the file can hold."""
    packed = bool(header.are_points_compressed)
    check_claim(file, header.point_count, header.point_format.size, _LAZ_RATIO if packed else 1)
    if not packed:
        return
    record = bytes(header.vlrs.get("LasZipVlr")[0].record_data)
    n_layers = _layers(file, record, header.point_format.size)
    with file.open("rb") as stream:
        _check_chunk_table(stream, file, header.offset_to_point_data, header.point_count)
        stream.seek(header.offset_to_point_data)
        chunks = lazrs.read_chunk_table(stream, lazrs.LazVlr(record))
        place, n_bytes = header.offset_to_point_data + 8, file.stat().st_size
        for _, chunk_bytes in chunks or ():
            if place + chunk_bytes > n_bytes:
                raise _too_much(file, "packed chunks")
            if n_layers:
                stream.seek(place + header.point_format.size + 4)
                if sum(struct.unpack(f"<{n_layers}I", stream.read(4 * n_layers))) > chunk_bytes:
                    raise _too_much(file, "packed layers")
            place += chunk_bytes


def _check_chunk_table(stream: Any, file: Path, first_point: int, n_points: int) -> None:
    """Refuse a table of more chunks than there are points; an empty one may end it."""
    stream.seek(first_point)
    (place,) = struct.unpack("<q", stream.read(8))
    if place == -1:
        stream.seek(-8, os.SEEK_END)
        (place,) = struct.unpack("<q", stream.read(8))
    stream.seek(place)
    _, n_chunks = struct.unpack("<II", stream.read(8))
    if n_chunks > n_points + 1:
        raise _too_much(file, "packed chunks")


def _layers(file: Path, record: bytes, point_bytes: int) -> int:
    """Return how many layers a chunk has (none in the older kinds); refuse items that do not make up a point."""
    (compressor,) = struct.unpack_from("<H", record)
    (n_items,) = struct.unpack_from("<H", record, _ITEMS - 2)
    items = [struct.unpack_from("<HH", record, _ITEMS + 6 * k) for k in range(n_items)]
    if sum(size for _, size in items) != point_bytes:
        raise _too_much(file, "bytes of a packed point")
    if compressor != _LAYERED:
        return 0
    return sum(size if kind == _EXTRA_BYTES else _LAYERS.get(kind, 0) for kind, size in items)


def _too_much(file: Path, what: str) -> InputError:
    return InputError(
        f"the point file {file} claims more {what} than its {file.stat().st_size:,} bytes hold; it is damaged or was cut off, get it again."
    )

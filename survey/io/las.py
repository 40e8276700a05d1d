"""LAS and LAZ point files, with checks of their headers against the size of the file before memory is taken."""

import datetime
import logging
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import laspy
import lazrs
import numpy as np
import numpy.typing as npt

from survey.core import UNSTATED, BoolArray, InputError, existing_file, refusing_damage, replacing
from survey.core.crs import vertical_datum_of
from survey.io.arrays_file import checksum, refuse_altered
from survey.io.point_table import (
    CRC,
    DATUM,
    PLACE,
    PointTable,
    add_column,
    check_claim,
    check_count,
)

GROUND, NOISE = 2, (7, 18)
"""Classes of LAS."""
# LAS stores coordinates as whole numbers of this many metres.
_LAS_STEP_M = 1e-4
_COARSE_STEP_M = 0.05
_LAS_OWNER, _LAS_DATUM, _LAS_CRC = "firnline", 1, 2


@contextmanager
def open_las(file: Path, **options: Any) -> Iterator[Any]:
    """Open an existing LAS or LAZ file whose header has been checked, and refuse a damaged one in one sentence."""
    with refusing_damage(f"the point file {file}", "LAS"):
        check_las_records(file)
        with laspy.open(file, laz_backend=laspy.LazBackend.Lazrs, **options) as reader:
            check_las_points(file, reader.header)
            yield reader


def read_las(path: Path) -> PointTable:
    """Read a LAS or LAZ file, and check its checksum where firnline wrote it."""
    file = existing_file(path, "the point file")
    with open_las(file) as reader:
        check_count(file, reader.header.point_count)
        las = reader.read()
        crs = las.header.parse_crs()
    if len(las.points) == 0:
        raise InputError(f"the point file {file} holds no points; get it again.")
    if len(las.points) != las.header.point_count:
        raise InputError(
            f"the point file {file} holds {len(las.points)} of {las.header.point_count} points; it was cut off."
        )
    columns = dict(
        zip(PLACE, (np.asarray(axis, dtype=np.float64) for axis in (las.x, las.y, las.z)), strict=True)
    )
    for name in las.point_format.extra_dimension_names:
        column = np.asarray(las[name])
        if column.ndim == 1:
            add_column(columns, name, column, file)
    _say_steps(las.header, file)
    datum = datum_of_header(las.header, crs)
    for record in las.header.vlrs:
        if record.user_id == _LAS_OWNER and record.record_id == _LAS_CRC:
            crc = record.record_data.decode("utf-8", "replace")
            refuse_altered(file, crc, columns.values(), f"its record {_LAS_OWNER} {_LAS_CRC}")
            return PointTable(columns, crs, datum)  # without classes
    return PointTable(columns, crs, datum, _is_ground(las))


def _say_steps(header: Any, file: Path) -> None:
    """Log the steps of heights that are stored as coarse numbers: a map would take them for exact."""
    step = float(header.scales[2])
    if step >= _COARSE_STEP_M:
        logging.getLogger(__name__).warning(
            "the point file %s stores heights in steps of %g, which rounds them by up to half of that; export it with finer scales.",
            file,
            step,
        )


def datum_of_header(header: Any, crs: Any) -> str:
    """Return the vertical datum that a header states: in its own record, or in its CRS."""
    for record in header.vlrs:
        if record.user_id == _LAS_OWNER and record.record_id == _LAS_DATUM:
            return str(record.record_data.decode("utf-8", "replace"))
    return UNSTATED if crs is None else vertical_datum_of(crs)


def _is_ground(las: Any) -> BoolArray | None:
    """Return which points are of the ground where it is classified, else which are no noise; None for all."""
    classes = classes_of(las)
    found: BoolArray = ~np.isin(classes, NOISE)
    if (classes == GROUND).any():
        found = classes == GROUND
    return None if found.all() else found


def classes_of(points: Any) -> npt.NDArray[np.uint8]:
    """Return the classes (N,) of points of laspy; withheld points count as noise.

    Returns (N,): as LAS numbers them.
    """
    classes: npt.NDArray[np.uint8] = np.array(points.classification, dtype=np.uint8)
    classes[np.asarray(points.withheld, dtype=np.bool_)] = NOISE[0]
    return classes


def write_las(path: Path, table: PointTable) -> None:
    """Write a LAS or LAZ file with a checksum."""
    xyz = np.column_stack([table.columns[name] for name in PLACE])
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.offsets = np.floor(xyz.min(axis=0))
    header.scales = np.full(3, _LAS_STEP_M)
    header.generating_software = _LAS_OWNER
    # A fixed day, so that equal points give equal bytes.
    header.creation_date = datetime.date(2000, 1, 1)
    header.add_crs(table.crs)
    extra = {name: column for name, column in table.columns.items() if name not in PLACE}
    header.add_extra_dims([laspy.ExtraBytesParams(name=name, type=np.float64) for name in extra])
    if table.vertical_datum:
        header.vlrs.append(laspy.VLR(_LAS_OWNER, _LAS_DATUM, DATUM, table.vertical_datum.encode("utf-8")))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    for name, column in extra.items():
        las[name] = column
    stored = [*(np.asarray(axis, dtype=np.float64) for axis in (las.x, las.y, las.z)), *extra.values()]
    las.vlrs.append(laspy.VLR(_LAS_OWNER, _LAS_CRC, CRC, checksum(stored).encode("utf-8")))
    with replacing(path) as draft:
        las.write(str(draft))


# Bytes of the longest header, and of the shortest record before and after the points.
_HEAD, _RECORD, _LATE_RECORD = 375, 54, 60
# Points that are all alike shrink to little in LAZ, but hardly to less than this share.
_LAZ_RATIO = 400
# Where the record of LAZ lists the packed items, and how many layers each kind of item has in a chunk.
_ITEMS, _LAYERED = 34, 3
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
_EXTRA_BYTES = 14


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

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
from laspy.vlrs.known import GeoAsciiParamsVlr, GeoKeyDirectoryVlr
from pyproj import CRS
from pyproj.crs import Datum  # type: ignore[attr-defined]  # pyproj lists no exports
from pyproj.database import get_units_map
from pyproj.exceptions import CRSError

from survey.core import UNSTATED, InputError, existing_file, refusing_damage, replacing
from survey.core.crs import ELLIPSOIDAL, datum_named, vertical_datum_of
from survey.core.transformation import metric_crs
from survey.io.arrays_file import checksum, refuse_altered
from survey.io.point_classes import EARLIER, SYNTHETIC, WITHHELD
from survey.io.point_table import (
    CRC,
    DATUM,
    PLACE,
    PointTable,
    add_column,
    check_claim,
    check_count,
)

# LAS stores coordinates as whole numbers of this many metres.
_LAS_STEP_M = 1e-4
_COARSE_STEP_M = 0.05
_FIRST_WITH_FLAG = 6
_LAS_OWNER, _LAS_DATUM, _LAS_CRC = "firnline", 1, 2


@contextmanager
def open_las(file: Path, **options: Any) -> Iterator[Any]:
    """Open an existing LAS or LAZ file whose header has been checked, and refuse a damaged one in one sentence."""
    with refusing_damage(f"the point file {file}", "LAS"):
        check_las_records(file)
        with laspy.open(file, laz_backend=laspy.LazBackend.Lazrs, **options) as reader:
            check_las_points(file, reader.header)
            yield reader


def read_las(path: Path, named: Any = None) -> PointTable:
    """Read a LAS or LAZ file, and check its checksum where firnline wrote it; `named` as `crs_of_header` takes it."""
    file = existing_file(path, "the point file")
    with open_las(file) as reader:
        check_count(file, reader.header.point_count)
        las = reader.read()
        crs = crs_of_header(las.header, file, named)
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
    sources = np.asarray(las.point_source_id)
    if (sources != sources[0]).any():
        columns.setdefault("strip", sources.astype(np.float64))
    _say_overlap(las, file)
    _say_steps(las.header, file)
    datum, lengths = datum_of_header(las.header, crs), lengths_of_header(las.header, file)
    for record in las.header.vlrs:
        if record.user_id == _LAS_OWNER and record.record_id == _LAS_CRC:
            crc = record.record_data.decode("utf-8", "replace")
            refuse_altered(file, crc, columns.values(), f"its record {_LAS_OWNER} {_LAS_CRC}")
            return PointTable(columns, crs, datum, lengths=lengths)  # without classes
    return PointTable(columns, crs, datum, classes_of(las), lengths)


def _say_steps(header: Any, file: Path) -> None:
    """Log the steps of heights that are stored as coarse numbers: a map would take them for exact."""
    step = float(header.scales[2])
    if step >= _COARSE_STEP_M:
        logging.getLogger(__name__).warning(
            "the point file %s stores heights in steps of %g, which rounds them by up to half of that; export it with finer scales.",
            file,
            step,
        )


def _say_overlap(points: Any, file: Path) -> None:
    """Log how many points carry the overlap flag of formats 6 to 10, which both strips may: without them the ground may have holes."""
    n = int(np.count_nonzero(points.overlap)) if points.point_format.id >= _FIRST_WITH_FLAG else 0
    if n:
        logging.getLogger(__name__).warning(
            "the point file %s flags %d of %d points as overlap; they are used, as strips that overlap may both carry the flag.",
            file,
            n,
            len(points),
        )


# Keys of GeoTIFF: projected system, its unit, vertical system, its name, datum and unit.
_SYSTEM, _PLACE_UNIT, _VERTICAL, _VERTICAL_NAME, _VERTICAL_DATUM, _HEIGHT_UNIT = (
    3072,
    3076,
    4096,
    4097,
    4098,
    4099,
)
_OWN_CODE = 32767
# Vertical systems of GeoTIFF 1.0 that count from an ellipsoid.
_ELLIPSOIDS = range(5001, 5034)


def crs_of_header(header: Any, file: Path, named: Any = None) -> Any:
    """Return the CRS that a header states, None for none; keys without a code give way to `named`, or are refused."""
    crs = header.parse_crs()
    if _geo_keys(header).get(_SYSTEM) != _OWN_CODE or not (crs is None or crs.is_geographic):
        return crs
    where = f"the point file {file} describes its CRS by GeoKeys without a code, which are not read"
    if named is None:
        raise InputError(
            f"{where}; name the CRS with --crs (crs=), or write the file with a WKT record or a code."
        )
    logging.getLogger(__name__).warning("%s; the CRS that was named, %s, is used.", where, named)
    return None


def datum_of_header(header: Any, crs: Any) -> str:
    """Return the vertical datum that a header states: in its own record, in its CRS, or in its GeoKeys."""
    for record in header.vlrs:
        if record.user_id == _LAS_OWNER and record.record_id == _LAS_DATUM:
            return str(record.record_data.decode("utf-8", "replace"))
    stated = UNSTATED if crs is None else vertical_datum_of(metric_crs(crs, "the header").crs)
    keys = _geo_keys(header)
    if stated or not {_VERTICAL, _VERTICAL_DATUM} & set(keys):
        return stated
    if keys.get(_VERTICAL) in _ELLIPSOIDS:
        return ELLIPSOIDAL
    vertical = _vertical_crs(keys)
    name = vertical.name if vertical is not None else str(keys.get(_VERTICAL_NAME, ""))
    return datum_named(name) or _datum_of_code(keys.get(_VERTICAL_DATUM, keys.get(_VERTICAL)))


def _datum_of_code(code: Any) -> str:
    try:
        return datum_named(Datum.from_epsg(code).name)
    except CRSError:
        return UNSTATED


def _vertical_crs(keys: dict[int, Any]) -> CRS | None:
    """Return the vertical system that the keys name by its code."""
    try:
        found = CRS.from_epsg(keys.get(_VERTICAL, 0))
    except CRSError:
        return None
    return found if found.is_vertical else None


def lengths_of_header(header: Any, file: Path) -> dict[str, float]:
    """Return the metres in a unit of eastings, northings and heights, by column, as far as GeoKeys state them."""
    if any(record.user_id == _LAS_OWNER for record in header.vlrs):
        return dict.fromkeys(PLACE, 1.0)
    keys = _geo_keys(header)
    vertical = _vertical_crs(keys)
    found = {axis: _metres_of(keys[_PLACE_UNIT], file) for axis in PLACE[:2] if _PLACE_UNIT in keys}
    if _HEIGHT_UNIT in keys:
        found[PLACE[2]] = _metres_of(keys[_HEIGHT_UNIT], file)
    elif vertical is not None:
        found[PLACE[2]] = float(vertical.axis_info[0].unit_conversion_factor)
    return found


def _metres_of(code: Any, file: Path) -> float:
    """Return the metres in a unit by its code in the register of EPSG."""
    units = get_units_map(auth_name="EPSG", category="linear", allow_deprecated=True)
    metres = next((float(unit.conv_factor) for unit in units.values() if unit.code == str(code)), None)
    if metres is None:
        raise InputError(
            f"the point file {file} states the unit of length {code} in its GeoKeys, which is none of EPSG; correct its header "
            "(las2las, pdal) or export it again."
        )
    return metres


def _geo_keys(header: Any) -> dict[int, Any]:
    """Return the GeoKeys of a header by number: short numbers, and texts."""
    records = [*header.vlrs, *(header.evlrs or ())]
    texts: Any = next((r.strings for r in records if isinstance(r, GeoAsciiParamsVlr)), [])
    text = "".join(texts) if isinstance(texts, list) else str(texts)
    found: dict[int, Any] = {}
    for key in (key for r in records if isinstance(r, GeoKeyDirectoryVlr) for key in r.geo_keys):
        if key.tiff_tag_location == 0:
            found[key.id] = key.value_offset
        elif key.id == _VERTICAL_NAME:
            found[key.id] = text[key.value_offset : key.value_offset + key.count].strip("|\0 ")
    return found


def classes_of(points: Any) -> npt.NDArray[np.uint16]:
    """Return the classes (N,) of points of laspy, with the codes of `survey.io.point_classes` for flags and earlier returns.

    Where all points are synthetic, as those of photogrammetry may be, that flag states nothing about one of them.
    """
    classes: npt.NDArray[np.uint16] = np.array(points.classification, dtype=np.uint16)
    is_earlier = np.asarray(points.return_number) < np.asarray(points.number_of_returns)
    classes[is_earlier & (classes <= 1)] = EARLIER
    is_synthetic = np.asarray(points.synthetic, dtype=np.bool_)
    if not is_synthetic.all():
        classes[is_synthetic] = SYNTHETIC
    classes[np.asarray(points.withheld, dtype=np.bool_)] = WITHHELD
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

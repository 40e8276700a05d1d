"""Point files: CSV, GeoPackage, LAS/LAZ and PLY, as named columns of numbers."""

import datetime
import struct
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import laspy
import lazrs
import numpy as np
import plyfile
import shapely
from pyproj import CRS
from pyproj.exceptions import CRSError

from survey.core.arrays import FloatArray
from survey.core.checksum import checksum, refuse_altered
from survey.core.crs.checks import crs_text
from survey.core.crs.vertical_datum import UNSTATED, vertical_datum_of
from survey.core.errors import CapacityError, InputError
from survey.core.files.library_messages import first_line
from survey.core.files.reading import existing_file
from survey.core.files.writing import replacing
from survey.io.las_header import check_claim, check_las_points, check_las_records
from survey.io.point_columns import PLACE, in_own_columns
from survey.io.tables import read_table, write_table
from survey.io.vector import read_features, write_features

LARGEST_POINTS = 30_000_000
"""Most points that are read at once: some 3 GB from LAS with its attributes."""
_DATUM = "vertical_datum"
# LAS stores coordinates as whole numbers of this many metres.
_LAS_STEP_M = 1e-4
_LAS_OWNER, _LAS_DATUM, _LAS_CRC = "firnline", 1, 2
_CRC = "crc32"
_PLY_HEAD = 65_536
# Coordinates that stand in a file twice may be rounded once.
_SAME_PLACE_M = 0.01
# No coordinate, covariance or temperature is larger; what is comes of flipped bits.
_LARGEST = 1e15
_LAS_FAULTS = (
    laspy.errors.LaspyException,
    lazrs.LazrsError,
    CRSError,
    ValueError,
    RuntimeError,
    struct.error,
    OSError,
    MemoryError,
    ArithmeticError,
    KeyError,
    IndexError,
    TypeError,
)


class PointTable(NamedTuple):
    """Columns of equal length, ``x_m``, ``y_m`` and ``z_m`` among them; CRS and datum where the file names them."""

    columns: dict[str, FloatArray]
    crs: Any = None
    vertical_datum: str = UNSTATED


def read_point_table(path: str | Path) -> PointTable:
    """Read the format that the file's ending names.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.

    Returns
    -------
    PointTable
        Columns of numbers, with CRS and vertical datum where the file names them.

    Raises
    ------
    InputError
        Another ending; a file that is missing, empty or damaged; a column that is missing
        or holds something that is no number.
    """
    table = _format(path).read(Path(path))
    for name, column in table.columns.items():
        if (np.abs(column) > _LARGEST).any():
            raise InputError(
                f"the point file {path} holds {np.abs(column).max():.3g} in {name}; it is damaged, get it again."
            )
    return table


def write_point_table(path: str | Path, table: PointTable) -> None:
    """Write the format that the file's ending names, or leave what was there; equal tables give equal bytes.

    CSV carries no CRS. LAS and LAZ round coordinates to 0.1 mm; the others are exact.

    Parameters
    ----------
    path : str or pathlib.Path
        The file; its suffix names the format.
    table : PointTable
        The points; LAS, PLY and vector formats need a CRS.
    """
    _format(path).write(Path(path), table)


class _Format(NamedTuple):
    read: Callable[[Path], PointTable]
    write: Callable[[Path, PointTable], None]


def _format(path: str | Path) -> _Format:
    suffix = Path(path).suffix.lower()
    if suffix not in _FORMATS:
        raise InputError(
            f"{Path(path).name} ends in {suffix!r}; one of {', '.join(sorted(_FORMATS))} was expected."
        )
    return _FORMATS[suffix]


def _read_csv(path: Path) -> PointTable:
    return PointTable(*in_own_columns(read_table(path, (), what="the point file"), f"the point file {path}"))


def _write_csv(path: Path, table: PointTable) -> None:
    write_table(path, table.columns)


def _read_vector(path: Path) -> PointTable:
    features = read_features(path, what="the point file")
    kinds = {shape.geom_type if shape is not None else "nothing" for shape in features.geometry}
    if kinds != {"Point"}:
        raise InputError(
            f"the point file {path} holds {', '.join(sorted(kinds))}; single points were expected."
        )
    if not shapely.has_z(features.geometry).all():
        raise InputError(
            f"the point file {path} holds points without a height; save them as points with z (PointZ)."
        )
    xyz = shapely.get_coordinates(features.geometry, include_z=True)
    attributes = dict(features.attributes)
    datum = attributes.pop(_DATUM, None)
    columns = dict(zip(PLACE, xyz.T, strict=True))
    for name, column in attributes.items():
        if np.issubdtype(column.dtype, np.number):
            _add_column(columns, name, column, path)
    crs = features.crs
    stated = str(datum[0]) if datum is not None and datum[0] else vertical_datum_of(crs) if crs else UNSTATED
    return PointTable(columns, crs, stated)


def _add_column(columns: dict[str, FloatArray], name: str, values: Any, path: Path) -> None:
    """Add a column; one that is named like a coordinate and says something else is refused."""
    numbers: FloatArray = np.asarray(values).astype(np.float64)
    if name not in columns:
        columns[name] = numbers
    elif not np.allclose(numbers, columns[name], rtol=0.0, atol=_SAME_PLACE_M):
        raise InputError(
            f"the point file {path} has a column {name} that differs from the points' own coordinates; rename or remove it."
        )


def _write_vector(path: Path, table: PointTable) -> None:
    shapes = shapely.points(np.column_stack([table.columns[name] for name in PLACE]))
    attributes: dict[str, Any] = {n: c for n, c in table.columns.items() if n not in PLACE}
    if table.vertical_datum:
        attributes[_DATUM] = np.full(len(shapes), table.vertical_datum, dtype=object)
    write_features(path, shapes, attributes, table.crs, layer="surface_points")


def _read_las(path: Path) -> PointTable:
    file = existing_file(path, "the point file")
    try:
        check_las_records(file)
        # One thread: the same work in the same order.
        with laspy.open(file, laz_backend=laspy.LazBackend.Lazrs) as reader:
            check_las_points(file, reader.header)
            _check_count(file, reader.header.point_count)
            las = reader.read()
        crs = las.header.parse_crs()
    except InputError:
        raise
    except _LAS_FAULTS as error:
        raise _damaged(file, "LAS", error) from error
    except BaseException as error:
        # The decompressor's Rust panics derive from no Exception and have no name to import.
        if type(error).__name__ != "PanicException":
            raise
        raise _damaged(file, "LAS", error) from error
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
            _add_column(columns, name, column, file)
    datum = vertical_datum_of(crs) if crs is not None else UNSTATED
    for record in las.header.vlrs:
        if record.user_id == _LAS_OWNER and record.record_id == _LAS_DATUM:
            datum = record.record_data.decode("utf-8", "replace")
        elif record.user_id == _LAS_OWNER and record.record_id == _LAS_CRC:
            crc = record.record_data.decode("utf-8", "replace")
            refuse_altered(file, crc, columns.values(), f"its record {_LAS_OWNER} {_LAS_CRC}")
    return PointTable(columns, crs, datum)


def _write_las(path: Path, table: PointTable) -> None:
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
        header.vlrs.append(laspy.VLR(_LAS_OWNER, _LAS_DATUM, _DATUM, table.vertical_datum.encode("utf-8")))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    for name, column in extra.items():
        las[name] = column
    stored = [*(np.asarray(axis, dtype=np.float64) for axis in (las.x, las.y, las.z)), *extra.values()]
    las.vlrs.append(laspy.VLR(_LAS_OWNER, _LAS_CRC, _CRC, checksum(stored).encode("utf-8")))
    with replacing(path) as draft:
        las.write(str(draft))


def _read_ply(path: Path) -> PointTable:
    file = existing_file(path, "the point file")
    _check_ply_claim(file)
    try:
        ply = plyfile.PlyData.read(str(file))
        vertices = ply["vertex"].data
    except (
        plyfile.PlyParseError,
        KeyError,
        ValueError,
        MemoryError,
        OverflowError,
        TypeError,
        IndexError,
    ) as error:
        raise _damaged(file, "PLY", error) from error
    missing = {"x", "y", "z"} - set(vertices.dtype.names)
    if missing:
        raise InputError(
            f"the point file {file} has vertices without {', '.join(sorted(missing))}; get it again."
        )
    columns = dict(zip(PLACE, (vertices[axis].astype(np.float64) for axis in "xyz"), strict=True))
    for name in vertices.dtype.names:
        if name not in "xyz" and np.issubdtype(vertices.dtype[name], np.number):
            _add_column(columns, name, vertices[name], file)
    stated = dict(comment.split(" ", 1) for comment in ply.comments if " " in comment)
    if _CRC in stated:
        refuse_altered(file, stated[_CRC], [vertices], f"its comment {_CRC}")
    return PointTable(columns, stated.get("crs"), stated.get(_DATUM, UNSTATED))


def _write_ply(path: Path, table: PointTable) -> None:
    names = {**dict(zip(PLACE, "xyz", strict=True))}
    fields = [(names.get(name, name), "<f8") for name in table.columns]
    vertices = np.empty(len(table.columns["x_m"]), dtype=fields)
    for name, column in table.columns.items():
        vertices[names.get(name, name)] = column
    crs: CRS = table.crs
    comments = [f"crs {crs_text(crs)}", f"{_CRC} {checksum([vertices])}"]
    if table.vertical_datum:
        comments.append(f"{_DATUM} {table.vertical_datum}")
    element = plyfile.PlyElement.describe(vertices, "vertex")
    with replacing(path) as draft:
        plyfile.PlyData([element], text=False, byte_order="<", comments=comments).write(str(draft))


def _check_ply_claim(file: Path) -> None:
    """Refuse a header of more rows than the file has bytes."""
    with file.open("rb") as stream:
        head = stream.read(_PLY_HEAD).split(b"end_header")[0]
    for line in head.splitlines():
        words = line.split()
        if words[:1] == [b"element"] and len(words) == 3 and words[2].isdigit():
            check_claim(file, int(words[2]), 1)
            _check_count(file, int(words[2]))


def _check_count(file: Path, n_points: int) -> None:
    if n_points > LARGEST_POINTS:
        raise CapacityError(
            f"the point file {file} has {n_points:,} points; {LARGEST_POINTS:,} can be read at once, cut it into tiles or thin it."
        )


def _damaged(file: Path, kind: str, error: BaseException) -> InputError:
    return InputError(f"the point file {file} is damaged or no {kind} ({first_line(error)}); get it again.")


_FORMATS: Mapping[str, _Format] = {
    ".csv": _Format(_read_csv, _write_csv),
    ".gpkg": _Format(_read_vector, _write_vector),
    ".geojson": _Format(_read_vector, _write_vector),
    ".las": _Format(_read_las, _write_las),
    ".laz": _Format(_read_las, _write_las),
    ".ply": _Format(_read_ply, _write_ply),
}

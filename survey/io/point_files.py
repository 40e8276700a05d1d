"""Point files as tables of points: text, vector files, PLY, LAS and LAZ.

`read_point_table` and `write_point_table` choose the format by the file's ending; `read_named_points` reads a name for each
point too, such as those of surveyed marks. Numbers that stand for missing ones, heights beyond all ground on Earth and
damaged files are refused. CSV carries no CRS. LAS and LAZ stand in `survey.io.las`, which loads laspy; files beyond the
memory are read by `survey.io.point_chunks`.
"""

import logging
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from pyproj import CRS

from survey.core import UNSTATED, FloatArray, InputError, existing_file, refusing_damage, replacing
from survey.core.crs import crs_text, vertical_datum_of
from survey.io.arrays_file import checksum, refuse_altered
from survey.io.column_names import (
    ColumnNames,
    at_positions,
    axis_of,
    datum_of_column,
    last_position,
    log_columns,
    one_column,
    rename_header,
    spelled,
)
from survey.io.ply import PlyError, read_header, read_vertices, write_vertices
from survey.io.point_table import (
    CRC,
    DATUM,
    PLACE,
    SIGMA,
    PointTable,
    add_column,
    check_claim,
    check_count,
    in_own_columns,
    place_columns,
    stated_lengths,
    table_in_metres,
)
from survey.io.raster.values import HIGHEST_M, LARGEST, LOWEST_M, MARKS, MARKS_IN_METRES
from survey.io.tables import is_number, read_table, write_table
from survey.io.text_tables import LARGEST_BYTES, TextTable, read_text_table, refuse_hemispheres
from survey.io.vector import read_features, write_features

_WHAT = "the point file"
# Columns of a file .xyz, which has no header as a rule.
_UNNAMED = ("x", "y", "z")
# A coordinate of 100 km or more with at most four digits, and how many rows are looked at.
_SHORTENED = re.compile(r"(?<![\d.])\d([.,]\d{1,3})?E\+0*[5-9](?!\d)", re.IGNORECASE)
_N_LOOKED_AT = 50
# Digits with separators of thousands, in cells that commas part.
_SEPARATED = re.compile(rb"\d('|\xe2\x80\x99)\d|\"[+-]?\d{1,3},\d{3}")


def read_csv(path: Path, columns: Mapping[str, str] | None = None) -> PointTable:
    """Read a table of points: commas between numbers, or the export of another program with its usual names.

    `columns` names columns of the file by own name, such as ``{"z_m": "Ellipsoidal height"}``.
    """
    file = existing_file(path, _WHAT)
    _refuse_shortened(file)
    if path.suffix.lower() == ".xyz":
        return _read_export(file, columns or {}, _UNNAMED)
    if not columns and _is_plain(file):
        return in_own_columns(read_table(file, (), what=_WHAT), f"{_WHAT} {path}")
    return _read_export(file, columns or {})


def _refuse_shortened(file: Path) -> None:
    """Refuse coordinates such as 5.00E+05, as a spreadsheet shows and exports them in narrow columns."""
    with file.open(encoding="utf-8", errors="replace") as stream:
        first = [line for line in islice(stream, 1, 1 + _N_LOOKED_AT) if line.strip()]
    if len(first) > 1 and all(map(_SHORTENED.search, first)):
        shown = _SHORTENED.search(first[0])
        assert shown is not None
        raise InputError(
            f"{_WHAT} {file} holds coordinates that were shortened in all rows ({shown.group()}); "
            "export it again with the columns formatted as numbers."
        )


def write_csv(path: Path, table: PointTable) -> None:
    """Write a CSV table of points."""
    write_table(path, table.columns)


def _is_plain(file: Path) -> bool:
    """Return whether a table has firnline's own columns, or commas, numbers alone and no standard deviation."""
    content = file.read_bytes() if file.stat().st_size <= LARGEST_BYTES else b""
    # Single bytes are found many times faster than the pattern, which most tables do not hold.
    if any(mark in content for mark in (b"'", b"\xe2", b'"')) and _SEPARATED.search(content):
        return False
    with file.open(encoding="utf-8-sig", errors="replace") as stream:
        header, first = stream.readline(), stream.readline()
    if "\ufffd" in header:  # another encoding
        return False
    names = {name.strip() for name in header.split(",")}
    if set(PLACE) <= names or not first.strip():
        return True
    has_sigma = any(spelled(name, "sigma_z") for name in names)
    return "," in header and not has_sigma and all(map(is_number, first.split(",")))


def _read_export(file: Path, given: Mapping[str, str], unnamed: Sequence[str] = ()) -> PointTable:
    """Read the columns of numbers; those that begin with a text, such as codes, are passed over and named in the log."""
    text = read_text_table(file, _WHAT, unnamed, width=last_position(given))
    given = {own: name for own, name in at_positions(given, text.header).items() if own != _NAME}
    known = dict(zip(text.header, rename_header(text.header, given, text.where), strict=True))
    sigma = one_column("sigma_z", list(known.values()), text.where)
    asked = {*given, sigma}
    names = {
        name: own for name, own in known.items() if own in asked or text.is_number(name, 0, axis_of(own))
    }
    names = {name: SIGMA if own == sigma else own for name, own in names.items()}
    numbers = {own: text.numbers(name, axis_of(own)) for name, own in names.items()}
    unused = tuple(name for name in text.header if name not in names)
    log_columns(text.where, ColumnNames({own: name for name, own in names.items()}, unused))
    _refuse_places_of_text(text, known, set(numbers))
    table = in_own_columns(numbers, text.where, {own: name for name, own in names.items()})
    if table.crs is not None:
        refuse_hemispheres(text, *(table.columns[name] for name in PLACE[:2]))
    return table


def _refuse_places_of_text(text: TextTable, known: Mapping[str, str], numbers: set[str]) -> None:
    """Refuse coordinates that begin with a text by their line: a unit, or thousands with separators."""
    try:
        place_columns(list(numbers), text.where)
    except InputError:
        names = place_columns(list(known.values()), text.where).names
        for name in (name for name, own in known.items() if own in names):
            text.numbers(name, axis_of(known[name]))


VECTOR_ENDINGS = (".gpkg", ".geojson", ".json", ".shp", ".fgb")
"""Endings of vector files that points are read from."""
_HEIGHT = PLACE[2]

Attributes = dict[str, npt.NDArray[Any]]


def read_vector(path: Path, columns: Mapping[str, str] | None = None) -> PointTable:
    """Read points from a vector file; `columns` names attributes by own name, such as ``{"z_m": "Elevation"}``."""
    features, where = read_features(path, what=_WHAT), f"{_WHAT} {path}"
    _refuse_other_shapes(features.geometry, where)
    attributes = dict(features.attributes)
    datum = attributes.pop(DATUM, None)
    names = _used_attributes(attributes, columns or {}, features.geometry, where)
    xyz = shapely.get_coordinates(features.geometry, include_z=True)
    found = dict(zip(PLACE, xyz.T, strict=True))
    found |= {own: _numbers(attributes, name, where) for own, name in names.items()}
    for name, column in attributes.items():
        if name not in {*names, *names.values()} and np.issubdtype(column.dtype, np.number):
            add_column(found, name, column, path)
    log_columns(where, ColumnNames(names))
    crs = features.crs
    stated = str(datum[0]) if datum is not None and datum[0] else vertical_datum_of(crs) if crs else UNSTATED
    stated = stated or datum_of_column(names.get(_HEIGHT, ""))
    return PointTable(found, crs, stated, lengths=stated_lengths(names))


def write_vector(path: Path, table: PointTable) -> None:
    """Write points to a GeoPackage or GeoJSON file."""
    shapes = shapely.points(np.column_stack([table.columns[name] for name in PLACE]))
    attributes: dict[str, Any] = {n: c for n, c in table.columns.items() if n not in PLACE}
    if table.vertical_datum:
        attributes[DATUM] = np.full(len(shapes), table.vertical_datum, dtype=object)
    write_features(path, shapes, attributes, table.crs, layer="surface_points")


def _refuse_other_shapes(geometry: npt.NDArray[Any], where: str) -> None:
    kinds = {shape.geom_type if shape is not None else "nothing" for shape in geometry}
    if kinds != {"Point"}:
        raise InputError(f"{where} holds {', '.join(sorted(kinds))}; single points were expected.")


def _used_attributes(
    attributes: Attributes, given: Mapping[str, str], geometry: npt.NDArray[Any], where: str
) -> dict[str, str]:
    """Return the attributes that are read by own name: those that were chosen, and usual ones of heights and their errors."""
    chosen = next((key for key in given if key not in (_HEIGHT, SIGMA)), None)
    if chosen is not None:
        raise InputError(
            f"{where} has its places in its geometry, and {chosen} was chosen from the attribute {given[chosen]}; "
            "choose z and sigma_z alone."
        )
    header = list(attributes)
    rename_header(header, given, where)
    found = {
        _HEIGHT: given.get(_HEIGHT) or _height(attributes, shapely.get_z(geometry), where),
        SIGMA: given.get(SIGMA) or one_column("sigma_z", header, where),
    }
    return {own: name for own, name in found.items() if name is not None}


def _height(attributes: Attributes, z: FloatArray, where: str) -> str | None:
    """Return the attribute of heights where the geometry has none, and None where it has them."""
    if np.isfinite(z).all():
        _refuse_flat_geometry(z, attributes, where)
        return None
    height = one_column("height", list(attributes), where)
    if height is None:
        raise InputError(
            f"{where} holds points without a height; save them as points with z (PointZ), or choose the attribute "
            "that holds it with --columns z=NAME."
        )
    return height


def _refuse_flat_geometry(z: FloatArray, attributes: Attributes, where: str) -> None:
    """Refuse heights of 0 throughout beside an attribute of heights; a GIS writes them where it has none."""
    if z.any():
        return
    height = one_column("height", list(attributes), where)
    if height is not None and np.any(_numbers(attributes, height, where)):
        raise InputError(
            f"{where} has heights of 0 in its geometry and others in the attribute {height}; choose these with "
            f"--columns z={height}, or remove the attribute."
        )


def _numbers(attributes: Attributes, name: str, where: str) -> FloatArray:
    """Return an attribute of numbers."""
    if not np.issubdtype(attributes[name].dtype, np.number):
        raise InputError(
            f"{where} has text in the attribute {name}; numbers were expected, convert it in a GIS."
        )
    return np.asarray(attributes[name], dtype=np.float64)


_COARSE_M = 0.01


def read_ply(path: Path) -> PointTable:
    """Read a PLY file, and check its checksum where firnline wrote it."""
    file = existing_file(path, _WHAT)
    with refusing_damage(f"the point file {file}", "PLY"):
        for element in read_header(file).elements:
            check_claim(file, element.n_rows, 1)
            check_count(file, element.n_rows)
        vertices, comments = read_vertices(file)
    names = vertices.dtype.names or ()
    missing = {"x", "y", "z"} - set(names)
    if missing:
        raise InputError(
            f"the point file {file} has vertices without {', '.join(sorted(missing))}; get it again."
        )
    columns = dict(zip(PLACE, (vertices[axis].astype(np.float64) for axis in "xyz"), strict=True))
    _say_rounded(file, vertices)
    for name in names:
        if name not in "xyz":
            add_column(columns, name, vertices[name], file)
    stated = dict(comment.split(" ", 1) for comment in comments if " " in comment)
    if CRC in stated:
        refuse_altered(file, stated[CRC], [vertices], f"its comment {CRC}")
    own = dict.fromkeys(PLACE, 1.0) if CRC in stated else {}
    return PointTable(columns, stated.get("crs"), stated.get(DATUM, UNSTATED), lengths=own)


def write_ply(path: Path, table: PointTable) -> None:
    """Write a binary PLY file with a checksum."""
    names = dict(zip(PLACE, "xyz", strict=True))
    fields = [(names.get(name, name), "<f8") for name in table.columns]
    vertices = np.empty(len(table.columns["x_m"]), dtype=fields)
    for name, column in table.columns.items():
        vertices[names.get(name, name)] = column
    crs: CRS = table.crs
    comments = [f"crs {crs_text(crs)}", f"{CRC} {checksum([vertices])}"]
    if table.vertical_datum:
        comments.append(f"{DATUM} {table.vertical_datum}")
    with replacing(path) as draft:
        try:
            write_vertices(draft, vertices, comments)
        except PlyError as error:
            raise InputError(
                f"{path} cannot be written as PLY ({error}); write GeoPackage (.gpkg), or rename the column."
            ) from error


def _say_rounded(file: Path, vertices: npt.NDArray[np.void]) -> None:
    """Log how far coordinates are rounded, where numbers of 32 bits are too short for them."""
    axes = [vertices[axis] for axis in "xyz" if vertices.dtype[axis].str[1:] == "f4"]
    step_m = max((float(np.spacing(np.abs(axis).max(initial=0.0))) for axis in axes), default=0.0)
    if step_m > _COARSE_M:
        logging.getLogger(__name__).warning(
            "the point file %s stores coordinates in 32 bits, which rounds them to %.3g m; export it with properties of the "
            "type double.",
            file,
            step_m,
        )


# No coordinate, covariance or temperature is larger; what is comes of flipped bits.
# Heights beside those of 0 that show these for missing ones, and the least distance between both [m].
_N_OTHERS, _LEAST_GAP_M = 5, 20.0
_TEXT_TABLES = (".csv", ".txt", ".tsv", ".xyz")
TABLES = (*_TEXT_TABLES, *VECTOR_ENDINGS)
"""Endings of files with one row for each point, whose columns can be chosen."""


def read_point_table(
    path: str | Path, columns: Mapping[str, str] | None = None, *, crs: Any = None, units: str | None = None
) -> PointTable:
    """Read the format that the file's ending names, in metres.

    `crs`: CRS of a file that states none, by whose unit its places are converted. `units`: ``m``, ``ft`` or ``us-ft``, for
    heights whose file states no unit.
    """
    table = _read(Path(path), columns, crs)
    for name, column in table.columns.items():
        if (np.abs(column) > LARGEST).any():
            raise InputError(
                f"the point file {path} holds {np.abs(column).max():.3g} in {name}; it is damaged, get it again."
            )
    return _checked_heights(table, crs, units, path)


def _checked_heights(table: PointTable, crs: Any, units: str | None, path: str | Path) -> PointTable:
    """Return a table in metres; refuse numbers that stand for missing ones, as stored, and impossible heights."""
    refuse_marks(table, path)
    converted = table_in_metres(table, crs, units, f"the point file {path}")
    if converted.columns[PLACE[2]] is table.columns[PLACE[2]]:
        _refuse_numbers(MARKS_IN_METRES, table.columns[PLACE[2]], PLACE[2], path)
    _refuse_impossible(converted.columns[PLACE[2]], path)
    return converted


def _read(path: Path, columns: Mapping[str, str] | None, crs: Any) -> PointTable:
    """Read a table with the columns that were named, or a cloud with its own."""
    suffix = _ending(path, READ_ENDINGS)
    if suffix in _TEXT_TABLES:
        return read_csv(path, columns)
    if suffix in VECTOR_ENDINGS:
        return read_vector(path, columns)
    if columns:
        raise InputError(
            f"{path} is no table, whose columns can be chosen; leave the mapping of columns out, or export it as CSV."
        )
    return _with_usual_sigma(read_ply(path) if suffix == ".ply" else _read_las(path, crs), path)


def _with_usual_sigma(table: PointTable, path: Path) -> PointTable:
    """Give the standard deviation of heights its own name, where the file has a usual one."""
    name = one_column("sigma_z", list(table.columns), f"the point file {path}")
    if name is None or name == SIGMA:
        return table
    columns = {key: column for key, column in table.columns.items() if key != name}
    log_columns(f"the point file {path}", ColumnNames({SIGMA: name}))
    lengths = {**table.lengths, **stated_lengths({SIGMA: name})}
    return table._replace(columns={**columns, SIGMA: table.columns[name]}, lengths=lengths)


def refuse_marks(table: PointTable, path: str | Path) -> None:
    """Refuse numbers that stand for a missing one in a column of heights or of sampled values."""
    _refuse_zeros(table.columns[PLACE[2]], path)
    for name, column in table.columns.items():
        if name not in PLACE[:2]:
            _refuse_numbers(MARKS, column, name, path)


def _refuse_numbers(marks: Sequence[float], column: FloatArray, name: str, path: str | Path) -> None:
    found = next((mark for mark in marks if (column == mark).any()), None)
    if found is not None:
        raise InputError(
            f"the point file {path} holds {found:g} in {name}, first at point {int(np.argmax(column == found)) + 1}, which stands for a missing "
            "number; remove those rows."
        )


def _refuse_zeros(height_m: FloatArray, path: str | Path) -> None:
    """Refuse heights of exactly 0 that lie farther from the others than those lie apart."""
    is_zero = height_m == 0.0
    others = height_m[~is_zero & np.isfinite(height_m)]
    if not is_zero.any() or len(others) < max(_N_OTHERS, int(is_zero.sum())):
        return
    gap_m = float(np.abs(others).min())
    if gap_m > max(float(np.ptp(others)), _LEAST_GAP_M):
        raise InputError(
            f"the point file {path} holds heights of 0 in {int(is_zero.sum())} rows, first at point {int(np.argmax(is_zero)) + 1}, and all "
            f"others lie between {others.min():g} and {others.max():g} m; remove those rows, where 0 stands for a missing number."
        )


def _refuse_impossible(height_m: FloatArray, path: str | Path) -> None:
    """Refuse heights that are all beyond any ground on Earth, as eastings in the column of heights or millimetres are."""
    known = height_m[np.isfinite(height_m)]
    if known.size and (known.min() > HIGHEST_M or known.max() < LOWEST_M):
        raise InputError(
            f"the point file {path} holds heights between {known.min():g} and {known.max():g} m, beyond all ground on Earth; "
            "choose the column of heights with --columns z=NAME, or name their unit with --units."
        )


def write_point_table(path: str | Path, table: PointTable) -> None:
    """Write the format that the file's ending names, or leave what was there; equal tables give equal bytes.

    CSV carries no CRS. LAS and LAZ round coordinates to 0.1 mm; the others are exact.
    """
    WRITERS[_ending(path, WRITERS)](Path(path), table)


def _ending(path: str | Path, known: Collection[str]) -> str:
    """Return the ending of a file, which has to be one of those that are known."""
    suffix = Path(path).suffix.lower()
    if suffix not in known:
        raise InputError(
            f"{Path(path).name} ends in {suffix!r}; one of {', '.join(sorted(known))} was expected."
        )
    return suffix


def _read_las(path: Path, crs: Any) -> PointTable:
    from survey.io.las import read_las  # here: laspy imports a client of the web

    return read_las(path, crs)


def _write_las(path: Path, table: PointTable) -> None:
    from survey.io.las import write_las

    write_las(path, table)


_CLOUDS = (".las", ".laz", ".ply")
WRITERS: Mapping[str, Callable[[Path, PointTable], None]] = {
    ".csv": write_csv,
    ".gpkg": write_vector,
    ".geojson": write_vector,
    ".las": _write_las,
    ".laz": _write_las,
    ".ply": write_ply,
}
"""Writer for each ending of a point file."""
READ_ENDINGS = (*TABLES, *_CLOUDS)
"""Endings of point files that are read."""


_NAME = "name"
_TABLES = (".csv", ".txt", ".tsv")


class NamedPoints(NamedTuple):
    """Columns of numbers, and a name for each row (empty where the file gives none)."""

    table: PointTable
    names: tuple[str, ...]


def read_named_points(
    path: str | Path,
    what: str,
    columns: Mapping[str, str] | None = None,
    *,
    crs: Any = None,
    units: str | None = None,
) -> NamedPoints:
    """Read points with names from tables of text, GPX (way points), or any format of points.

    Tables may have commas, semicolons or tabs between cells, decimal commas, and the usual names of columns
    (``Point, Easting, Northing, Elevation, SDH, SDV``); where they are not firnline's own, the log states which
    were read. Columns of text, such as codes, are passed over. Places and heights come in metres, as `read_point_table`
    converts them.
    """
    file = existing_file(path, what)
    suffix = file.suffix.lower()
    if suffix in _TABLES:
        given = columns or {}
        table, names = _table(read_text_table(file, what, width=last_position(given)), given)
        table = _checked_heights(table, crs, units, file)
    elif suffix == ".gpx":
        table, names = _gpx(file, what)
    else:
        table = read_point_table(file, columns, crs=crs, units=units)
        names = _feature_names(file, what) if suffix in VECTOR_ENDINGS else ()
    if len(set(names)) < len(names) or "" in names:
        repeated = sorted({name for name in names if names.count(name) > 1 or not name})
        raise InputError(
            f"{what} {file} names several points {repeated[0]!r}; give every point a name of its own."
        )
    return NamedPoints(table, names)


def _table(text: TextTable, given: Mapping[str, str]) -> tuple[PointTable, tuple[str, ...]]:
    """Return places, standard deviations and marks of a table, with the names of its points."""
    given = at_positions(given, text.header)
    original = dict(zip(rename_header(text.header, given, text.where), text.header, strict=True))
    used = _used_columns(list(original), text.where)
    numbers = {own: text.numbers(original[name], axis_of(own)) for own, name in used.items() if own != _NAME}
    names = text.texts(original[used[_NAME]]) if _NAME in used else ()
    read = {own: original[name] for own, name in used.items()}
    log_columns(text.where, ColumnNames(read, tuple(n for n in text.header if n not in read.values())))
    table = in_own_columns(numbers, text.where, read)
    if table.crs is not None:
        refuse_hemispheres(text, *(table.columns[name] for name in PLACE[:2]))
    return table, names


def _used_columns(header: list[str], where: str) -> dict[str, str]:
    """Return the columns that are read: places, then the others by own name."""
    places = place_columns(header, where)
    own = ("longitude_deg", "latitude_deg", PLACE[2]) if places.is_geographic else PLACE
    found = {
        _NAME: one_column("name", header, where),
        "sigma_z_m": one_column("sigma_z", header, where),
        "vegetated": one_column("vegetated", header, where),
        "control": one_column("control", header, where),
        "map_x_m": one_column("map_x", header, where),
        "map_y_m": one_column("map_y", header, where),
    }
    if found["map_x_m"] is not None:
        found["sigma_xy_m"] = one_column("sigma_xy", header, where)
    others = {key: name for key, name in found.items() if name is not None}
    return {**dict(zip(own, places.names, strict=True)), **others}


def _gpx(file: Path, what: str) -> tuple[PointTable, tuple[str, ...]]:
    """Read way points; heights of GPX files say not what they count from."""
    features = read_features(file, layer="waypoints", what=what)
    heights = features.attributes.get("ele")
    if heights is None or not np.isfinite(np.asarray(heights, dtype=np.float64)).all():
        raise InputError(f"{what} {file} holds way points without <ele>; heights are needed.")
    xy = shapely.get_coordinates(features.geometry)
    places = np.column_stack([xy, np.asarray(heights, dtype=np.float64)])
    table = PointTable(dict(zip(PLACE, places.T, strict=True)), CRS.from_epsg(4326), UNSTATED)
    return table, _texts(features.attributes.get(_NAME))


def _feature_names(file: Path, what: str) -> tuple[str, ...]:
    return _texts(read_features(file, what=what).attributes.get(_NAME))


def _texts(column: object) -> tuple[str, ...]:
    if column is None:
        return ()
    values = np.asarray(column, dtype=object)
    if all(value is None for value in values):
        return ()
    return tuple("" if value is None else str(value).strip() for value in values)

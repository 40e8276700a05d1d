"""Named points, such as surveyed marks: read places, numbers and a name for each row."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from pyproj import CRS

from survey.core.crs import UNSTATED
from survey.core.errors import InputError
from survey.core.files import existing_file
from survey.io.column_names import (
    ColumnNames,
    axis_of,
    datum_of_column,
    metres_factor,
    one_column,
    refuse_feet,
    renamed_header,
    say_columns,
)
from survey.io.point_files import VECTOR_ENDINGS, read_point_table, refuse_marks
from survey.io.point_table import PLACE, PointTable, in_own_columns, place_columns
from survey.io.text_tables import TextTable, read_text_table, refuse_hemispheres
from survey.io.vector import read_features

_NAME = "name"
_TABLES = (".csv", ".txt", ".tsv")


class NamedPoints(NamedTuple):
    """Columns of numbers, and a name for each row (empty where the file gives none)."""

    table: PointTable
    names: tuple[str, ...]


def read_named_points(path: str | Path, what: str, columns: Mapping[str, str] | None = None) -> NamedPoints:
    """Read points with names from tables of text, GPX (way points), or any format of points.

    Tables may have commas, semicolons or tabs between cells, decimal commas, and the usual names of columns
    (``Point, Easting, Northing, Elevation, SDH, SDV``); where they are not firnline's own, the log states which
    were read. Columns of text, such as codes, are passed over.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    what : str
        What it is, for the message.
    columns : mapping of str to str, optional
        Column of a table by own name, such as ``{"x_m": "Rechtswert"}``; others are found by their names.

    Returns
    -------
    NamedPoints
        Columns and names, row by row.

    Raises
    ------
    InputError
        Missing, empty, damaged, without heights, or with a name that is empty or given twice.
    """
    file = existing_file(path, what)
    suffix = file.suffix.lower()
    if suffix in _TABLES:
        table, names = _table(read_text_table(file, what), columns or {})
        refuse_marks(table, file)
    elif suffix == ".gpx":
        table, names = _gpx(file, what)
    else:
        table = read_point_table(file, columns)
        names = _feature_names(file, what) if suffix in VECTOR_ENDINGS else ()
    if len(set(names)) < len(names) or "" in names:
        repeated = sorted({name for name in names if names.count(name) > 1 or not name})
        raise InputError(
            f"{what} {file} names several points {repeated[0]!r}; give every point a name of its own."
        )
    return NamedPoints(table, names)


def _table(text: TextTable, given: Mapping[str, str]) -> tuple[PointTable, tuple[str, ...]]:
    """Return places, standard deviations and marks of a table, with the names of its points."""
    original = dict(zip(renamed_header(text.header, given, text.where), text.header, strict=True))
    used = _used_columns(list(original), text.where)
    numbers = {
        own: metres_factor(original[name]) * text.numbers(original[name], axis_of(own))
        for own, name in used.items()
        if own != _NAME
    }
    names = text.texts(original[used[_NAME]]) if _NAME in used else ()
    read = {own: original[name] for own, name in used.items()}
    say_columns(text.where, ColumnNames(read, tuple(n for n in text.header if n not in read.values())))
    datum = datum_of_column(read[PLACE[2]])
    table = PointTable(*in_own_columns(numbers, text.where), datum)
    if table.crs is not None:
        refuse_hemispheres(text, *(table.columns[name] for name in PLACE[:2]))
    return table, names


def _used_columns(header: list[str], where: str) -> dict[str, str]:
    """Return the columns that are read: places, then the others by own name."""
    refuse_feet(header, where)
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

"""Named points, such as surveyed marks: read places, numbers and a name for each row."""

import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from pyproj import CRS

from survey.core.crs.vertical_datum import UNSTATED
from survey.core.errors import InputError
from survey.core.files.reading import existing_file
from survey.io.point_columns import PLACE, in_own_columns
from survey.io.points.formats import read_point_table, refuse_marks
from survey.io.points.table import PointTable
from survey.io.tables import read_table
from survey.io.vector import read_features

_NAME = "name"


class NamedPoints(NamedTuple):
    """Columns of numbers, and a name for each row (empty where the file gives none)."""

    table: PointTable
    names: tuple[str, ...]


def read_named_points(path: str | Path, what: str) -> NamedPoints:
    """Read points with a text column ``name`` from CSV, GPX (way points), or any format of points.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    what : str
        What it is, for the message.

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
    if suffix == ".csv":
        table = PointTable(*in_own_columns(read_table(file, (), what=what, texts=(_NAME,)), f"{what} {file}"))
        refuse_marks(table, file)
        names = _csv_names(file)
    elif suffix == ".gpx":
        table, names = _gpx(file, what)
    else:
        table = read_point_table(file)
        names = _feature_names(file, what) if suffix in (".gpkg", ".geojson") else ()
    if len(set(names)) < len(names) or "" in names:
        repeated = sorted({name for name in names if names.count(name) > 1 or not name})
        raise InputError(
            f"{what} {file} names several points {repeated[0]!r}; give every point a name of its own."
        )
    return NamedPoints(table, names)


def _csv_names(file: Path) -> tuple[str, ...]:
    with file.open(encoding="utf-8-sig", newline="") as stream:
        rows = list(csv.reader(stream))
    header = [name.strip() for name in rows[0]]
    if _NAME not in header:
        return ()
    return tuple(row[header.index(_NAME)].strip() for row in rows[1:])


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

"""Points in CSV tables and vector files."""

from pathlib import Path
from typing import Any

import numpy as np
import shapely

from survey.core.crs.vertical_datum import UNSTATED, vertical_datum_of
from survey.core.errors import InputError
from survey.io.point_columns import PLACE
from survey.io.points.table import DATUM, PointTable, add_column
from survey.io.vector import read_features, write_features


def read_vector(path: Path) -> PointTable:
    """Read points from a GeoPackage or GeoJSON file."""
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
    datum = attributes.pop(DATUM, None)
    columns = dict(zip(PLACE, xyz.T, strict=True))
    for name, column in attributes.items():
        if np.issubdtype(column.dtype, np.number):
            add_column(columns, name, column, path)
    crs = features.crs
    stated = str(datum[0]) if datum is not None and datum[0] else vertical_datum_of(crs) if crs else UNSTATED
    return PointTable(columns, crs, stated)


def write_vector(path: Path, table: PointTable) -> None:
    """Write points to a GeoPackage or GeoJSON file."""
    shapes = shapely.points(np.column_stack([table.columns[name] for name in PLACE]))
    attributes: dict[str, Any] = {n: c for n, c in table.columns.items() if n not in PLACE}
    if table.vertical_datum:
        attributes[DATUM] = np.full(len(shapes), table.vertical_datum, dtype=object)
    write_features(path, shapes, attributes, table.crs, layer="surface_points")

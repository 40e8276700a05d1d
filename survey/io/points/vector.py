"""Points in vector files of a GIS: places of the geometry, and heights of the geometry or of an attribute."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from survey.core.arrays import FloatArray
from survey.core.crs.vertical_datum import UNSTATED, vertical_datum_of
from survey.core.errors import InputError
from survey.io.point_columns import PLACE
from survey.io.points.table import DATUM, PointTable, add_column
from survey.io.text_tables.spellings import (
    ColumnNames,
    datum_of_column,
    metres_factor,
    one_column,
    refuse_feet,
    renamed_header,
    say_columns,
)
from survey.io.vector import read_features, write_features

VECTOR_ENDINGS = (".gpkg", ".geojson", ".json", ".shp", ".fgb")
"""Endings of vector files that points are read from."""
_HEIGHT, _SIGMA = PLACE[2], "sigma_z_m"

Attributes = dict[str, npt.NDArray[Any]]


def read_vector(path: Path, columns: Mapping[str, str] | None = None) -> PointTable:
    """Read points from a vector file; `columns` names attributes by own name, such as ``{"z_m": "Elevation"}``."""
    features, where = read_features(path, what="the point file"), f"the point file {path}"
    _refuse_other_shapes(features.geometry, where)
    attributes = dict(features.attributes)
    datum = attributes.pop(DATUM, None)
    names = _used_attributes(attributes, columns or {}, features.geometry, where)
    xyz = shapely.get_coordinates(features.geometry, include_z=True)
    found = dict(zip(PLACE, xyz.T, strict=True))
    found |= {own: metres_factor(name) * _numbers(attributes, name, where) for own, name in names.items()}
    for name, column in attributes.items():
        if name not in {*names, *names.values()} and np.issubdtype(column.dtype, np.number):
            add_column(found, name, column, path)
    say_columns(where, ColumnNames(names))
    crs = features.crs
    stated = str(datum[0]) if datum is not None and datum[0] else vertical_datum_of(crs) if crs else UNSTATED
    stated = stated or datum_of_column(names.get(_HEIGHT, ""))
    return PointTable(found, crs, stated)


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
    chosen = next((key for key in given if key not in (_HEIGHT, _SIGMA)), None)
    if chosen is not None:
        raise InputError(
            f"{where} has its places in its geometry, and {chosen} was chosen from the attribute {given[chosen]}; "
            "choose z and sigma_z alone."
        )
    header = list(attributes)
    renamed_header(header, given, where)
    found = {
        _HEIGHT: given.get(_HEIGHT) or _height(attributes, shapely.get_z(geometry), where),
        _SIGMA: given.get(_SIGMA) or one_column("sigma_z", header, where),
    }
    return {own: name for own, name in found.items() if name is not None}


def _height(attributes: Attributes, z: FloatArray, where: str) -> str | None:
    """Return the attribute of heights where the geometry has none, and None where it has them."""
    if np.isfinite(z).all():
        _refuse_flat_geometry(z, attributes, where)
        return None
    refuse_feet(list(attributes), where)
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

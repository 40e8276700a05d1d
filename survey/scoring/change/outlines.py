"""Read named outlines of glaciers."""

from pathlib import Path
from typing import Any

import shapely
from shapely import MultiPolygon, Polygon
from shapely.validation import explain_validity

from survey.core.crs.checks import projected_crs
from survey.core.crs.transformation import transformed
from survey.core.errors import InputError
from survey.data.parts.area_parts import simple_rings
from survey.io.vector import polygon_layer, read_features

# Columns of names, of which the first that is not empty is taken: own files, the Randolph inventory, KML.
_NAMES = ("name", "Name", "NAME", "glac_name", "rgi_id", "RGIId", "id")


def read_outlines(path: str | Path, crs: Any) -> dict[str, Polygon | MultiPolygon]:
    """Read polygons by name from GeoJSON, GeoPackage, KML, KMZ or Shapefile into a projected CRS.

    Raises
    ------
    InputError
        A damaged file, no CRS, or a feature that is no simple polygon.
    """
    layer = polygon_layer(path, what="the outline file")
    features = read_features(path, layer=layer, what="the outline file")
    if features.crs is None:
        raise InputError(f"the outline file {path} carries no coordinate reference system; save it with one.")
    target = projected_crs(crs, "the surveys")
    names = _names(features.attributes, len(features.geometry))
    outlines: dict[str, Polygon | MultiPolygon] = {}
    for name, shape in zip(names, features.geometry, strict=True):
        if not isinstance(shape, Polygon | MultiPolygon) or shape.is_empty:
            kind = "nothing" if shape is None else f"a {shape.geom_type}"
            raise InputError(f"{path}: the outline {name!r} is {kind}; a polygon was expected.")
        flat = shapely.force_2d(simple_rings(shape))
        moved = shapely.transform(flat, lambda xy: transformed(xy, features.crs, target, str(path)))
        if not moved.is_valid or moved.area <= 0.0:
            raise InputError(
                f"{path}: the outline {name!r} is not a simple polygon ({explain_validity(moved)}); correct it in a GIS."
            )
        outlines[name] = moved
    return outlines


def _names(columns: dict[str, Any], n: int) -> list[str]:
    """Return the names of the file, numbered where they are missing or repeated."""
    present = [columns[name] for name in _NAMES if name in columns]
    names: list[str] = []
    for index in range(1, n + 1):
        texts = (str(column[index - 1]).strip() for column in present if column[index - 1] is not None)
        name = next((text for text in texts if text), "outline")
        names.append(f"{name} {index}" if name in names or name == "outline" else name)
    return names

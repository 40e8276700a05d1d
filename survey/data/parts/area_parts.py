"""Outlines, no-go zones and start points of an area's file: roles, CRS, valid polygons."""

import logging
from typing import Any

import numpy as np
import shapely
from pyproj import CRS
from shapely import MultiPolygon, Point, Polygon
from shapely.validation import explain_validity

from survey.core.arrays import frozen
from survey.core.crs.agreement import is_local
from survey.core.crs.checks import known_crs, projected_crs, refuse_far
from survey.core.crs.choice import chosen_crs, is_geographic
from survey.core.crs.exchanged_axes import refuse_degrees, refuse_exchanged
from survey.core.crs.transformation import transformed
from survey.core.errors import InputError
from survey.io.vector import Features

ROLES = ("area", "no-go", "start")


def roles_of(features: Features) -> list[str]:
    """Return the role of each feature; points without one are starts."""
    column = features.attributes.get("role")
    if column is None:
        return [
            "start" if shape is not None and "Point" in shape.geom_type else "area"
            for shape in features.geometry
        ]
    for value in column:
        if value not in ROLES:
            raise InputError(f"a feature has the role {value!r}; one of {', '.join(ROLES)} was expected.")
    return [str(value) for value in column]


def in_crs(features: Features, crs: Any, where: str) -> Features:
    """Return the features in the named CRS, else in their own; degrees are projected, and the log states it."""
    if features.crs is not None and not is_local(features.crs):
        _refuse_misplaced(features, known_crs(features.crs, where), where)
    places = shapely.get_coordinates(features.geometry)
    if len(places) == 0:
        raise InputError(
            f"{where} holds empty shapes alone; close each ring (its last place is its first one) or draw it again."
        )
    if crs is None and is_geographic(features.crs):
        crs = chosen_crs(places[:, 0], places[:, 1], features.crs)
        logging.getLogger(__name__).warning(
            "%s is in degrees (%s); it is projected to %s.",
            where,
            known_crs(features.crs, where).name,
            crs.name,
        )
    if features.crs is None:
        raise InputError(
            f"{where} carries no coordinate reference system; save it with one (a Shapefile has it in the .prj beside it)."
        )
    if crs is None:
        return features._replace(crs=projected_crs(features.crs, where))
    target = projected_crs(crs, "the wanted CRS")
    moved = shapely.transform(features.geometry, lambda xy: transformed(xy, features.crs, target, where))
    return features._replace(geometry=moved, crs=target)


def _refuse_misplaced(features: Features, crs: CRS, where: str) -> None:
    """Refuse features in metres whose easting and northing are exchanged or degrees."""
    if crs.is_projected:
        refuse_exchanged(shapely.get_coordinates(features.geometry), crs, where)
        refuse_degrees(shapely.get_coordinates(features.geometry), crs, where)


def polygon_parts(shape: Any, what: str) -> list[Polygon]:
    """Return the polygons of a shape, without heights."""
    if shape is None or shape.geom_type not in ("Polygon", "MultiPolygon"):
        kind = "nothing" if shape is None else f"a {shape.geom_type}"
        raise InputError(f"{what} is {kind}; a polygon was expected, close the line and save it as one.")
    return [shapely.force_2d(part) for part in shapely.get_parts(shape)]


def points_of(shape: Any) -> list[Point]:
    """Return the points of a start."""
    if shape is None or shape.geom_type not in ("Point", "MultiPoint"):
        raise InputError("a start is no point; draw it as a point.")
    return list(shapely.get_parts(shape))


def united(polygons: list[Polygon]) -> Polygon | MultiPolygon:
    """Check polygons and return their union."""
    for polygon in polygons:
        check_polygon(polygon, "the survey area")
    union = shapely.union_all(polygons)
    parts = [part for part in shapely.get_parts(union) if part.geom_type == "Polygon"]
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


def check_polygon(polygon: Any, what: str) -> None:
    """Refuse a polygon that is empty, not simple, without an area, or not on Earth."""
    if not isinstance(polygon, Polygon | MultiPolygon):
        raise InputError(f"{what} is a {type(polygon).__name__}; a polygon was expected.")
    if polygon.is_empty:
        raise InputError(f"{what} is an empty polygon; draw at least three corners.")
    if not np.isfinite(frozen(shapely.get_coordinates(polygon))).all():
        raise InputError(f"{what} has corners that are NaN or infinite; correct them.")
    refuse_far(shapely.get_coordinates(polygon), what)
    if not polygon.is_valid:
        raise InputError(
            f"{what} is not a simple polygon ({explain_validity(polygon)}); correct it in a GIS."
        )
    if polygon.area <= 0.0:
        raise InputError(
            f"{what} encloses no ground; draw at least three corners that do not lie on one line."
        )

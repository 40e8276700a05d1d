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
_SAME_AREA = 1e-9
"""Share of an area by which rounding changes it."""


def roles_of(features: Features) -> list[str]:
    """Return the role of each feature; points without one are starts."""
    column = features.attributes.get("role")
    if column is None:
        return [
            "start" if shape is not None and "Point" in shape.geom_type else "area"
            for shape in features.geometry
        ]
    for number, value in enumerate(column, start=1):
        if value not in ROLES:
            role = f"the role {value!r}" if value else "no role"
            raise InputError(f"feature {number} has {role}; one of {', '.join(ROLES)} was expected.")
    return [str(value) for value in column]


def refuse_nested(features: Features) -> None:
    """Refuse a polygon inside another one where no column states roles: it may well be ground to stay off."""
    if "role" in features.attributes:
        return
    shapes = np.array([shape for shape in features.geometry if isinstance(shape, Polygon | MultiPolygon)])
    inner, outer = (
        shapely.STRtree(shapes).query(shapes, predicate="covered_by") if len(shapes) > 1 else ((), ())
    )
    for number, around in zip(inner, outer, strict=True):
        if number != around and not shapes[number].equals(shapes[around]):
            raise InputError(
                f"polygon {number + 1} lies inside polygon {around + 1} and adds nothing to the area; give every feature a "
                f"role ({', '.join(ROLES)}) in a text column 'role' if no rover may drive there, or delete it."
            )


def with_simple_rings(features: Features) -> Features:
    """Return the features with rings that touch themselves as simple rings; refuse polygons that cross themselves."""
    shapes = np.array([simple_rings(shape) for shape in features.geometry], dtype=object)
    for number, shape in enumerate(shapes, start=1):
        for part in shapely.get_parts(shape) if isinstance(shape, Polygon | MultiPolygon) else ():
            if not part.is_valid and np.isfinite(shapely.get_coordinates(part)).all():
                raise InputError(
                    f"feature {number} is not a simple polygon ({explain_validity(part)}); correct it in a GIS."
                )
    return features._replace(geometry=shapes)


def simple_rings(shape: Any) -> Any:
    """Return the same ground bounded by rings that do not touch themselves, or the shape where its rings cross.

    Outlines of glaciers often touch themselves at a point, such as where a nunatak meets the margin. The ground that
    they bound is the same however it is counted: the sum of their corners gives its area.
    """
    if not isinstance(shape, Polygon | MultiPolygon) or shape.is_valid:
        return shape
    parts = [_simple_part(part) for part in shapely.get_parts(shape)]
    polygons = [polygon for part in parts for polygon in shapely.get_parts(part)]
    return polygons[0] if len(polygons) == 1 else MultiPolygon(polygons)


def _simple_part(polygon: Polygon) -> Polygon | MultiPolygon:
    if polygon.is_valid or not np.isfinite(shapely.get_coordinates(polygon)).all():
        return polygon
    found = [part for part in shapely.get_parts(shapely.make_valid(polygon)) if part.geom_type == "Polygon"]
    simple = MultiPolygon(found)
    is_same = len(found) > 0 and abs(simple.area - polygon.area) <= _SAME_AREA * polygon.area
    return simple if is_same else polygon


def prepared(features: Features, crs: Any, where: str) -> Features:
    """Return checked features with simple rings, in the named CRS, else in their own (`in_crs`)."""
    features = with_simple_rings(features)
    refuse_nested(features)
    return in_crs(features, crs, where)


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

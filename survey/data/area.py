"""Survey areas: outline, no-go zones and start points of rovers.

`SurveyArea` holds valid polygons in one projected CRS. Its file has features with a role each; their geometries are
checked, transformed into the CRS and united. Lengths and areas count on the ground.
"""

import logging
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import shapely
from pyproj import CRS
from shapely import MultiPolygon, Point, Polygon
from shapely.validation import explain_validity

from survey.core import (
    BoolArray,
    DataObject,
    FloatArray,
    InputError,
    checked,
    frozen,
    projected_crs,
    same_crs,
)
from survey.core.crs import is_local, known_crs, refuse_degrees, refuse_exchanged, refuse_far
from survey.core.lengths import log_converted
from survey.core.map_scale import ground_area_m2
from survey.core.transformation import chosen_crs, is_geographic, metric_crs, transformed
from survey.data.conversions import to_geodataframe
from survey.io.vector import Features, polygon_layer, read_features, write_features

if TYPE_CHECKING:
    from geopandas import GeoDataFrame


@dataclass(frozen=True, eq=False, repr=False)
class SurveyArea(DataObject):
    """Ground to be mapped, in a projected CRS.

    Parameters
    ----------
    polygon : shapely.Polygon or shapely.MultiPolygon
        Outline [m]; holes count as no-go ground.
    crs : str or pyproj.CRS
        Projected, in metres.
    no_go : tuple of shapely.Polygon
        Ground that no route may touch.
    starts : (K, 2) array_like
        Where rovers start [m]; none by default.
    reference : (2,) array_like, optional
        The point from which scientific value is counted (Eq. 11); the centroid by default.

    Raises
    ------
    InputError
        An outline that is empty, crosses itself or is no polygon; no-go ground that
        leaves nothing; a start outside the free ground; a CRS in degrees.

    Examples
    --------
    >>> area = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), "EPSG:32608")
    >>> area.farthest_m
    424.26
    """

    polygon: Polygon | MultiPolygon
    crs: CRS
    no_go: tuple[Polygon, ...] = ()
    starts: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    reference: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "crs", projected_crs(self.crs, "the survey area"))
        object.__setattr__(self, "polygon", simple_rings(self.polygon))
        check_polygon(self.polygon, "the survey area")
        for index, polygon in enumerate(self.no_go, start=1):
            check_polygon(polygon, f"no-go zone {index}")
        if self.free.is_empty or self.free.area <= 0.0:
            raise InputError(
                "the no-go zones cover the whole survey area; nothing is left to survey, make one of them smaller."
            )
        centre = self.polygon.centroid
        point = (centre.x, centre.y) if self.reference is None else self.reference
        object.__setattr__(self, "reference", checked(point, (2,), "the reference point"))
        object.__setattr__(self, "starts", checked(self.starts, (None, 2), "the start points"))
        for start in self.starts:
            if not self.free.covers(Point(start)):
                raise InputError(
                    f"the start ({start[0]:.1f}, {start[1]:.1f}) is outside the area or in a no-go zone; move it to "
                    "free ground (a point of an area file is a start)."
                )

    @classmethod
    def rectangle(cls, bounds: tuple[float, float, float, float], crs: Any) -> Self:
        """Return the rectangle ``(xmin, ymin, xmax, ymax)`` [m].

        Parameters
        ----------
        bounds : (4,) tuple of float
            ``(xmin, ymin, xmax, ymax)`` [m].
        crs : str or pyproj.CRS
            Projected, in metres.

        Returns
        -------
        SurveyArea
            Without no-go ground and starts.
        """
        xmin, ymin, xmax, ymax = checked(bounds, (4,), "the area's bounds").tolist()
        if xmax <= xmin or ymax <= ymin:
            raise InputError(
                f"the area's bounds {tuple(bounds)} enclose nothing; give (xmin, ymin, xmax, ymax)."
            )
        return cls(shapely.box(xmin, ymin, xmax, ymax), crs)

    @classmethod
    def read(cls, path: str | Path, *, crs: Any = None, layer: str | int | None = None) -> Self:
        """Read an area from GeoJSON, GeoPackage, KML, KMZ, Shapefile or FlatGeobuf.

        Features have the role ``area``, ``no-go`` or ``start`` in a text column ``role``;
        without it every polygon is area and every point a start. Rings may touch themselves, not cross.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.
        crs : str or pyproj.CRS, optional
            The projected CRS to work in.
        layer : str or int, optional
            The layer; the only one with polygons by default.

        Returns
        -------
        SurveyArea
            In `crs`, or in the file's own projected CRS. An area in degrees (GeoJSON, KML) is projected to
            its UTM zone, or to polar stereographic beyond 84° N and 80° S; the log states it.

        Raises
        ------
        InputError
            The file is missing or damaged, or holds no polygon; without roles, a polygon inside another one.
        """
        chosen = polygon_layer(path, what="the area file") if layer is None else layer
        features = read_features(path, layer=chosen, what="the area file")
        try:
            return cls._from_features(
                prepare_features(features, crs, f"the area file {path}"), roles_of(features)
            )
        except InputError as error:
            message = str(error)
            raise InputError(message if str(path) in message else f"{path}: {message}") from error

    @classmethod
    def _from_features(cls, features: Features, roles: list[str]) -> Self:
        by_role: dict[str, list[Any]] = {role: [] for role in ROLES}
        for shape, role in zip(features.geometry, roles, strict=True):
            by_role[role].append(shape)
        polygons = [part for shape in by_role["area"] for part in polygon_parts(shape, "the survey area")]
        if not polygons:
            raise InputError("there is no polygon to survey; draw one and save it again.")
        outline = polygons[0] if len(polygons) == 1 else unite(polygons)
        no_go = tuple(part for shape in by_role["no-go"] for part in polygon_parts(shape, "a no-go zone"))
        starts = [(p.x, p.y) for shape in by_role["start"] for p in points_of(shape)]
        return cls(outline, features.crs, no_go, np.array(starts, dtype=np.float64).reshape(-1, 2))

    def write(self, path: str | Path) -> None:
        """Write outline, no-go zones and starts with a ``role`` column.

        Parameters
        ----------
        path : str or pathlib.Path
            The file; ``.gpkg``, ``.geojson``, ``.kml`` or ``.shp``.
        """
        shapes, roles = self._shapes_and_roles()
        write_features(path, shapes, {"role": np.array(roles, dtype=object)}, self.crs, layer="area")

    def to_geodataframe(self) -> "GeoDataFrame":
        """Return outline, no-go zones and starts as a table with a ``role`` column.

        Returns
        -------
        geopandas.GeoDataFrame
            The outline first, then no-go zones, then starts.

        Raises
        ------
        InputError
            When GeoPandas is not installed.
        """
        shapes, roles = self._shapes_and_roles()
        return to_geodataframe(shapes, {"role": roles}, self.crs)

    def _shapes_and_roles(self) -> tuple[list[Any], list[str]]:
        shapes = [self.polygon, *self.no_go, *(Point(start) for start in self.starts)]
        return shapes, ["area"] + ["no-go"] * len(self.no_go) + ["start"] * len(self.starts)

    def _summary(self) -> str:
        parts = [
            f"{ground_area_m2(self.crs, self.polygon):.0f} m²",
            f"{len(self.no_go)} no-go zones",
            f"{len(self.starts)} starts",
        ]
        return ", ".join([*parts, self.crs.name])

    @cached_property
    def free(self) -> Polygon | MultiPolygon:
        """The outline less its no-go zones."""
        if not self.no_go:
            return self.polygon
        rest = self.polygon.difference(shapely.union_all(list(self.no_go)))
        parts = [part for part in shapely.get_parts(rest) if part.geom_type == "Polygon"]
        return parts[0] if len(parts) == 1 else MultiPolygon(parts)

    @cached_property
    def ground_area_m2(self) -> float:
        """Area of the free ground on the ground [m²]: the areal scale factor of the CRS is applied."""
        return ground_area_m2(self.crs, self.free)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """``(xmin, ymin, xmax, ymax)`` of the outline [m]."""
        xmin, ymin, xmax, ymax = self.polygon.bounds
        return xmin, ymin, xmax, ymax

    @cached_property
    def farthest_m(self) -> float:
        """Distance from the reference to the farthest point of the outline [m] (D_max of Eq. 13)."""
        corners = shapely.get_coordinates(self.polygon)
        return float(np.hypot(*(corners - self.reference).T).max())

    def contains(self, xy: Any) -> BoolArray:
        """Return which points lie on ground to be mapped: the outline, edge included, less the no-go zones.

        Parameters
        ----------
        xy : (N, 2) array_like
            Easting and northing [m].

        Returns
        -------
        (N,) ndarray of bool
            True on free ground, its edge included.
        """
        points = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
        shapely.prepare(self.free)
        inside: BoolArray = shapely.intersects_xy(self.free, points[:, 0], points[:, 1])
        return inside

    def require_crs(self, crs: CRS, what: str) -> None:
        """Refuse when the area is in another CRS than `what`.

        Parameters
        ----------
        crs : pyproj.CRS
            The CRS that the area is to have.
        what : str
            What has it, for the message.
        """
        same_crs(self.crs, crs, f"the survey area and {what}")


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


def prepare_features(features: Features, crs: Any, where: str) -> Features:
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
    stated = metric_crs(features.crs, where)
    log_converted(where, [("places", stated.place_m)])
    if crs is None and stated.place_m == 1.0:
        return features._replace(crs=projected_crs(features.crs, where))
    target = projected_crs(stated.crs if crs is None else metric_crs(crs, where).crs, "the wanted CRS")
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


def unite(polygons: list[Polygon]) -> Polygon | MultiPolygon:
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

"""Fences of autopilots: polygons and circles that a vehicle stays in or out of, in degrees.

`area_fence` makes the fence of an area, with no more corners than an autopilot stores (`LIMITS`): a fence that has more is
made simpler towards the safe side, so that exclusions grow and the inclusion shrinks. An autopilot knows no holes, so that
no-go ground with ground to drive on inside it becomes several exclusions beside one another. `require_inside` compares a
path with the fence that goes along with it.
"""

from collections.abc import Iterator, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import shapely
from pyproj import CRS
from shapely import Geometry, LineString, MultiPoint, Polygon

from survey.core import FloatArray, InputError
from survey.core.transformation import WGS84, transformed
from survey.data.area import SurveyArea

FENCE_MARGIN_M = 10.0
"""Distance of the fence of an autopilot from the outline of the area, to its outside [m]."""
_SIMPLIFIED_M = 1.0
# A rover does not keep its path to the centimetre; edges that path and no-go ground share are no crossing.
_TOUCH_M = 0.1
# Depths of the band in which a fence may be simplified [m]; the deepest leaves the surroundings of the route alone inside.
_DEPTHS_M = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, FENCE_MARGIN_M, 13.0, 17.0, 22.0, 30.0, 50.0, 100.0)
# Where in the band a fence begins, and how far its corners may lie from there, as shares of the depth.
_STARTS = ((0.1, 0.1), (0.5, 0.4), (0.9, 0.1))
_FARTHEST_M = 40.0
_ROUTE_MARGIN_M = 5.0

Autopilot = Literal["ardupilot", "px4"]


class Limits(NamedTuple):
    """Items and corners of fences that an autopilot stores with the defaults of its makers; boards may hold more."""

    items: int
    fence_corners: int


LIMITS: dict[str, Limits] = {"ardupilot": Limits(724, 70), "px4": Limits(2000, 64)}
NAMES = {"ardupilot": "ArduPilot", "px4": "PX4"}


class FencePart(NamedTuple):
    """Polygon or circle of a fence.

    `corners`: latitude and longitude [deg]; of a circle its centre alone. `radius_m`: of a circle [m].
    """

    is_inclusion: bool
    corners: tuple[tuple[float, float], ...]
    radius_m: float = 0.0

    def shape(self, crs: CRS) -> Geometry:
        """Return the ground that it bounds, in a projected CRS."""
        places = transformed(np.array(self.corners)[:, ::-1], WGS84, crs, "the fence")
        if self.radius_m > 0.0:
            return shapely.Point(places[0]).buffer(self.radius_m, quad_segs=64)
        return shapely.make_valid(Polygon(places))


def fence_outline(area: SurveyArea) -> Polygon:
    """Return the outline within which a rover has to stay: that of the area, a margin outside, without holes.

    Returns: in the CRS of the area [m].

    >>> fence_outline(SurveyArea.rectangle((0.0, 0.0, 80.0, 40.0), "EPSG:32608")).bounds
    (-10.0, -10.0, 90.0, 50.0)
    """
    parts = shapely.get_parts(area.polygon)
    outline = parts[0] if len(parts) == 1 else area.polygon.convex_hull
    grown = Polygon(outline.exterior).buffer(FENCE_MARGIN_M, join_style="mitre")
    return Polygon(grown.simplify(_SIMPLIFIED_M).exterior)


def no_go_ground(area: SurveyArea) -> list[Polygon]:
    """Return the no-go zones of an area and its holes, each less the ground to drive on inside it.

    Returns: in the CRS of the area [m].
    """
    holes = [Polygon(ring) for part in shapely.get_parts(area.polygon) for ring in part.interiors]
    bare = shapely.union_all(holes).difference(area.polygon)
    return [*area.no_go, *_polygons(bare)]


class AreaFence(NamedTuple):
    """Outline that a vehicle stays in, and simple polygons that it stays out of, in the CRS of the area [m].

    `note`: how far it was made simpler; empty where it was not.
    """

    outline: Polygon
    exclusions: tuple[Polygon, ...]
    note: str = ""

    @property
    def n_corners(self) -> int:
        """Number of corners that an autopilot stores."""
        return sum(len(ring.exterior.coords) - 1 for ring in (self.outline, *self.exclusions))

    def parts(self, crs: CRS) -> tuple[FencePart, ...]:
        """Return the fence in degrees, nine decimals as in files of missions."""
        parts = []
        for polygon in (self.outline, *self.exclusions):
            corners = transformed(shapely.get_coordinates(polygon)[:-1], crs, WGS84, "the area")
            places = tuple((x, y) for x, y in np.round(corners[:, ::-1], 9).tolist())
            parts.append(FencePart(polygon is self.outline, places))
        return tuple(parts)


def area_fence(area: SurveyArea, xy: FloatArray, most_corners: int, holder: str) -> AreaFence:
    """Return a fence of at most so many corners for a path in an area, made simpler to the safe side where it has more.

    `xy` (N, 2): the path [m]. `holder`: who stores so many corners, for messages. Raises `InputError` where no fence of so
    few corners is found.
    """
    zones = no_go_ground(area)
    full = AreaFence(fence_outline(area), _simple(zones))
    if full.n_corners <= most_corners:
        return full
    near = [zone for zone in zones if zone.intersects(full.outline)]
    simpler = _simpler(full.outline, near, path_of(xy))
    fence = next((fence for fence in simpler if fence.n_corners <= most_corners), None)
    if fence is None:
        raise InputError(
            f"the fence has {full.n_corners} corners, and {holder} holds {most_corners}; give the outline of the area and "
            "its no-go zones in the area file fewer corners."
        )
    whole = "" if fence.outline.covers(area.polygon) else " and surrounds the route, not the whole area"
    return fence._replace(
        note=f"the fence is made simpler, from {full.n_corners} to {fence.n_corners} corners, of which {holder} holds "
        f"{most_corners}: its outline lies up to {_reach_m((full.outline,), (fence.outline,)):.1f} m farther in{whole}, its "
        f"no-go zones reach up to {_reach_m(fence.exclusions, full.exclusions):.1f} m farther out."
    )


def _simpler(outline: Polygon, zones: Sequence[Polygon], path: Geometry) -> Iterator[AreaFence]:
    """Yield fences of ever fewer corners: outlines within the given one, and exclusions that cover the zones.

    Up to the margin of the fence the outline still surrounds the area, or nearly so; at last the path alone. Exclusions
    stay off the path.
    """
    margin_m = min(_ROUTE_MARGIN_M, 0.5 * path.distance(outline.exterior))
    core = path.buffer(margin_m, quad_segs=2)
    deepest_m = 0.6 * float(np.sqrt(outline.area))  # more than the radius of any circle within
    for depth_m in (*_DEPTHS_M, deepest_m):
        away = [min(depth_m, _FARTHEST_M, 0.5 * zone.distance(path)) for zone in zones]
        grown = [_thinned(zone, zone_m, Polygon()) for zone, zone_m in zip(zones, away, strict=True)]
        yield AreaFence(_thinned(outline, -depth_m, core), _simple(_polygons(shapely.union_all(grown))))


def _thinned(polygon: Polygon, depth_m: float, core: Polygon) -> Polygon:
    """Return a polygon of fewer corners between a polygon and itself moved outwards by a depth; the same where none is found.

    Where it is moved inwards it still surrounds a core.
    """
    far = _within(_moved(polygon, depth_m).union(core), depth_m)
    starts = [
        _within(_moved(polygon, share * depth_m).simplify(slack * abs(depth_m)).union(core), depth_m)
        for share, slack in _STARTS
    ]
    if depth_m == 0.0 or {shape.geom_type for shape in (far, *starts)} != {"Polygon"}:
        return polygon
    band = polygon.symmetric_difference(far)
    inner, outer = (far, polygon) if depth_m < 0.0 else (polygon, far)
    thin = [_with_thinned_rings(start, band) for start in starts]
    sound = [one for one in thin if one.is_valid and one.covers(inner) and outer.covers(one)]
    return min([polygon, *sound], key=shapely.get_num_coordinates)


def _moved(polygon: Polygon, depth_m: float) -> Geometry:
    return polygon.buffer(depth_m, join_style="mitre", mitre_limit=2.0)


def _within(shape: Geometry, depth_m: float) -> Geometry:
    """Return a shape without holes where it is an outline that was moved inwards."""
    return Polygon(shape.exterior) if depth_m < 0.0 and shape.geom_type == "Polygon" else shape


def _with_thinned_rings(polygon: Polygon, band: Geometry) -> Polygon:
    rings = [shapely.get_coordinates(ring)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
    shell, *holes = (_thinned_ring(corners, band) for corners in rings)
    return Polygon(shell, holes)


def _thinned_ring(corners: FloatArray, band: Geometry) -> FloatArray:
    """Leave out corners whose neighbours can be joined within a band, those of the smallest triangles first."""
    shapely.prepare(band)
    while len(corners) > 4:
        before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
        joined = shapely.covers(band, shapely.linestrings(np.stack([before, after], axis=1)))
        areas = shapely.area(shapely.polygons(np.stack([before, corners, after], axis=1)))
        is_kept = np.ones(len(corners), dtype=bool)
        for k in np.argsort(areas, kind="stable"):
            if joined[k] and is_kept[k - 1] and is_kept[(k + 1) % len(corners)] and is_kept.sum() > 4:
                is_kept[k] = False
        if is_kept.all():
            break
        corners = corners[is_kept]
    return corners


def _reach_m(outer: Sequence[Polygon], inner: Sequence[Polygon]) -> float:
    """Return how far the corners of some polygons lie outside others [m]."""
    if not outer:
        return 0.0
    corners = shapely.points(shapely.get_coordinates(list(outer)))
    return float(shapely.distance(corners, shapely.union_all(list(inner))).max())


def _simple(polygons: Sequence[Polygon]) -> tuple[Polygon, ...]:
    """Return the same ground as polygons without holes."""
    return tuple(piece for polygon in polygons for piece in _pieces(polygon))


def _pieces(polygon: Polygon) -> list[Polygon]:
    """Cut a polygon through the middle of its first hole until no piece has one."""
    if not polygon.interiors:
        return [polygon]
    west, south, east, north = polygon.bounds
    middle = Polygon(polygon.interiors[0]).centroid.x
    halves = [shapely.box(west, south, middle, north), shapely.box(middle, south, east, north)]
    return [
        piece for half in halves for part in _polygons(polygon.intersection(half)) for piece in _pieces(part)
    ]


def _polygons(shape: Geometry) -> list[Polygon]:
    return [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon" and part.area > 0.0]


def require_inside(xy: FloatArray, fence: Sequence[FencePart], crs: Any, what: str) -> None:
    """Refuse a path that leaves the inclusions of its own fence or enters an exclusion.

    `xy` (N, 2): places in driving order in a projected CRS [m]. `what`: whose path it is, for messages.
    """
    for number, part in enumerate(fence, start=1):
        if not part.radius_m > 0.0 and len(part.corners) < 3:
            raise InputError(
                f"part {number} of the fence of {what} has {len(part.corners)} corners and no radius; draw it again with "
                "three corners at least."
            )
    inside, outside = (
        shapely.union_all([part.shape(crs) for part in fence if part.is_inclusion == kind])
        for kind in (True, False)
    )
    if any(part.is_inclusion for part in fence):
        _refuse(
            path_of(xy).difference(inside.buffer(_TOUCH_M)),
            crs,
            f"{what} outside the inclusions of its own fence",
        )
    require_clear(xy, outside, crs, f"{what} within the exclusions of its own fence")


def require_clear(xy: FloatArray, ground: Geometry, crs: Any, where: str) -> None:
    """Refuse a path that enters ground that is shut; along its edge it may run."""
    _refuse(path_of(xy).intersection(ground.buffer(-_TOUCH_M)), crs, where)


def path_of(xy: FloatArray) -> Geometry:
    """Return the line through places, or the only place."""
    return LineString(xy) if len(xy) > 1 else MultiPoint(xy)


def _refuse(wrong: Geometry, crs: Any, where: str) -> None:
    if wrong.is_empty:
        return
    longitude, latitude = transformed(shapely.get_coordinates(wrong)[:1], crs, WGS84, where)[0]
    raise InputError(
        f"{wrong.length:.0f} m of {where}, the first at latitude {latitude:.6f}, longitude {longitude:.6f}; "
        "move the places or the fence, or name the area (--area) that the route was planned for."
    )

"""Heading of swaths: across the narrow side, up the slope, or across the grain of the terrain."""

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from planners.config import HeadingRule
from planners.routes.shortest_paths import FreeGround
from planners.swaths.decomposition import swaths_on
from planners.swaths.reference_lines import axes_of, narrowest_heading
from survey import Dem, InputError
from survey.core import FloatArray

_MOST_EDGES = 24
_MARKED = 3.0
"""How much more slopes along one direction vary than along the other where terrain has a marked grain."""


def heading_by(
    rule: HeadingRule, ground: FreeGround, *, dem: Dem | None = None, spacing_m: float | None = None
) -> float:
    """Return the swaths' heading [deg, 0 to 180), counter-clockwise from east.

    `spacing_m`: needed by ``fewest-swaths`` [m].

    >>> ground = FreeGround(shapely.box(0.0, 0.0, 100.0, 30.0))
    >>> heading_by("narrowest", ground)
    0.0
    """
    if rule == "narrowest":
        return narrowest_heading(ground.polygon)
    if rule == "fewest-swaths":
        if spacing_m is None:
            raise InputError("the rule fewest-swaths needs the spacing of the swaths; name it.")
        return _fewest_swaths(ground, spacing_m)
    if dem is None:
        raise InputError(f"the rule {rule} needs a DEM of the ground; give one or choose narrowest.")
    east, north = _gradient_within(dem, ground.polygon)
    return _slope(east, north) if rule == "slope" else _grain(east, north)


def across_marked_grain(free: Polygon | MultiPolygon, dem: Dem) -> float:
    """Return the heading across the narrowest width, or square to it where a marked grain runs along it [deg].

    Samples along a swath do not show ridges that run beside it: the map and its predicted error are both worse
    where swaths run along the grain.

    >>> from survey.data.grid import Grid
    >>> ridges = np.outer(5.0 * np.sin(np.arange(10.0)), np.ones(10))
    >>> ridges = Dem.on(Grid((0.0, 0.0, 90.0, 90.0), 10.0), ridges)
    >>> across_marked_grain(shapely.box(0.0, 0.0, 90.0, 90.0), ridges)
    90.0
    """
    heading_deg = narrowest_heading(free)
    slopes = np.column_stack(_gradient_within(dem, free))
    along, across = (float(np.var(slopes @ axis)) for axis in axes_of(heading_deg))
    return (heading_deg + 90.0) % 180.0 if across > _MARKED * along else heading_deg


def _edge_headings(xy: FloatArray) -> FloatArray:
    """Return the headings of the longest edges of a ring [deg, 0 to 180), each once."""
    edges = np.diff(xy, axis=0)
    longest = np.argsort(-np.hypot(*edges.T), kind="stable")[:_MOST_EDGES]
    headings: FloatArray = np.unique(
        np.round(np.degrees(np.arctan2(edges[longest, 1], edges[longest, 0])) % 180.0, 6) % 180.0
    )
    return headings


def _fewest_swaths(ground: FreeGround, spacing_m: float) -> float:
    largest = ground.parts[0]
    candidates = np.union1d(
        _edge_headings(shapely.get_coordinates(largest.exterior)),
        _edge_headings(shapely.get_coordinates(ground.polygon.convex_hull)),
    )

    def effort(heading_deg: float) -> tuple[int, float]:
        swaths = swaths_on(ground, spacing_m, heading_deg)
        return len(swaths), float(sum(np.hypot(*(s[-1] - s[0])) for s in swaths))

    return float(min(candidates, key=effort))


def _gradient_within(dem: Dem, free: Polygon | MultiPolygon) -> tuple[FloatArray, FloatArray]:
    east, north = (g.ravel() for g in dem.gradient())
    xy = dem.xy
    known = np.isfinite(east) & np.isfinite(north) & shapely.contains_xy(free, xy[:, 0], xy[:, 1])
    if not known.any():
        raise InputError("the DEM has no height on the ground; give one that covers it.")
    return east[known], north[known]


def _slope(east: FloatArray, north: FloatArray) -> float:
    x, y = float(east.mean()), float(north.mean())
    if np.hypot(x, y) < 1e-6:
        raise InputError("the ground does not slope on average; choose another rule for the heading.")
    return float(np.degrees(np.arctan2(y, x)) % 180.0)


def _grain(east: FloatArray, north: FloatArray) -> float:
    x, y = east - east.mean(), north - north.mean()
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    moment = float(east @ east + north @ north)
    if np.hypot(xx - yy, 2.0 * xy) <= 1e-9 * moment:
        raise InputError("the terrain changes alike in all directions; choose another rule for the heading.")
    return float(np.degrees(0.5 * np.arctan2(2.0 * xy, xx - yy)) % 180.0)

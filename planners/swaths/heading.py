"""Heading of swaths: across the narrow side, up the slope, or across the grain of the terrain."""

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from planners.config import HeadingRule, SwathConfig
from planners.routes.shortest_paths import FreeGround
from planners.swaths.reference_lines import (
    axes_of,
    lines_over,
    narrowest_heading,
    shortest_m,
    stretch_lengths,
)
from survey import Dem, InputError
from survey.core import FloatArray

_MOST_EDGES = 24
_AS_NARROW = 1.005
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
        config = SwathConfig.model_validate({"spacing_m": spacing_m})
        return undivided_heading(ground, config, as_narrow=np.inf)
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


def undivided_heading(
    ground: FreeGround, config: SwathConfig, turn_m: float = 0.0, *, as_narrow: float = _AS_NARROW
) -> float:
    """Return the heading with the fewest pieces of lines, of those whose width is at most `as_narrow` of the least [deg]."""
    hull = ground.polygon.convex_hull
    edges = [_edge_headings(shapely.get_coordinates(ring)) for ring in (ground.parts[0].exterior, hull)]
    headings = np.r_[narrowest_heading(hull), np.union1d(*edges)]
    widths = np.array([np.ptp(shapely.get_coordinates(hull) @ axes_of(heading)[1]) for heading in headings])

    def n_pieces(heading_deg: float) -> int:
        lines, spacing_m = lines_over(ground.polygon, config, heading_deg, turn_m)
        offsets = np.array([line[0] for line in lines]) @ axes_of(heading_deg)[1]
        pieces = np.concatenate(stretch_lengths(ground.polygon, heading_deg, offsets))
        return int((pieces >= shortest_m(config, spacing_m, turn_m)).sum())

    return float(min(headings[widths <= as_narrow * widths[0]], key=n_pieces))


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

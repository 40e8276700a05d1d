"""Reference lines of a survey: parallel, evenly spaced, cut to the free ground.

`reference_lines` lays them over the bounds of an area in the direction and at the spacing of a `SwathConfig`; a
`Swath` is what is driven along one of them. `swaths_text` states the lines of a route, and the pieces that a concave border
or no-go ground cuts them into.
"""

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import shapely

from planners.capacity import require_lines
from planners.config import Corner, SwathConfig
from survey import InputError, Route, SurveyArea
from survey.core import FloatArray

CRUMB_M = 0.01
"""Cutting leaves crumbs where a line grazes a corner; shorter ones than this are dropped [m]."""

_TOWARDS: dict[Corner, tuple[float, float]] = {
    "south-west": (-1.0, -1.0),
    "south-east": (1.0, -1.0),
    "north-west": (-1.0, 1.0),
    "north-east": (1.0, 1.0),
}


@dataclass(frozen=True)
class Swath:
    """Driven line ``xy`` (N, 2) [m], and the straight line it deviates from, ``axis`` (2, 2) [m]."""

    xy: FloatArray
    axis: FloatArray


@dataclass(frozen=True)
class ReferenceLines:
    """Pieces of parallel lines, line by line in the order and direction of the first sweep.

    ``lines`` holds one list of axes (2, 2) [m] per line, each pointing along `heading_deg`.
    """

    lines: tuple[tuple[FloatArray, ...], ...]
    spacing_m: float
    heading_deg: float

    @property
    def back_and_forth(self) -> list[FloatArray]:
        """Every axis in boustrophedon order and direction."""
        axes: list[FloatArray] = []
        for index, line in enumerate(self.lines):
            axes += list(line) if index % 2 == 0 else [axis[::-1] for axis in line[::-1]]
        return axes


def reference_lines(area: SurveyArea, config: SwathConfig, turn_m: float = 0.0) -> ReferenceLines:
    """Lay the reference lines of a pattern over an area; `turn_m` is what a turn takes [m]."""
    heading_deg = narrowest_heading(area.free) if config.heading_deg is None else config.heading_deg
    laid, spacing_m = lines_over(area.free, config, heading_deg, turn_m)
    cut = [pieces_on(area.free, line) for line in laid]
    lines = [
        tuple(shortened(piece, config.inset_share * spacing_m) for piece in line) for line in cut if line
    ]
    if not lines:
        xmin, ymin, xmax, ymax = area.bounds
        raise InputError(
            f"no swath meets the free ground of the area of {xmax - xmin:.1f} × {ymax - ymin:.1f} m; ask for more swaths."
        )
    return ReferenceLines(_from_corner(lines, area, config.start), spacing_m, heading_deg)


def lines_over(
    ground: Any, config: SwathConfig, heading_deg: float, turn_m: float = 0.0
) -> tuple[list[FloatArray], float]:
    """Return evenly spaced lines over the ground, longer than it, from right to left of the heading, and their spacing [m].

    The width W across the heading is shared by n lines so that neighbours are
    ``D = W / (n - 1 + 2 o)`` apart and the outer ones `outer_share` o spacings from the
    border: for o = 1/2 the lines at ``(i + 1/2) W / n`` of the glacier paper. Where an outer one meets no
    stretch that is worth a swath, as in a tip, W is less by half a spacing there, or a whole one.
    """
    along, left = axes_of(heading_deg)
    corners = shapely.get_coordinates(ground)
    if not len(corners):
        return [], 0.0
    u, v = corners @ along, corners @ left
    reach, sides = np.array([u.min() - 1.0, u.max() + 1.0]), np.array([v.min(), v.max()])
    for _ in range(3):
        width = float(np.ptp(sides))
        n = n_lines(width, config)
        require_lines(n, width)
        spacing_m = width / (n - 1 + 2.0 * config.outer_share)
        offsets = sides[0] + 0.5 * (width - (n - 1) * spacing_m) + spacing_m * np.arange(n)
        lines: list[FloatArray] = [reach[:, None] * along + offset * left for offset in offsets]
        outer = stretch_lengths(ground, heading_deg, offsets[[0, -1]])
        longest = np.array([lengths.max(initial=0.0) for lengths in outer])
        is_tip = longest < shortest_m(config, spacing_m, turn_m)
        if n == 1 or not is_tip.any():
            break
        sides = sides + 0.5 * spacing_m * is_tip * np.array([1.0, -1.0])
    return lines, float(spacing_m)


def stretch_lengths(ground: Any, heading_deg: float, offsets: FloatArray) -> list[FloatArray]:
    """Return the lengths of the stretches of parallel lines within a polygon, its border included, line by line [m].

    The crossings with the border pair up along a line. Where a line touches corners or runs along the border, what lies just
    to its left and just to its right both counts.

    `offsets`: of the lines to the left of the heading [m].

    >>> stretch_lengths(shapely.box(0.0, 0.0, 9.0, 5.0), 0.0, np.array([0.0, 2.0, 5.0, 7.0]))
    [array([9.]), array([9.]), array([9.]), array([], dtype=float64)]
    """
    along, left = axes_of(heading_deg)
    xy, ring = shapely.get_coordinates(shapely.get_rings(shapely.get_parts(ground)), return_index=True)
    u, v = xy @ along, xy @ left
    ordered = np.sort(offsets)
    below = np.searchsorted(ordered, v)
    not_above = below + (ordered.take(below, mode="clip") == v)
    # Edges that no line meets are left out before the lines are taken one by one.
    is_met = (below[:-1] != below[1:]) | (not_above[:-1] != not_above[1:])
    met = np.flatnonzero(is_met & (np.diff(ring) == 0))
    u, v = (np.column_stack([values[met], values[met + 1]]) for values in (u, v))
    found = []
    for offset in offsets:
        touches = bool((v == offset).any())
        sides = []
        for above in (v > offset, v >= offset)[: 1 + touches]:
            k = above[:, 0] != above[:, 1]
            at = u[k, 0] + (offset - v[k, 0]) / (v[k, 1] - v[k, 0]) * (u[k, 1] - u[k, 0])
            sides.append(np.sort(at).reshape(-1, 2))
        begins, ends = (_joined(np.vstack(sides)) if touches else sides[0]).T
        found.append(ends - begins)
    return found


def _joined(stretches: FloatArray) -> FloatArray:
    """Return the union of stretches (N, 2) of a line, those that touch as one."""
    stretches = stretches[np.argsort(stretches[:, 0], kind="stable")]
    reach = np.maximum.accumulate(stretches[:, 1])
    is_first = np.r_[True, stretches[1:, 0] > reach[:-1]][: len(stretches)]
    is_last = np.r_[is_first[1:], True][: len(stretches)]
    joined: FloatArray = np.column_stack([stretches[is_first, 0], reach[is_last]])
    return joined


def shortest_m(config: SwathConfig, spacing_m: float, turn_m: float) -> float:
    """Return the length of the shortest swath worth driving [m]: half a spacing to get there, and two turns at each end.

    >>> shortest_m(SwathConfig(swaths=4), 40.0, 4.0)
    36.0
    """
    return 0.5 * spacing_m + 4.0 * turn_m if config.shortest_m is None else config.shortest_m


def n_lines(width_m: float, config: SwathConfig) -> int:
    """Return the number of lines that a width takes at the wanted spacing."""
    if config.spacing_m is None:
        return config.swaths or 1
    require_lines(int(min(width_m / config.spacing_m, 1e15)), width_m)
    # A width that is an integer number of spacings must not gain a line by rounding.
    return max(int(np.ceil(width_m / config.spacing_m + 1.0 - 2.0 * config.outer_share - 1e-9)), 1)


def towards(corner: Corner | None) -> FloatArray:
    """Return the direction (2,) in which a corner lies; the south-western one by default."""
    return np.array(_TOWARDS[corner or "south-west"])


def axes_of(heading_deg: float) -> tuple[FloatArray, FloatArray]:
    """Return the unit vectors along a heading and to its left; exact for multiples of 90°."""
    quarter, rest = divmod(heading_deg, 90.0)
    c, s = (float(np.cos(np.radians(rest))), float(np.sin(np.radians(rest)))) if rest else (1.0, 0.0)
    for _ in range(int(quarter) % 4):
        c, s = -s, c
    return np.array([c, s]) + 0.0, np.array([-s, c]) + 0.0


def narrowest_heading(polygon: Any) -> float:
    """Return the heading [deg, 0 to 180) across which a polygon is narrowest.

    The narrowest direction of a convex polygon is square to one of its edges (Houle and
    Toussaint 1988). Of equally good headings the one nearest to east is taken.
    """
    hull = shapely.get_coordinates(polygon.convex_hull)
    edges = np.diff(hull, axis=0)
    headings = np.round(np.degrees(np.arctan2(edges[:, 1], edges[:, 0])) % 180.0, 9) % 180.0
    widths = np.array([np.ptp(hull @ axes_of(heading)[1]) for heading in headings])
    # A nanometre per metre of slack makes opposite edges of a rectangle equally good.
    good = headings[widths <= widths.min() * (1.0 + 1e-9)]
    return float(good[np.argmin(np.minimum(good, 180.0 - good))])


def pieces_on(shape: Any, line: FloatArray) -> list[FloatArray]:
    """Return the parts of a polyline that lie in a shape, in its order and direction."""
    full = shapely.linestrings(line)
    cut = shapely.get_parts(shapely.intersection(shape, full))
    parts = [part for part in cut if part.geom_type == "LineString" and part.length > CRUMB_M]
    if len(parts) > 1:
        # A line that touches a corner or runs along a border comes back in pieces.
        parts = list(shapely.get_parts(shapely.line_merge(shapely.multilinestrings(parts))))
    arrays = []
    for part in parts:
        xy = shapely.get_coordinates(part)
        xy = xy[[0, -1]] if len(line) == 2 else xy
        ends = shapely.line_locate_point(full, shapely.points(xy[[0, -1]]))
        arrays.append((float(min(ends)), xy if ends[0] <= ends[1] else xy[::-1]))
    return [xy for _, xy in sorted(arrays, key=lambda item: item[0])]


def shortened(axis: FloatArray, inset_m: float) -> FloatArray:
    """Shorten an axis at both ends, by at most 0.4 of its length, so that something is left."""
    length = float(np.hypot(*(axis[1] - axis[0])))
    share = min(inset_m / length, 0.4)
    return np.array([axis[0] + share * (axis[1] - axis[0]), axis[1] - share * (axis[1] - axis[0])])


def _from_corner(
    lines: list[tuple[FloatArray, ...]], area: SurveyArea, corner: Corner | None
) -> tuple[tuple[FloatArray, ...], ...]:
    """Turn order and direction of the lines so that the first one begins at the wanted corner."""
    best, least = lines, np.inf
    for reverse_order, reverse_direction in product((False, True), repeat=2):
        order = lines[::-1] if reverse_order else lines
        turned = [tuple(axis[::-1] for axis in line[::-1]) for line in order] if reverse_direction else order
        first = turned[0][0][0]
        if corner is None and len(area.starts):
            cost = float(np.hypot(*(first - area.starts[0])))
        else:
            cost = -float((first - area.reference) @ towards(corner))
        if cost < least - 1e-6:
            best, least = turned, cost
    return tuple(best)


def swaths_text(route: Route) -> str:
    """Return the number of swaths in words, with the number of lines where some are cut into pieces.

    Returns: such as ``"4 swaths"`` or ``"4 lines in 6 pieces"``.
    """
    n_lines, n_pieces = route.n_lines, len(route.swaths)
    if n_lines < n_pieces:
        return f"{n_lines} line{'s' * (n_lines > 1)} in {n_pieces} pieces"
    return f"{n_pieces} swath{'s' * (n_pieces > 1)}"

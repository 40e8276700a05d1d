"""Survey areas and routes on maps."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline
from shapely import MultiPolygon, Polygon, get_coordinates, get_parts

from survey.core.arrays import FloatArray
from survey.data.area import SurveyArea
from survey.data.legs import Leg
from survey.data.route import Route
from survey.figures.style import INK, MUTED, NO_GO, ROVERS

_CASING = [patheffects.withStroke(linewidth=3.2, foreground="white")]


def draw_area(axes: Axes, area: SurveyArea, *, veil: bool = True) -> list[Patch]:
    """Draw the outline, a veil over what lies outside, and no-go ground hatched; return legend entries."""
    axes.add_patch(PathPatch(outline_path(area.polygon), fill=False, edgecolor=INK, linewidth=1.3, zorder=4))
    if veil:
        (xmin, xmax), (ymin, ymax) = axes.get_xlim(), axes.get_ylim()
        outside = Polygon([(xmin, ymin), (xmax, ymin), (xmax, ymax), (xmin, ymax)]).difference(area.polygon)
        if outside.area > 0.0:
            axes.add_patch(
                PathPatch(outline_path(outside), facecolor="white", edgecolor="none", alpha=0.6, zorder=3)
            )
    handles = [Patch(fill=False, edgecolor=INK, linewidth=1.3, label="Survey area")]
    style: dict[str, Any] = {"facecolor": "#ffffff80", "edgecolor": NO_GO, "linewidth": 0.9, "hatch": "////"}
    for zone in area.no_go:
        axes.add_patch(PathPatch(outline_path(zone), zorder=4, **style))
    if area.no_go:
        handles.append(Patch(label="No-go", **style))
    return handles


def draw_left_out(axes: Axes, pieces: Sequence[Polygon]) -> list[Patch]:
    """Draw pieces of the area where rovers cannot be, dotted; return legend entries."""
    look: dict[str, Any] = {"facecolor": "#ffffff80", "edgecolor": MUTED, "linewidth": 0.6, "hatch": "...."}
    for piece in pieces:
        axes.add_patch(PathPatch(outline_path(piece), zorder=3.8, **look))
    return [Patch(label="Not drivable", **look)] if pieces else []


def outline_path(shape: Polygon | MultiPolygon) -> Outline:
    """Turn polygons with holes into one compound path."""
    rings = [
        Outline(get_coordinates(ring), closed=True)
        for part in get_parts(shape)
        if part.geom_type == "Polygon"
        for ring in (part.exterior, *part.interiors)
    ]
    return Outline.make_compound_path(*rings)


def draw_route_lines(axes: Axes, route: Route) -> None:
    """Draw the swaths as thin neutral lines, for maps that are about something else."""
    for leg in route.swaths:
        axes.plot(*leg.xy.T, color="#000000", linewidth=0.7, alpha=0.55, zorder=3.5)


def draw_route(axes: Axes, route: Route) -> list[Line2D]:
    """Draw swaths with numbers and arrows, transits dashed, one colour for each rover; return legend entries."""
    handles = []
    for rover in range(route.n_rovers):
        colour = ROVERS[rover % len(ROVERS)]
        swaths = [leg for leg in route.swaths if leg.rover == rover]
        for leg in route.legs:
            if leg.rover == rover:
                _draw_leg(axes, leg, colour)
        _number_swaths(axes, swaths, colour)
        _mark_ends(axes, route.path(rover), colour)
        name = "Swaths" if route.n_rovers == 1 else f"Rover {rover + 1}, swaths"
        handles.append(Line2D([], [], color=colour, linewidth=2.0, label=f"{name} ({len(swaths)})"))
    colour = ROVERS[0] if route.n_rovers == 1 else MUTED
    if any(leg.kind == "transit" for leg in route.legs):
        handles.append(Line2D([], [], color=colour, linewidth=1.3, linestyle=(0, (3, 2)), label="Transit"))
    for marker, label in (("^", "Start"), ("s", "End")):
        handles.append(
            Line2D(
                [],
                [],
                color=colour,
                marker=marker,
                markeredgecolor="white",
                markersize=7,
                linestyle="none",
                label=label,
            )
        )
    return handles


def _draw_leg(axes: Axes, leg: Leg, colour: str) -> None:
    if leg.kind == "transit":
        axes.plot(
            *leg.xy.T, color=colour, linewidth=1.3, linestyle=(0, (3, 2)), path_effects=_CASING, zorder=5
        )
        return
    axes.plot(*leg.xy.T, color=colour, linewidth=2.0, path_effects=_CASING, zorder=5.2)
    # The arrow's head follows the straight line over a twentieth of the swath, so that windings do not turn it.
    tail, head = along(leg.xy, 0.48), along(leg.xy, 0.53)
    axes.annotate(
        "",
        xy=(head[0], head[1]),
        xytext=(tail[0], tail[1]),
        arrowprops={
            "arrowstyle": "-|>",
            "color": colour,
            "mutation_scale": 19,
            "linewidth": 0.0,
            "shrinkA": 0.0,
            "shrinkB": 0.0,
        },
        zorder=5.4,
    )


def along(xy: FloatArray, shares: npt.ArrayLike) -> FloatArray:
    """Return the places (..., 2) at shares of the length of a polyline (N, 2).

    Examples
    --------
    >>> along(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0]]), 0.75)
    array([4., 2.])
    """
    distance = np.r_[0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T))]
    wanted = np.asarray(shares) * distance[-1]
    return np.stack([np.interp(wanted, distance, xy[:, axis]) for axis in (0, 1)], axis=-1)


def _number_swaths(axes: Axes, swaths: list[Leg], colour: str) -> None:
    """Write the swaths' numbers in driving order, at most a dozen of them."""
    every = math.ceil(len(swaths) / 12)
    box = {"boxstyle": "circle,pad=0.22", "facecolor": "white", "edgecolor": colour, "linewidth": 1.0}
    for number, leg in enumerate(swaths, start=1):
        if (number - 1) % every == 0:
            place = along(leg.xy, 0.2)
            axes.text(
                place[0], place[1], str(number), ha="center", va="center", fontsize=7.5, bbox=box, zorder=6
            )


def _mark_ends(axes: Axes, path: FloatArray, colour: str) -> None:
    for marker, place in (("^", path[0]), ("s", path[-1])):
        axes.plot(
            place[0],
            place[1],
            marker=marker,
            color=colour,
            markersize=8,
            markeredgecolor="white",
            clip_on=False,
            zorder=7,
        )

"""Figures of plans: a route over the predicted standard deviation, and the design of a season.

`plan_map` shows the area, the route and the standard deviation that it leads to. `season_plot` shows the error
against the number of swaths for each number of stakes, and the causes of the error of the chosen design.
"""

import math
from collections.abc import Mapping, Sequence

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from shapely import Polygon

from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.figures.layout import add_colour_bar, draw_scale_and_north, map_figure, widen
from survey.figures.map_layers import (
    decimate,
    draw_area,
    draw_contours,
    draw_left_out,
    draw_raster,
    draw_relief,
    draw_route,
    draw_smooth,
    elevation_limits,
    relief_exaggeration,
)
from survey.figures.style import CLAIM, ELEVATION, ESTIMATE, FULL_IN, INK, MUTED, styled


@styled
def plan_map(
    area: SurveyArea,
    route: Route,
    *,
    terrain: Dem | None = None,
    std: Dem | None = None,
    left_out: Sequence[Polygon] = (),
) -> Figure:
    """Draw a planned route over the known terrain and the predicted standard deviation.

    Swaths are numbered in driving order and carry an arrow, transits are dashed, each
    rover has its colour. Colours show the predicted standard deviation of the map,
    or the elevation where no prediction is given.

    Parameters
    ----------
    area : SurveyArea
        Outline and no-go zones; ground outside is veiled.
    route : Route
        In the CRS of the area.
    terrain : Dem, optional
        Prior terrain, drawn as hillshade with contours.
    std : Dem, optional
        Predicted standard deviation, e.g. ``planners.predict_error(…).std`` [m].
    left_out : sequence of shapely.Polygon, optional
        Pieces of the area where rovers cannot be.

    $page

    Raises
    ------
    InputError
        When route or terrain are in another CRS than the area.

    Examples
    --------
    >>> from survey.data.route import Leg
    >>> area = SurveyArea.rectangle((0.0, 0.0, 40.0, 20.0), "EPSG:32608")
    >>> route = Route((Leg("swath", [[0.0, 10.0], [40.0, 10.0]]),), "EPSG:32608", "line")
    >>> plan_map(area, route).axes[0].get_title(loc="left")
    'Survey plan'
    """
    area.require_crs(route.crs, "the route")
    bounds = _extent(area)
    drawing = map_figure(FULL_IN, bounds, legend=True)
    axes = drawing.maps[0]
    handles: list[Artist] = []
    if terrain is not None:
        area.require_crs(terrain.crs, "the terrain")
        terrain = decimate(terrain)
        handles += draw_contours(axes, terrain, within=area)
        draw_relief(axes, terrain, exaggeration=relief_exaggeration(terrain))
    axes.set(xlim=bounds[::2], ylim=bounds[1::2])
    handles += [*draw_area(axes, area), *draw_left_out(axes, left_out), *draw_route(axes, route)]
    if std is not None:
        image = draw_smooth(axes, std, area.free)
        add_colour_bar(image, drawing, "Predicted standard deviation [m]")
    elif terrain is not None:
        image = draw_raster(axes, terrain.elevation, terrain, ELEVATION, elevation_limits(terrain))
        add_colour_bar(image, drawing, "Elevation [m]")
    else:
        drawing.bar.set_axis_off()
    draw_scale_and_north(drawing, crs=area.crs)
    axes.set_title("Survey plan")
    columns = len(handles) if len(handles) <= 6 else math.ceil(len(handles) / 2)
    drawing.figure.legend(handles=handles, loc="lower center", ncols=columns, columnspacing=1.6)
    return drawing.figure


def _extent(area: SurveyArea) -> tuple[float, float, float, float]:
    """Return the extent of the map: the area with a margin of 4 %."""
    xmin, ymin, xmax, ymax = area.bounds
    pad = 0.04 * max(xmax - xmin, ymax - ymin)
    return widen((xmin - pad, ymin - pad, xmax + pad, ymax + pad))


@styled
def season_plot(
    errors: Mapping[int, Sequence[tuple[int, float]]],
    wanted: float,
    chosen: tuple[int, float],
    parts_m: Mapping[str, float],
    unit: str,
) -> Figure:
    """Draw the error of a season's mass balance against swaths, and the parts of the chosen design.

    `parts_m`: standard deviations of the chosen design by cause [m].
    """
    figure = Figure(figsize=(FULL_IN, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    _draw_errors(left, errors, wanted, chosen, unit)
    right.barh(list(parts_m), list(parts_m.values()), color=ESTIMATE)
    right.invert_yaxis()
    right.set_xlabel("Standard deviation (m)")
    right.set_title("Chosen design, by cause")
    return figure


def _draw_errors(
    axes: Axes,
    errors: Mapping[int, Sequence[tuple[int, float]]],
    wanted: float,
    chosen: tuple[int, float],
    unit: str,
) -> None:
    """Draw a line for each number of stakes, the wanted error, and the chosen design."""
    for index, (n_stakes, line) in enumerate(errors.items()):
        shade = 0.35 + 0.65 * index / max(len(errors) - 1, 1)
        axes.plot(
            *zip(*line, strict=True), color=ESTIMATE, alpha=shade, marker=".", label=f"{n_stakes} stakes"
        )
    axes.axhline(wanted, color=MUTED, linestyle="--", label="wanted")
    axes.plot(*chosen, "o", color=CLAIM, markeredgecolor=INK, label="chosen")
    axes.set_xlabel("Swaths")
    axes.set_ylabel(f"Half the 95 % interval ({unit})")
    axes.set_ylim(bottom=0.0)
    axes.legend()

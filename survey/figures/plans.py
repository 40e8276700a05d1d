"""Map of a planned route over the predicted standard deviation of the survey."""

import math
from collections.abc import Sequence

from matplotlib.artist import Artist
from matplotlib.figure import Figure
from shapely import Polygon

from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.figures.cartography.layout import add_colour_bar, map_figure, widened
from survey.figures.cartography.relief import (
    draw_contours,
    draw_raster,
    draw_relief,
    draw_smooth,
    elevation_limits,
    relief_exaggeration,
    thinned,
)
from survey.figures.cartography.routes import draw_area, draw_left_out, draw_route
from survey.figures.cartography.scale_bar import draw_scale_and_north
from survey.figures.style import ELEVATION, FULL_IN, styled


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

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page.

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
    bounds = _view(area)
    drawing = map_figure(FULL_IN, bounds, legend=True)
    axes = drawing.maps[0]
    handles: list[Artist] = []
    if terrain is not None:
        area.require_crs(terrain.crs, "the terrain")
        terrain = thinned(terrain)
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


def _view(area: SurveyArea) -> tuple[float, float, float, float]:
    """Return what is shown: the area with a margin of 4 %."""
    xmin, ymin, xmax, ymax = area.bounds
    pad = 0.04 * max(xmax - xmin, ymax - ymin)
    return widened((xmin - pad, ymin - pad, xmax + pad, ymax + pad))

"""Maps of the sheets: relief with contours, area, route of all or of one rover, smooth standard deviation."""

import math

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.image import AxesImage
from shapely import Polygon

from survey.core.arrays import Bounds
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.figures.cartography.layout import MapFigure
from survey.figures.cartography.relief import (
    draw_contours,
    draw_raster,
    draw_relief,
    draw_smooth,
    elevation_limits,
    relief_exaggeration,
)
from survey.figures.cartography.routes import draw_area, draw_left_out, draw_route
from survey.figures.cartography.scale_bar import draw_scale_and_north
from survey.figures.sheets.content import PlanContent
from survey.figures.sheets.frame import Page
from survey.figures.style import ELEVATION, INK

_MARGIN = 0.03


def add_plan_map(page: Page, content: PlanContent, route: Route, tallest_in: float) -> int:
    """Add the map of a route to a page; return the denominator of its scale."""
    axes, scale = page.map_axes(_view(content.area, route), tallest_in)
    limits = axes.get_xlim(), axes.get_ylim()
    handles: list[Artist] = []
    if content.terrain is not None:
        terrain = content.terrain
        image = draw_raster(axes, terrain.elevation, terrain, ELEVATION, elevation_limits(terrain))
        draw_relief(axes, terrain, exaggeration=relief_exaggeration(terrain))
        handles += draw_contours(axes, terrain, within=content.area)
        _colour_bar(page, axes, image, "Elevation [m]")
    axes.set(xlim=limits[0], ylim=limits[1])
    handles += [
        *draw_area(axes, content.area),
        *draw_left_out(axes, [piece for piece, _ in content.left_out]),
        *draw_route(axes, route),
    ]
    _finish(page, axes, content, handles)
    return scale


def add_deviation_map(page: Page, content: PlanContent, std: Dem, tallest_in: float) -> int:
    """Add the map of the predicted standard deviation, with the swaths; return the denominator of its scale."""
    axes, scale = page.map_axes(_view(content.area, content.route), tallest_in)
    image = draw_smooth(axes, std, content.area.free)
    for leg in content.route.swaths:
        axes.plot(*leg.xy.T, color=INK, linewidth=0.6, alpha=0.7, zorder=3.5)
    handles: list[Artist] = [*draw_area(axes, content.area, veil=False)]
    _colour_bar(page, axes, image, "Predicted standard deviation [m]")
    _finish(page, axes, content, handles)
    return scale


def _view(area: SurveyArea, route: Route) -> Bounds:
    """Return the bounds of area and route, with a margin."""
    places = np.vstack([leg.xy for leg in route.legs])
    west, south, east, north = area.bounds
    xmin, ymin = min(west, places[:, 0].min()), min(south, places[:, 1].min())
    xmax, ymax = max(east, places[:, 0].max()), max(north, places[:, 1].max())
    pad = _MARGIN * max(xmax - xmin, ymax - ymin)
    return float(xmin - pad), float(ymin - pad), float(xmax + pad), float(ymax + pad)


def _colour_bar(page: Page, axes: Axes, image: AxesImage, label: str) -> None:
    bar = page.figure.colorbar(image, cax=page.bar_axes(axes))
    bar.set_label(label, fontsize=7.0)
    bar.ax.tick_params(labelsize=6.5)
    bar.outline.set_visible(False)


def _finish(page: Page, axes: Axes, content: PlanContent, handles: list[Artist]) -> None:
    """Add scale bar, north arrow and legend."""
    draw_scale_and_north(MapFigure(page.figure, [axes], axes), crs=content.area.crs)
    axes.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=(0.0, -0.36 / (axes.get_position().height * page.figure.get_figheight())),
        ncols=min(len(handles), 6),
        fontsize=6.8,
        borderaxespad=0.0,
        columnspacing=1.2,
        handlelength=1.6,
    )
    page.top_in -= 0.14 * math.ceil(len(handles) / 6) + 0.06


def areas_by_reason(left_out: tuple[tuple[Polygon, str], ...]) -> dict[str, tuple[float, int]]:
    """Return area [m², in the CRS] and number of pieces by reason, the largest area first."""
    found: dict[str, tuple[float, int]] = {}
    for piece, reason in left_out:
        area, count = found.get(reason, (0.0, 0))
        found[reason] = (area + piece.area, count + 1)
    return dict(sorted(found.items(), key=lambda entry: -entry[1][0]))

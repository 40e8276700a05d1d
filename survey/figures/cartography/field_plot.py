"""Map of a field over the survey area: a quantity of the payload, its standard deviation, or a probability."""

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure

from survey.core.arrays import FloatArray
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.figures.cartography.layout import add_colour_bar, map_figure, view
from survey.figures.cartography.relief import draw_raster
from survey.figures.cartography.routes import draw_area, draw_route_lines
from survey.figures.style import DEVIATION, HALF_IN, styled


def quantity_plot(dem: Dem, label: str, *, area: SurveyArea, route: Route) -> Figure:
    """Draw the map of a quantity; `label` is its name and unit."""
    values = _inside(dem, area)
    low, high = (float(v) for v in np.nanpercentile(values, [0.5, 99.5]))
    limits = Normalize(low, max(high, low + 1e-9))
    words = (label.split(" [", maxsplit=1)[0], label)
    return _plot(dem, values, (colormaps["cividis"], limits), words, (area, route))


def uncertainty_plot(dem: Dem, label: str, *, area: SurveyArea, route: Route) -> Figure:
    """Draw the standard deviation of a quantity; `label` is the quantity's name and unit."""
    values = _inside(dem, area)
    limits = Normalize(0.0, max(float(np.nanpercentile(values, 99.5)), 1e-9))
    words = ("Claimed uncertainty (1 σ)", f"1 σ of {label}")
    return _plot(dem, values, (DEVIATION, limits), words, (area, route))


def probability_plot(dem: Dem, title: str, *, area: SurveyArea, route: Route) -> Figure:
    """Draw a map of probabilities."""
    words = (title, "Probability")
    return _plot(dem, _inside(dem, area), (DEVIATION, Normalize(0.0, 1.0)), words, (area, route))


def _inside(dem: Dem, area: SurveyArea) -> FloatArray:
    return np.where(area.contains(dem.xy).reshape(dem.shape), dem.elevation, np.nan)


@styled
def _plot(
    dem: Dem,
    values: FloatArray,
    colours: tuple[Colormap, Normalize],
    words: tuple[str, str],
    place: tuple[SurveyArea, Route],
) -> Figure:
    """Draw values on the grid of a raster, half a page wide, with a title and the label of the colours."""
    drawing = map_figure(HALF_IN, view(dem, place[0]))
    image = draw_raster(drawing.maps[0], values, dem, *colours)
    draw_area(drawing.maps[0], place[0])
    draw_route_lines(drawing.maps[0], place[1])
    add_colour_bar(image, drawing, words[1])
    drawing.maps[0].set_title(words[0])
    return drawing.figure

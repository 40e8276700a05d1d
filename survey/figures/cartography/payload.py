"""Map of a quantity of a science payload, beside its standard deviation."""

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from survey.data.area import SurveyArea
from survey.data.route import Route
from survey.figures.cartography.layout import add_colour_bar, map_figure, view
from survey.figures.cartography.relief import draw_raster
from survey.figures.cartography.routes import draw_area, draw_route_lines
from survey.figures.style import DEVIATION, HALF_IN, styled
from survey.reconstruction.base import Reconstruction


@styled
def payload_plot(
    mapped: Reconstruction, label: str, *, area: SurveyArea, route: Route, is_deviation: bool
) -> Figure:
    """Draw the map of a quantity, or its standard deviation.

    Parameters
    ----------
    mapped : Reconstruction
        Map of the quantity.
    label : str
        Name and unit.
    area : SurveyArea
        Only nodes inside are shown.
    route : Route
        Its swaths are drawn as thin lines.
    is_deviation : bool
        Whether to draw the standard deviation.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as half a page.
    """
    shown = mapped.std if is_deviation else mapped.mean
    drawing = map_figure(HALF_IN, view(shown, area))
    values = np.where(area.contains(shown.xy).reshape(shown.shape), shown.elevation, np.nan)
    low, high = (float(v) for v in np.nanpercentile(values, [0.5, 99.5]))
    limits = Normalize(0.0 if is_deviation else low, max(high, low + 1e-9))
    image = draw_raster(
        drawing.maps[0], values, shown, DEVIATION if is_deviation else colormaps["cividis"], limits
    )
    draw_area(drawing.maps[0], area)
    draw_route_lines(drawing.maps[0], route)
    add_colour_bar(image, drawing, f"1 σ of {label}" if is_deviation else label, extend="both")
    drawing.maps[0].set_title(
        "Claimed uncertainty (1 σ)" if is_deviation else label.split(" [", maxsplit=1)[0]
    )
    return drawing.figure

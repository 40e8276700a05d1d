"""Map of the landmarks of a localization."""

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from survey.core.quantity_text import round_number
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.data.surface_points import SurfacePoints
from survey.figures.cartography.layout import (
    add_colour_bar,
    grouped,
    map_figure,
    view,
)
from survey.figures.maps import draw_outline_and_route
from survey.figures.style import DENSITY, HALF_IN, INK, styled


@styled
def landmark_map(
    points: SurfacePoints,
    terrain: Dem,
    *,
    area: SurveyArea | None = None,
    route: Route | None = None,
    name: str = "Landmarks",
) -> Figure:
    """Draw the density of the measured points.

    Points are counted in squares of a round size, about thirty to the longer side.

    Parameters
    ----------
    points : SurfacePoints
        Landmarks or other measured points.
    terrain : Dem
        Gives what is shown.
    area : SurveyArea, optional
        Its outline is drawn and sets what is shown.
    route : Route, optional
        Its swaths are drawn as thin lines.
    name : str
        What the points are.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as half a page.

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 60.0, 40.0), 2.0)
    >>> flat = Dem.on(grid, np.zeros(grid.shape))
    >>> xyz = np.column_stack([grid.xy, np.zeros(len(grid.xy))])
    >>> points = SurfacePoints(xyz, sigma_m=np.full(len(xyz), 0.1), crs="EPSG:32608")
    >>> landmark_map(points, flat).axes[0].get_xlabel()
    'Easting [m]'
    """
    bounds = view(terrain, area)
    drawing = map_figure(HALF_IN, bounds)
    axes = drawing.maps[0]
    xmin, ymin, xmax, ymax = bounds
    cell = round_number(max(xmax - xmin, ymax - ymin) / 30.0)
    east, north = np.arange(xmin, xmax + cell, cell), np.arange(ymin, ymax + cell, cell)
    x, y = points.xy.T
    counts = np.histogram2d(x, y, bins=[east, north])[0].T
    top = float(np.percentile(counts[counts > 0], 98.0)) if counts.any() else 1.0
    shown = np.where(counts > 0, counts, np.nan)
    image = axes.pcolormesh(east, north, shown, cmap=DENSITY, norm=Normalize(0.0, top), zorder=1)
    axes.plot(*points.xy.T, ".", color=INK, alpha=0.5, markersize=1.2, markeredgewidth=0, zorder=2)
    axes.set(xlim=(xmin, xmax), ylim=(ymin, ymax))
    draw_outline_and_route(axes, area, route)
    add_colour_bar(
        image, drawing, f"Points per {cell:g} m square", extend="max" if counts.max() > top else "neither"
    )
    axes.set_title(f"{name} ({grouped(len(points))})")
    return drawing.figure

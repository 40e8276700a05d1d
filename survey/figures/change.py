"""Map of the change between two surveys."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from shapely import MultiPolygon, Polygon

from survey.figures.cartography.layout import add_colour_bar, map_figure, view
from survey.figures.cartography.relief import draw_raster, thinned
from survey.figures.cartography.routes import outline_path
from survey.figures.cartography.scale_bar import draw_scale_and_north
from survey.figures.style import ERROR, FULL_IN, INK, VEIL, styled, symmetric_limits
from survey.scoring.change.results import Change


@styled
def change_map(change: Change, outlines: Mapping[str, Polygon | MultiPolygon]) -> Figure:
    """Draw the difference of two surveys; changes that are not significant are veiled.

    Parameters
    ----------
    change : Change
        The surveys' difference.
    outlines : mapping of str to polygon
        Drawn on top [m].

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page.

    Examples
    --------
    >>> import shapely
    >>> from survey.data.dem import Dem
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 40.0, 20.0), 10.0)
    >>> difference = Dem.on(grid, np.linspace(-1.0, 1.0, 15).reshape(grid.shape))
    >>> change = Change(difference, np.full(grid.shape, 0.2), np.ones(grid.shape), (), "variogram")
    >>> change_map(change, {"ice": shapely.box(5.0, 5.0, 20.0, 15.0)}).axes[0].get_xlabel()
    'Easting [m]'
    """
    difference = thinned(change.difference)
    step = round(difference.step_m / change.difference.step_m)
    doubtful = np.asarray(change.significant)[::step, ::step] == 0
    drawing = map_figure(FULL_IN, view(change.difference, None), legend=True)
    axes = drawing.maps[0]
    image = draw_raster(axes, difference.elevation, difference, ERROR, symmetric_limits(difference.elevation))
    veil = np.zeros((*difference.shape, 4))
    veil[...] = (1.0, 1.0, 1.0, 0.0)
    veil[..., 3] = np.where(doubtful & np.isfinite(difference.elevation), 0.65, 0.0)
    xmin, ymin, xmax, ymax = difference.bounds
    axes.imshow(veil, extent=(xmin, xmax, ymin, ymax), zorder=1.5)
    axes.set(xlim=axes.get_xlim(), ylim=axes.get_ylim())
    for shape in outlines.values():
        axes.add_patch(PathPatch(outline_path(shape), fill=False, edgecolor=INK, linewidth=1.3, zorder=4))
    add_colour_bar(image, drawing, "Change of height [m]", extend="both")
    draw_scale_and_north(drawing, crs=change.difference.crs)
    axes.set_title("Later \u2212 earlier")
    handles = [
        Line2D([], [], color=INK, linewidth=1.3, label="Outline"),
        Patch(facecolor="white", edgecolor=VEIL, label="Pale: not significant at 95 %"),
    ]
    drawing.figure.legend(handles=handles, loc="lower center", ncols=2)
    return drawing.figure

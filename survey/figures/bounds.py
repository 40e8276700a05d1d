"""Map of the width of the interval between lower and upper bound."""

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from survey.figures.cartography.layout import add_colour_bar, map_figure, view
from survey.figures.cartography.relief import draw_raster
from survey.figures.style import DEVIATION, HALF_IN, styled
from survey.reconstruction.base import UNSEEN, Reconstruction


@styled
def width_map(reconstruction: Reconstruction) -> Figure:
    """Draw the distance between the lower and the upper bound of the elevation.

    Parameters
    ----------
    reconstruction : Reconstruction
        The map; without bounds of its own those of its standard deviation are drawn.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as half a page.

    Examples
    --------
    >>> from survey.data.dem import Dem
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 40.0, 20.0), 10.0)
    >>> level = Dem.on(grid, np.ones(grid.shape))
    >>> width_map(Reconstruction(level, level, np.ones(grid.shape), "gp", {})).axes[0].get_title(loc="left")
    'Between the bounds'
    """
    lower, upper = reconstruction.interval()
    width = np.where(reconstruction.support == UNSEEN, np.nan, upper.elevation - lower.elevation)
    drawing = map_figure(HALF_IN, view(reconstruction.mean, None))
    stated = width[np.isfinite(width)]
    top = float(np.percentile(stated, 99.0)) if stated.size else 1.0
    image = draw_raster(
        drawing.maps[0], width, reconstruction.mean, DEVIATION, Normalize(0.0, max(top, 1e-9))
    )
    add_colour_bar(image, drawing, "Upper - lower [m]", extend="max" if (stated > top).any() else "neither")
    drawing.maps[0].set_title("Between the bounds")
    return drawing.figure

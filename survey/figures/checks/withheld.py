"""Test of a map in tiles by withheld cells: reliability diagram and coverage over the map."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from survey.core.arrays import Bounds, FloatArray
from survey.figures.style import FULL_IN, MUTED, REFERENCE, styled


@styled
def withheld_plot(reliability: Mapping[float, float], coverage: FloatArray, bounds: Bounds) -> Figure:
    """Draw the reliability diagram of a map in tiles, and where its 95 % intervals held the withheld cells.

    Parameters
    ----------
    reliability : mapping of float to float
        Share of withheld cells within the interval of each nominal coverage.
    coverage : (H, W) ndarray
        Share of withheld cells within the 95 % interval, in blocks, the first row the southern one; NaN without cells.
    bounds : (xmin, ymin, xmax, ymax)
        Edges of the blocks [m].

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page.
    """
    figure = Figure(figsize=(FULL_IN, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot([0, 1], [0, 1], color=MUTED, linewidth=1.0, linestyle="--", label="Reliable")
    left.plot(
        list(reliability),
        list(reliability.values()),
        color=REFERENCE,
        marker="o",
        markersize=3.5,
        label="Map",
    )
    left.set(xlim=(0, 1), ylim=(0, 1), aspect="equal", title="Withheld cells")
    left.set(xlabel="Nominal coverage", ylabel="Cells within the interval")
    for axis in (left.xaxis, left.yaxis):
        axis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    left.legend(loc="upper left")
    _draw_coverage(right, coverage, bounds)
    return figure


def _draw_coverage(axes: Axes, coverage: FloatArray, bounds: Bounds) -> None:
    west, south, east, north = bounds
    image = axes.imshow(
        np.ma.masked_invalid(coverage),
        extent=(west, east, south, north),
        origin="lower",
        vmin=0.85,
        vmax=1.0,
        cmap="cividis",
        interpolation="nearest",
    )
    axes.set(title="Within the 95 % interval", xlabel="Easting [m]", ylabel="Northing [m]")
    axes.figure.colorbar(image, ax=axes, format=PercentFormatter(1.0, decimals=0), extend="min")

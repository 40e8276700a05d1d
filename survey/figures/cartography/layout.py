"""Layout of maps: what they show, their axes, titles, and scale of the page."""

import math
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from survey.core.arrays import Bounds
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.figures.style import VEIL

_TALLEST_MAP_IN = 6.2
MAP, COLOUR_BAR = "map", "colour bar"
"""Labels of the axes of maps and of their colour bar."""


class MapFigure(NamedTuple):
    """A figure with its maps, left to right, and the place of their colour bar."""

    figure: Figure
    maps: list[Axes]
    bar: Axes


def view(dem: Dem, area: SurveyArea | None) -> Bounds:
    """Return what a map shows: the area with a margin of 4 %, as far as the DEM reaches.

    Strips are shown with ground on both sides, so that title, scale and colour bar have room.
    """
    west, south, east, north = dem.bounds
    if area is None:
        return widened((west, south, east, north))
    xmin, ymin, xmax, ymax = area.bounds
    margin = 0.04 * max(xmax - xmin, ymax - ymin)
    shown = (
        max(xmin - margin, west),
        max(ymin - margin, south),
        min(xmax + margin, east),
        min(ymax + margin, north),
    )
    return widened(shown if shown[0] < shown[2] and shown[1] < shown[3] else dem.bounds)


def widened(bounds: Bounds) -> Bounds:
    """Grow the shorter side to half of the width or to 1 / 2.2 of the height."""
    xmin, ymin, xmax, ymax = bounds
    width, height = xmax - xmin, ymax - ymin
    x, y = 0.5 * max(height / 2.2 - width, 0.0), 0.5 * max(0.5 * width - height, 0.0)
    return xmin - x, ymin - y, xmax + x, ymax + y


def map_figure(width_in: float, bounds: Bounds, *, n_maps: int = 1, legend: bool = False) -> MapFigure:
    """Return empty maps side by side with room for a colour bar, so that figures of one width line up.

    Sizes are set by hand [in]: an automatic layout would place every map a little differently.
    """
    left, right, gap, top = 0.92, 0.94, 0.14, 0.46
    bottom = 0.95 if legend else 0.52
    xmin, ymin, xmax, ymax = bounds
    aspect = (ymax - ymin) / (xmax - xmin)
    room = width_in - left - right
    map_width = min((room - gap * (n_maps - 1)) / n_maps, _TALLEST_MAP_IN / aspect)
    map_height = map_width * aspect
    # A map that is too tall for the page's width stands in its middle.
    left += 0.5 * (room - n_maps * map_width - (n_maps - 1) * gap)
    height_in = bottom + map_height + top
    figure = Figure(figsize=(width_in, height_in))

    def add(start: float, width: float, label: str) -> Axes:
        return figure.add_axes(
            (start / width_in, bottom / height_in, width / width_in, map_height / height_in), label=label
        )

    maps = [add(left + index * (map_width + gap), map_width, MAP) for index in range(n_maps)]
    bar = add(left + n_maps * (map_width + gap) - gap + 0.1, 0.11, COLOUR_BAR)
    for index, axes in enumerate(maps):
        _set_up_map(axes, bounds, first=index == 0, crowded=n_maps > 1)
    return MapFigure(figure, maps, bar)


def _set_up_map(axes: Axes, bounds: Bounds, *, first: bool, crowded: bool) -> None:
    """Give the axes a map's limits, true proportions, and easting and northing in metres."""
    xmin, ymin, xmax, ymax = bounds
    axes.set(xlim=(xmin, xmax), ylim=(ymin, ymax), aspect="equal", facecolor=VEIL, xlabel="Easting [m]")
    axes.spines[:].set_visible(True)
    decimals = _decimals(max(xmax - xmin, ymax - ymin), min(xmax - xmin, ymax - ymin))
    # Where maps stand close together, labels at their edges would run into each other.
    edge = 0.1 * (xmax - xmin) if crowded else 0.0

    def easting(value: float, _: int | None) -> str:
        return grouped(value, decimals) if xmin + edge <= value <= xmax - edge else ""

    axes.xaxis.set_major_formatter(FuncFormatter(easting))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: grouped(value, decimals)))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10]))
    axes.tick_params(axis="y", labelleft=first)
    if first:
        axes.set_ylabel("Northing [m]")


def _decimals(longer_m: float, shorter_m: float) -> int:
    """Return the number of decimals that distinguish the labels of the shorter side.

    Examples
    --------
    >>> _decimals(600.0, 300.0), _decimals(12.0, 6.0), _decimals(0.5, 0.25)
    (0, 1, 2)
    """
    if longer_m >= 20.0:
        return 0
    return max(1, math.ceil(-math.log10(0.2 * shorter_m)))


def grouped(value: float, decimals: int = 0) -> str:
    """Write a number with thin spaces between thousands.

    Examples
    --------
    >>> grouped(6712400.0).split()
    ['6', '712', '400']
    """
    return f"{value:,.{decimals}f}".replace(",", "\u2009").replace("-", "\u2212")


def add_colour_bar(
    mappable: ScalarMappable, drawing: MapFigure, label: str, *, extend: str = "neither"
) -> None:
    """Fill the drawing's place for the colour bar."""
    bar = drawing.figure.colorbar(mappable, cax=drawing.bar, label=label, extend=extend)
    bar.outline.set_visible(False)

"""Layout of figures: axes of maps with scale bar and north arrow, and narrow versions of wide figures for phones.

`map_figure` makes a figure with one or more maps of equal scale; layers are drawn into them by
`survey.figures.map_layers`. The scale bar counts on the ground where the scale factor of the CRS differs from 1
by more than 1 %. `narrow_image` renders a figure with its panels in one column and its legends in two, and
restores the figure.
"""

import math
import textwrap
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, Literal, NamedTuple

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec, SubplotSpec
from matplotlib.legend import Legend
from matplotlib.patches import Rectangle
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, MaxNLocator
from matplotlib.transforms import ScaledTranslation, blended_transform_factory
from PIL.Image import Image
from pyproj import CRS

from survey.core import Bounds, round_number
from survey.core.map_scale import MapScale
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.figures.style import INK, VEIL, page_image, styled

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
        return widen((west, south, east, north))
    xmin, ymin, xmax, ymax = area.bounds
    margin = 0.04 * max(xmax - xmin, ymax - ymin)
    shown = (
        max(xmin - margin, west),
        max(ymin - margin, south),
        min(xmax + margin, east),
        min(ymax + margin, north),
    )
    return widen(shown if shown[0] < shown[2] and shown[1] < shown[3] else dem.bounds)


def widen(bounds: Bounds) -> Bounds:
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

    >>> _decimals(600.0, 300.0), _decimals(12.0, 6.0), _decimals(0.5, 0.25)
    (0, 1, 2)
    """
    if longer_m >= 20.0:
        return 0
    return max(1, math.ceil(-math.log10(0.2 * shorter_m)))


def grouped(value: float, decimals: int = 0) -> str:
    """Write a number with thin spaces between thousands.

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


def draw_scale_and_north(drawing: MapFigure, *, north: bool = True, crs: CRS | None = None) -> None:
    """Draw a scale bar and, where the map has one, a grid-north arrow above the map, where they cover nothing.

    With `crs` the bar counts on the ground where the scale factor of the CRS differs from 1 by more than 1 %.
    """
    axes = drawing.maps[0]
    xmin, xmax = axes.get_xlim()
    width = xmax - xmin
    factor = 1.0 if crs is None else _scale_factor(axes, crs)
    ground_m = round_number(width / factor / 4.0)
    length = ground_m * factor
    end = xmax - 0.09 * width
    inches_above = drawing.figure.dpi_scale_trans + ScaledTranslation(0.0, 1.0, axes.transAxes)  # type: ignore[arg-type]  # it is affine
    place = blended_transform_factory(axes.transData, inches_above)
    across = blended_transform_factory(axes.transAxes, inches_above)
    for start, colour in ((end - length, INK), (end - length / 2.0, "white")):
        bar: dict[str, Any] = {
            "facecolor": colour,
            "edgecolor": INK,
            "linewidth": 0.8,
            "clip_on": False,
            "transform": place,
        }
        axes.add_patch(Rectangle((start, 0.10), length / 2.0, 0.08, **bar))
    text = f"{grouped(ground_m / 1000.0)} km" if ground_m >= 1000.0 else f"{ground_m:g} m"
    axes.text(end - length - 0.015 * width, 0.14, text, transform=place, ha="right", va="center", fontsize=8)
    if not north:
        return
    axes.text(0.955, 0.14, "N", transform=across, ha="center", va="center", fontweight="bold")
    arrow = {"arrowstyle": "-|>", "color": INK, "mutation_scale": 12, "shrinkA": 0, "shrinkB": 0}
    axes.annotate(
        "", xy=(0.985, 0.34), xytext=(0.985, 0.03), xycoords=across, arrowprops=arrow, annotation_clip=False
    )


def _scale_factor(axes: Axes, crs: CRS) -> float:
    """Return the linear scale factor of a CRS over what a map shows; 1 within 1 %."""
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    return MapScale.over(crs, (west, south, east, north)).notable_factor


NARROW_IN = 4.0
"""Width of a narrow figure [in]; a phone shows 90 CSS pixels per inch."""
_LEFT_IN, _RIGHT_IN, _GAP_IN, _AXIS_IN = 0.85, 0.85, 0.8, 0.55
_LEGEND_ROW_IN, _TITLE_LINE_IN = 0.2, 0.17
_LETTERS = 40


@styled
def narrow_image(figure: Figure) -> Image:
    """Draw a wide figure for a phone; the figure itself stays as it is."""
    with _narrowed(figure):
        return page_image(figure)


@contextmanager
def _narrowed(figure: Figure) -> Iterator[None]:
    """Rearrange a figure for as long as the context is open."""
    size = figure.get_figwidth(), figure.get_figheight()
    maps = [axes for axes in figure.axes if axes.get_label() == MAP]
    with ExitStack() as changes:
        changes.enter_context(_two_columns(figure))
        for axes in figure.axes:
            # The title of a single map stands above its scale bar and north arrow.
            changes.enter_context(_wrapped_titles(axes, 2 if maps == [axes] else 0))
        changes.enter_context(_stacked_maps(figure, maps) if maps else _stacked_panels(figure))
        yield
        figure.set_size_inches(*size)


@contextmanager
def _stacked_panels(figure: Figure) -> Iterator[None]:
    """Put the panels of a grid below one another, column after column, each as tall as before."""
    specs = {axes: spec for axes in figure.axes if (spec := axes.get_subplotspec()) is not None}
    n_columns = max((spec.get_gridspec().ncols for spec in specs.values()), default=1)
    order = sorted(specs, key=lambda axes: (specs[axes].colspan.start, specs[axes].rowspan.start))
    ratios = [_height_ratio(specs[axes]) for axes in order]
    column = GridSpec(max(len(order), 1), 1, figure=figure, height_ratios=ratios or None)
    for row, axes in enumerate(order):
        axes.set_subplotspec(column[row, 0])
    figure.set_size_inches(NARROW_IN, figure.get_figheight() * n_columns)
    yield
    for axes, spec in specs.items():
        axes.set_subplotspec(spec)


def _height_ratio(spec: SubplotSpec) -> float:
    ratios: Any = spec.get_gridspec().get_height_ratios()
    return float(ratios[spec.rowspan.start])


@contextmanager
def _stacked_maps(figure: Figure, maps: list[Axes]) -> Iterator[None]:
    """Put maps below one another at one scale, with the colour bar beside all of them."""
    before = {axes: axes.get_position() for axes in figure.axes}
    (west, east), (south, north) = maps[0].get_xlim(), maps[0].get_ylim()
    wide = NARROW_IN - _LEFT_IN - _RIGHT_IN
    tall = wide * (north - south) / (east - west)
    rows = sum(math.ceil(len(legend.legend_handles) / 2) for legend in figure.legends)
    bottom = _AXIS_IN + _LEGEND_ROW_IN * (rows + 0.5 * bool(rows))
    top = 0.15 + _TITLE_LINE_IN * (maps[0].get_title("left").count("\n") + 1)
    stack = len(maps) * tall + (len(maps) - 1) * _GAP_IN
    height = bottom + stack + top

    def place(axes: Axes, left: float, low: float, width: float, up: float) -> None:
        axes.set_position((left / NARROW_IN, low / height, width / NARROW_IN, up / height))

    figure.set_size_inches(NARROW_IN, height)
    for row, axes in enumerate(maps):
        place(axes, _LEFT_IN, bottom + stack - (row + 1) * tall - row * _GAP_IN, wide, tall)
        axes.tick_params(axis="y", labelleft=True)
    for axes in figure.axes:
        if axes.get_label() == COLOUR_BAR:
            place(axes, _LEFT_IN + wide + 0.08, bottom, 0.1, stack)
    yield
    for axes, position in before.items():
        axes.set_position(position)
    for axes in maps[1:]:
        axes.tick_params(axis="y", labelleft=False)


@contextmanager
def _two_columns(figure: Figure) -> Iterator[None]:
    """Draw the legends of a figure and of its panels in two columns."""
    of_figure, of_axes = list(figure.legends), {axes: axes.get_legend() for axes in figure.axes}
    where: Literal["lower center", "outside lower center"] = (
        "lower center" if figure.get_layout_engine() is None else "outside lower center"
    )
    for wide in of_figure:
        wide.remove()
        handles, labels = _entries(wide)
        figure.legend(handles, labels, loc=where, ncols=2)
    for axes, legend in of_axes.items():
        if legend is not None and len(legend.texts) > 2:
            handles, labels = _entries(legend)
            axes.legend(handles, labels, loc="best", ncols=2)
    yield
    figure.legends[:] = of_figure
    for axes, legend in of_axes.items():
        axes.legend_ = legend


def _entries(legend: Legend) -> tuple[list[Artist], list[str]]:
    return [handle for handle in legend.legend_handles if handle], [text.get_text() for text in legend.texts]


@contextmanager
def _wrapped_titles(axes: Axes, n_lines_below: int) -> Iterator[None]:
    """Break long titles into lines, with empty ones below them."""
    shown = {axes.get_title(place) for place in ("left", "center", "right")} - {""}
    titles = [text for text in axes.findobj(Text) if text.get_text() in shown]
    before = [text.get_text() for text in titles]
    for text, words in zip(titles, before, strict=True):
        text.set_text(textwrap.fill(words, _LETTERS) + "\n" * n_lines_below)
    yield
    for text, words in zip(titles, before, strict=True):
        text.set_text(words)

"""Layout of figures: axes of maps with scale bar, north arrow and CRS, and figures at the widths of pages and columns.

`map_figure` makes a figure with one or more maps of equal scale; layers are drawn into them by
`survey.figures.map_layers`. The scale bar counts on the ground where the scale factor of the CRS differs from 1
by more than 1 %. `arranged` lays a figure out at another width with letters of the same size, and restores it:
`narrow_image` for phones, at `column_width_in` for the columns of a journal.
"""

import math
import textwrap
from collections.abc import Iterator, Sequence
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
from matplotlib.transforms import ScaledTranslation, Transform, blended_transform_factory
from PIL.Image import Image
from pyproj import CRS

from survey.core import Bounds, round_number
from survey.core.crs import crs_text
from survey.core.map_scale import MapScale
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.figures.style import INK, MUTED, VEIL, page_image, styled

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


_LEFT_IN, _RIGHT_IN, _GAP_IN, _AXIS_IN, _ABOVE_IN = 0.86, 1.0, 0.14, 0.5, 0.36
_LEGEND_ROW_IN, _TITLE_LINE_IN = 0.2, 0.17


def map_figure(width_in: float, bounds: Bounds, *, n_maps: int = 1) -> MapFigure:
    """Return empty maps side by side with room for a colour bar, so that figures of one width line up."""
    figure = Figure(figsize=(width_in, width_in))
    maps = [figure.add_axes((0.0, 0.0, 1.0, 1.0), label=MAP) for _ in range(n_maps)]
    drawing = MapFigure(figure, maps, figure.add_axes((0.0, 0.0, 1.0, 1.0), label=COLOUR_BAR))
    for index, axes in enumerate(maps):
        set_up_map(axes, bounds, first=index == 0, crowded=n_maps > 1)
    _place_maps(drawing, width_in, n_columns=n_maps)
    return drawing


def _place_maps(
    drawing: MapFigure, width_in: float, *, n_columns: int, n_legend_rows: int = 0, n_title_lines: int = 1
) -> None:
    """Place maps in rows with the colour bar beside them, above room for a legend.

    Sizes are set by hand [in]: an automatic layout would place every map a little differently.
    """
    figure, maps, bar = drawing
    (west, east), (south, north) = maps[0].get_xlim(), maps[0].get_ylim()
    aspect = (north - south) / (east - west)
    n_rows = math.ceil(len(maps) / n_columns)
    room = width_in - _LEFT_IN - _RIGHT_IN
    wide = min((room - _GAP_IN * (n_columns - 1)) / n_columns, _TALLEST_MAP_IN / aspect)
    tall = wide * aspect
    above = _ABOVE_IN + _TITLE_LINE_IN * n_title_lines
    below = _AXIS_IN + _LEGEND_ROW_IN * (n_legend_rows + 0.5 * bool(n_legend_rows))
    stack = n_rows * tall + (n_rows - 1) * (_AXIS_IN + above)
    # A map that is too tall for the page's width stands in its middle.
    start = _LEFT_IN + 0.5 * (room - n_columns * wide - (n_columns - 1) * _GAP_IN)
    height = below + stack + above
    figure.set_size_inches(width_in, height)

    def place(axes: Axes, left: float, low: float, size: tuple[float, float]) -> None:
        axes.set_position((left / width_in, low / height, size[0] / width_in, size[1] / height))

    for index, axes in enumerate(maps):
        row, column = divmod(index, n_columns)
        low = below + stack - tall - row * (tall + _AXIS_IN + above)
        place(axes, start + column * (wide + _GAP_IN), low, (wide, tall))
        axes.tick_params(axis="y", labelleft=column == 0)
    place(bar, start + n_columns * (wide + _GAP_IN) - _GAP_IN + 0.1, below, (0.11, stack))


def add_legend(drawing: MapFigure, handles: Sequence[Artist]) -> None:
    """Write a legend below the maps, in as many columns as the width takes."""
    width_in = drawing.figure.get_figwidth()
    n_columns = _legend_columns([str(handle.get_label()) for handle in handles], width_in)
    drawing.figure.legend(
        handles=list(handles), loc="lower center", ncols=n_columns, columnspacing=_COLUMN_SPACING
    )
    n_rows = math.ceil(len(handles) / n_columns)
    _place_maps(drawing, width_in, n_columns=len(drawing.maps), n_legend_rows=n_rows)


_COLUMN_SPACING = 1.6
# Width of an entry of a legend: its handle with the spaces, and the mean width of a letter [in].
_HANDLE_IN, _LETTER_IN = 0.52, 0.07


def _legend_columns(labels: Sequence[str], width_in: float) -> int:
    """Return the number of columns of a legend that a width takes."""
    widest = _HANDLE_IN + _LETTER_IN * max(map(len, labels), default=1)
    return max(min(int(width_in / widest), len(labels)), 1)


def set_up_map(axes: Axes, bounds: Bounds, *, first: bool = True, crowded: bool = False) -> None:
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


_TITLE_PAD_PT = 21.0
_LONGEST_CRS = 20


def label_maps(drawing: MapFigure, *titles: str, crs: CRS | None, north: bool = True) -> None:
    """Write the titles of the maps, and give them scale bar, north arrow and CRS."""
    for axes, title in zip(drawing.maps, titles, strict=True):
        axes.set_title(title, pad=_TITLE_PAD_PT)
    draw_scale_and_north(drawing, north=north, crs=crs)
    if crs is None:
        return
    axes = drawing.maps[-1]
    code = crs_text(crs)
    name = code if len(code) <= _LONGEST_CRS else textwrap.shorten(crs.name, _LONGEST_CRS, placeholder=" …")
    beside = axes.transAxes + ScaledTranslation(0.95, -0.27, drawing.figure.dpi_scale_trans)
    axes.text(1.0, 0.0, name, transform=beside, ha="right", va="top", fontsize=8, color=MUTED)


def draw_scale_and_north(drawing: MapFigure, *, north: bool = True, crs: CRS | None = None) -> None:
    """Draw a scale bar and, where the map has one, a grid-north arrow above each map, where they cover nothing.

    With `crs` the bar counts on the ground where the scale factor of the CRS differs from 1 by more than 1 %.
    """
    for axes in drawing.maps:
        inches_above = drawing.figure.dpi_scale_trans + ScaledTranslation(0.0, 1.0, axes.transAxes)  # type: ignore[arg-type]  # it is affine
        _draw_scale(axes, blended_transform_factory(axes.transData, inches_above), crs)
        if north:
            _draw_north(axes, blended_transform_factory(axes.transAxes, inches_above))


def _draw_scale(axes: Axes, place: Transform, crs: CRS | None) -> None:
    xmin, xmax = axes.get_xlim()
    width = xmax - xmin
    factor = 1.0 if crs is None else _scale_factor(axes, crs)
    ground_m = round_number(width / factor / 4.0)
    length = ground_m * factor
    end = xmax - 0.12 * width
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


def _draw_north(axes: Axes, place: Transform) -> None:
    axes.text(0.945, 0.14, "N", transform=place, ha="center", va="center", fontweight="bold")
    arrow = {"arrowstyle": "-|>", "color": INK, "mutation_scale": 9, "shrinkA": 0, "shrinkB": 0}
    axes.annotate(
        "", xy=(0.99, 0.26), xytext=(0.99, 0.03), xycoords=place, arrowprops=arrow, annotation_clip=False
    )


def _scale_factor(axes: Axes, crs: CRS) -> float:
    """Return the linear scale factor of a CRS over what a map shows; 1 within 1 %."""
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    return MapScale.over(crs, (west, south, east, north)).notable_factor


NARROW_IN = 4.0
"""Width of a narrow figure [in]; a phone shows 90 CSS pixels per inch."""
_STACKED_BELOW_IN = 6.0
_N_LAYOUTS = 2
# Mean width of a letter of a title [in].
_TITLE_LETTER_IN = 0.084
_MM_PER_IN = 25.4
PAPERS_MM = {"agu": (95.0, 190.0), "copernicus": (83.0, 120.0), "ieee": (88.9, 182.0)}
"""Widths of figures in one and in two columns [mm], by publisher, from their instructions to authors."""
Paper = Literal["agu", "copernicus", "ieee"]


@styled
def narrow_image(figure: Figure) -> Image:
    """Draw a wide figure for a phone; the figure itself stays as it is."""
    with arranged(figure, NARROW_IN):
        return page_image(figure)


def column_width_in(figure: Figure, paper: Paper) -> float:
    """Return the width of one or two columns of a publisher [in], by the width of a figure."""
    return PAPERS_MM[paper][is_wide(figure)] / _MM_PER_IN


def is_wide(figure: Figure) -> bool:
    """Return whether a figure takes the width of a page."""
    return bool(figure.get_figwidth() > _STACKED_BELOW_IN)


@contextmanager
def arranged(figure: Figure, width_in: float) -> Iterator[None]:
    """Lay a figure out at a width [in] for as long as the context is open; narrow ones have one column of panels."""
    size = figure.get_figwidth(), figure.get_figheight()
    maps = [axes for axes in figure.axes if axes.get_label() == MAP]
    is_stacked = width_in < _STACKED_BELOW_IN
    n_columns = 1 if is_stacked else max(len(maps), _n_columns(figure))
    n_letters = int((width_in / n_columns - _LEFT_IN) / _TITLE_LETTER_IN)
    with ExitStack() as changes:
        changes.enter_context(_legends_within(figure, width_in, is_narrow=is_stacked))
        for axes in figure.axes:
            changes.enter_context(_wrapped_titles(axes, n_letters))
        if maps:
            changes.enter_context(_maps_within(figure, maps, width_in, n_columns))
        elif is_stacked:
            changes.enter_context(_stacked_panels(figure, width_in))
        else:
            figure.set_figwidth(width_in)
        # An automatic layout comes to rest after a few repetitions, of which the drawing is one.
        engine = figure.get_layout_engine()
        if engine is not None:
            for _ in range(_N_LAYOUTS):
                engine.execute(figure)
        yield
        figure.set_size_inches(*size)


def _n_columns(figure: Figure) -> int:
    """Return the number of columns of a figure's grid of panels."""
    specs = [spec for axes in figure.axes if (spec := axes.get_subplotspec()) is not None]
    return max((spec.get_gridspec().ncols for spec in specs), default=1)


@contextmanager
def _stacked_panels(figure: Figure, width_in: float) -> Iterator[None]:
    """Put the panels of a grid below one another, column after column, each as tall as before."""
    specs = {axes: spec for axes in figure.axes if (spec := axes.get_subplotspec()) is not None}
    order = sorted(specs, key=lambda axes: (specs[axes].colspan.start, specs[axes].rowspan.start))
    ratios = [_height_ratio(specs[axes]) for axes in order]
    column = GridSpec(max(len(order), 1), 1, figure=figure, height_ratios=ratios or None)
    figure.set_size_inches(width_in, figure.get_figheight() * _n_columns(figure))
    for row, axes in enumerate(order):
        axes.set_subplotspec(column[row, 0])
    yield
    for axes, spec in specs.items():
        axes.set_subplotspec(spec)


def _height_ratio(spec: SubplotSpec) -> float:
    ratios: Any = spec.get_gridspec().get_height_ratios()
    return float(ratios[spec.rowspan.start])


@contextmanager
def _maps_within(figure: Figure, maps: list[Axes], width_in: float, n_columns: int) -> Iterator[None]:
    """Place maps at one scale in columns, with the colour bar beside all of them."""
    before = {axes: axes.get_position() for axes in figure.axes}
    bar = next(axes for axes in figure.axes if axes.get_label() == COLOUR_BAR)
    _place_maps(
        MapFigure(figure, maps, bar),
        width_in,
        n_columns=n_columns,
        n_legend_rows=sum(_n_rows(legend, width_in) for legend in figure.legends),
        n_title_lines=max(axes.get_title("left").count("\n") + 1 for axes in maps),
    )
    yield
    for axes, position in before.items():
        axes.set_position(position)
    for axes in maps[1:]:
        axes.tick_params(axis="y", labelleft=False)


@contextmanager
def _legends_within(figure: Figure, width_in: float, *, is_narrow: bool) -> Iterator[None]:
    """Draw the legend of a figure in as many columns as a width takes; those of narrow panels in two."""
    of_figure, of_axes = list(figure.legends), {axes: axes.get_legend() for axes in figure.axes}
    where: Literal["lower center", "outside lower center"] = (
        "lower center" if figure.get_layout_engine() is None else "outside lower center"
    )
    for wide in of_figure:
        wide.remove()
        handles, labels = _entries(wide)
        n_columns = _legend_columns(labels, width_in)
        figure.legend(handles, labels, loc=where, ncols=n_columns, columnspacing=_COLUMN_SPACING)
    for axes, legend in of_axes.items():
        if is_narrow and legend is not None and len(legend.texts) > 2:
            handles, labels = _entries(legend)
            axes.legend(handles, labels, loc="best", ncols=_legend_columns(labels, min(width_in, 2.8)))
    yield
    figure.legends[:] = of_figure
    for axes, legend in of_axes.items():
        axes.legend_ = legend


def _n_rows(legend: Legend, width_in: float) -> int:
    labels = [text.get_text() for text in legend.texts]
    return math.ceil(len(labels) / _legend_columns(labels, width_in))


def _entries(legend: Legend) -> tuple[list[Artist], list[str]]:
    return [handle for handle in legend.legend_handles if handle], [text.get_text() for text in legend.texts]


@contextmanager
def _wrapped_titles(axes: Axes, n_letters: int) -> Iterator[None]:
    """Break long titles into lines."""
    shown = {axes.get_title(place) for place in ("left", "center", "right")} - {""}
    titles = [text for text in axes.findobj(Text) if text.get_text() in shown]
    before = [text.get_text() for text in titles]
    for text, words in zip(titles, before, strict=True):
        text.set_text(textwrap.fill(words, n_letters))
    yield
    for text, words in zip(titles, before, strict=True):
        text.set_text(words)

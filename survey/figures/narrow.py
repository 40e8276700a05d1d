"""Narrow versions of wide figures for phones: panels in one column, legends in two."""

import math
import textwrap
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, Literal

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec, SubplotSpec
from matplotlib.legend import Legend
from matplotlib.text import Text
from PIL.Image import Image

from survey.figures.cartography.layout import COLOUR_BAR, MAP
from survey.figures.style import page_image, styled

NARROW_IN = 4.0
"""Width of a narrow figure [in]; a phone shows 90 CSS pixels per inch."""
_LEFT_IN, _RIGHT_IN, _GAP_IN, _AXIS_IN = 0.85, 0.85, 0.8, 0.55
_LEGEND_ROW_IN, _TITLE_LINE_IN = 0.2, 0.17
_LETTERS = 40


@styled
def narrow_image(figure: Figure) -> Image:
    """Draw a wide figure for a phone; the figure itself stays as it is.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        A figure as wide as a page, of maps or of panels in rows and columns.

    Returns
    -------
    PIL.Image.Image
        RGB, `NARROW_IN` wide.
    """
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

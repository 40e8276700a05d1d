"""Page of A4 with a title block, a map at a round scale, paragraphs and tables that flow down the page.

`pdf_bytes` writes figures as the pages of one PDF.
"""

import io
import textwrap
from collections.abc import Sequence
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from survey.core.arrays import Bounds
from survey.core.text import printable
from survey.figures.layout import grouped
from survey.figures.style import INK, MUTED, VEIL, styled

WIDTH_IN, HEIGHT_IN = 8.27, 11.69
LEFT_IN, RIGHT_IN, BOTTOM_IN = 0.65, 0.55, 0.5
_INCH_M = 0.0254
_SCALES = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.5, 10.0)
_LINE_IN, _ROW_IN = 0.155, 0.148
_LETTERS_PER_INCH, _FACT_LETTERS_PER_INCH = 15.5, 16.2
_NAME_IN = 1.05
"""Width of the names of facts."""


class Column(NamedTuple):
    """Column of a table: heading, width [in], and on which side its text is aligned."""

    heading: str
    width_in: float
    align: str = "right"


class Page:
    """A4 page that is filled from its top down.

    `title`: heading of the page. `subtitle`: line below it.
    """

    def __init__(self, title: str, subtitle: str) -> None:
        self.figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN))
        self.top_in = HEIGHT_IN - 0.55
        self._text(LEFT_IN, self.top_in, title, size=14.0, weight="bold")
        self.top_in -= 0.2
        self._text(LEFT_IN, self.top_in, subtitle, size=8.0, colour=MUTED)
        self.top_in -= 0.14

    @property
    def room_in(self) -> float:
        """Height that is left [in]."""
        return self.top_in - BOTTOM_IN

    def number(self, page: int, pages: int) -> None:
        """Write the number of the page at its foot."""
        self._text(
            WIDTH_IN - RIGHT_IN, 0.28, f"page {page} of {pages}", size=7.0, colour=MUTED, align="right"
        )

    def map_axes(self, bounds: Bounds, tallest_in: float) -> tuple[Axes, int]:
        """Add axes with a map at a round scale; return them with the denominator of the scale."""
        left_in, wide_in = LEFT_IN + 0.35, WIDTH_IN - LEFT_IN - RIGHT_IN - 1.0
        tall_in = min(tallest_in, self.room_in) - 0.6
        xmin, ymin, xmax, ymax = bounds
        scale = _round_scale(max((xmax - xmin) / wide_in, (ymax - ymin) / tall_in) / _INCH_M)
        height_in = min(tall_in, 1.02 * (ymax - ymin) / (scale * _INCH_M) + 0.1)
        half_x, half_y = 0.5 * wide_in * scale * _INCH_M, 0.5 * height_in * scale * _INCH_M
        self.top_in -= 0.28
        axes = self._axes(left_in, self.top_in - height_in, wide_in, height_in)
        x, y = 0.5 * (xmin + xmax), 0.5 * (ymin + ymax)
        axes.set(xlim=(x - half_x, x + half_x), ylim=(y - half_y, y + half_y), facecolor=VEIL)
        axes.set_aspect("equal", adjustable="box")
        _grid_labels(axes)
        self.top_in -= height_in + 0.42
        return axes, scale

    def bar_axes(self, beside: Axes) -> Axes:
        """Add axes for a colour bar to the right of a map."""
        box = beside.get_position()
        return self.figure.add_axes((box.x1 + 0.012, box.y0, 0.013, box.height))

    def heading(self, text: str) -> None:
        """Write a heading."""
        self.top_in -= 0.2
        self._text(LEFT_IN, self.top_in, text, size=9.0, weight="bold")
        self.top_in -= 0.05

    def paragraph(self, text: str, *, bullet: str = "") -> None:
        """Write a text, broken into lines."""
        width = int((WIDTH_IN - LEFT_IN - RIGHT_IN) * _LETTERS_PER_INCH)
        lines = textwrap.wrap(bullet + text, width, subsequent_indent=" " * len(bullet))
        for line in lines:
            self.top_in -= _LINE_IN
            self._text(LEFT_IN, self.top_in, line, size=7.8)

    def facts(self, rows: Sequence[tuple[str, str]]) -> None:
        """Write names and values in two columns beside one another; long values are broken into lines."""
        half = (len(rows) + 1) // 2
        wide = 0.5 * (WIDTH_IN - LEFT_IN - RIGHT_IN)
        n_lines = [0, 0]
        for index, (name, value) in enumerate(rows):
            column = index // half
            left, top = LEFT_IN + wide * column, self.top_in - _LINE_IN * (n_lines[column] + 1)
            self._text(left, top, name, size=7.8, colour=MUTED)
            lines = textwrap.wrap(value, int((wide - _NAME_IN) * _FACT_LETTERS_PER_INCH)) or [""]
            for number, line in enumerate(lines):
                self._text(left + _NAME_IN, top - _LINE_IN * number, line, size=7.8)
            n_lines[column] += len(lines)
        self.top_in -= _LINE_IN * max(n_lines)

    def table(self, columns: Sequence[Column], rows: Sequence[Sequence[str]]) -> int:
        """Write as many rows as there is room for; return how many those are."""
        n = min(len(rows), max(int((self.room_in - 0.3) / _ROW_IN), 0))
        if n == 0:
            return 0
        self.top_in -= 0.17
        self._row(columns, [column.heading for column in columns], weight="bold")
        self._line(self.top_in - 0.04)
        self.top_in -= 0.03
        for row in rows[:n]:
            self.top_in -= _ROW_IN
            self._row(columns, row)
        return n

    def _row(self, columns: Sequence[Column], cells: Sequence[str], *, weight: str = "normal") -> None:
        left = LEFT_IN
        for column, cell in zip(columns, cells, strict=True):
            at = left + column.width_in if column.align == "right" else left
            self._text(at, self.top_in, cell, size=6.8, weight=weight, align=column.align)
            left += column.width_in + 0.08

    def _line(self, height_in: float) -> None:
        line = self._axes(LEFT_IN, height_in, WIDTH_IN - LEFT_IN - RIGHT_IN, 0.001)
        line.set_axis_off()
        line.axhline(0.0, color=MUTED, linewidth=0.6)

    def _axes(self, left_in: float, bottom_in: float, width_in: float, height_in: float) -> Axes:
        return self.figure.add_axes(
            (left_in / WIDTH_IN, bottom_in / HEIGHT_IN, width_in / WIDTH_IN, height_in / HEIGHT_IN)
        )

    def _text(
        self,
        left_in: float,
        bottom_in: float,
        text: str,
        *,
        size: float,
        weight: str = "normal",
        colour: str = INK,
        align: str = "left",
    ) -> None:
        self.figure.text(
            left_in / WIDTH_IN, bottom_in / HEIGHT_IN, printable(text), fontsize=size, weight=weight, color=colour, ha=align
        )  # fmt: skip


def _round_scale(least: float) -> int:
    """Return the smallest round denominator of a scale that is not below a number.

    >>> _round_scale(8_311.0), _round_scale(10_001.0)
    (10000, 12500)
    """
    power = 1.0
    while 10.0 * power < least:
        power *= 10.0
    return round(next(scale * power for scale in _SCALES if scale * power >= least))


def _grid_labels(axes: Axes) -> None:
    """Label easting and northing in full metres."""
    axes.spines[:].set_visible(True)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10]))
        axis.set_major_formatter(FuncFormatter(lambda value, _: grouped(value)))
    axes.tick_params(labelsize=6.5)
    for label in axes.get_yticklabels():
        label.set(rotation=90, va="center")
    axes.set_xlabel("Easting [m]", fontsize=7.0, labelpad=1.0)
    axes.set_ylabel("Northing [m]", fontsize=7.0, labelpad=1.0)


@styled
def pdf_bytes(figures: Sequence[Figure], title: str) -> bytes:
    """Return figures as the pages of a PDF file; the same figures give the same bytes."""
    # Pictures need neither this backend nor its fonts.
    from matplotlib.backends.backend_pdf import PdfPages

    buffer = io.BytesIO()
    facts = {"Title": title, "Creator": "firnline", "CreationDate": None}
    with PdfPages(buffer, metadata=facts) as pages:
        for figure in figures:
            pages.savefig(figure, dpi=200)
    return buffer.getvalue()

"""A4 pages of a document."""

import io
import textwrap
from collections.abc import Sequence

import matplotlib.image
from matplotlib.figure import Figure

from survey.core.arrays import FloatArray
from survey.figures.sheets.frame import LEFT_IN, RIGHT_IN, WIDTH_IN, Column, Page
from survey.figures.style import MUTED, styled
from survey.reporting.document.content import Chapter, Document, DrawnFigure, Statement, Table

_ROOM_IN = WIDTH_IN - LEFT_IN - RIGHT_IN
_GAP_IN = 0.2
_DPI = 220
_TALLEST_IN = 4.6
# Letters of the tables' size per inch, with some room.
_LETTERS_PER_INCH = 15.0


@styled
def document_pages(document: Document) -> list[Figure]:
    """Draw a document on A4 pages.

    Parameters
    ----------
    document : Document
        Its content.

    Returns
    -------
    list of matplotlib.figure.Figure
        The pages, with their numbers.
    """
    pages = _Pages(document)
    for section in document.sections:
        _add_section(pages, section)
    if document.signature:
        _add_signature(pages, document.signature)
    for number, page in enumerate(pages.pages, start=1):
        page.number(number, len(pages.pages))
    return [page.figure for page in pages.pages]


class _Pages:
    """Pages that follow one another as they fill."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self.pages = [Page(document.title, f"{document.kind}, {document.subtitle}")]

    def with_room(self, height_in: float) -> Page:
        """Return a page with room for something of this height."""
        if self.pages[-1].room_in < height_in:
            self.pages.append(Page(self._document.title, f"{self._document.kind}, continued"))
        return self.pages[-1]


def _add_section(pages: _Pages, section: Chapter) -> None:
    page = pages.with_room(1.6)
    page.top_in -= 0.14
    page.heading(section.heading)
    for statement in section.statements:
        _add_statement(pages, statement)
    for text in section.paragraphs:
        pages.with_room(_height_in(text)).paragraph(text)
    for table in section.tables:
        _add_table(pages, table)
    for figures in _rows_of_figures(section.figures):
        _add_figures(pages, figures)


def _add_statement(pages: _Pages, statement: Statement) -> None:
    page = pages.with_room(_height_in(statement.text) + 0.3)
    page.top_in -= 0.06
    page.paragraph(statement.text, bullet="»  ")
    if statement.note:
        page.paragraph(statement.note, bullet="    ")


def _height_in(text: str) -> float:
    return 0.16 * (len(text) / 95.0 + 1.0) + 0.1


def _add_table(pages: _Pages, table: Table) -> None:
    """Write a table, on as many pages as it needs; long cells are broken into rows."""
    columns = _columns(table)
    rest = _broken(table, columns)
    page = pages.with_room(0.8)
    page.top_in -= 0.06
    page.paragraph(table.caption)
    while rest:
        rest = rest[page.table(columns, rest) :]
        if rest:
            page = pages.with_room(100.0)


def _columns(table: Table) -> list[Column]:
    """Give each column the width of its longest cell, and all together the width of the page."""
    cells = [table.headings, *table.rows]
    longest = [max(len(row[k]) for row in cells) for k in range(len(table.headings))]
    gaps_in = 0.08 * (len(longest) - 1)
    wanted = [n / _LETTERS_PER_INCH + 0.12 for n in longest]
    excess = sum(wanted) - (_ROOM_IN - gaps_in)
    if excess > 0.0:
        # The widest column gives way first, down to twice the mean width; then all of them.
        widest = wanted.index(max(wanted))
        wanted[widest] = max(wanted[widest] - excess, min(wanted[widest], 2.0 * _ROOM_IN / len(wanted)))
        shrunk = min((_ROOM_IN - gaps_in) / sum(wanted), 1.0)
        wanted = [shrunk * width for width in wanted]
    return [
        Column(heading, width, "left" if k < table.n_text_columns else "right")
        for k, (heading, width) in enumerate(zip(table.headings, wanted, strict=True))
    ]


def _broken(table: Table, columns: Sequence[Column]) -> list[list[str]]:
    """Break cells that are longer than their column into several rows."""
    rows: list[list[str]] = []
    for row in table.rows:
        lines = [
            textwrap.wrap(cell, max(int((c.width_in - 0.05) * _LETTERS_PER_INCH), 8)) or [""]
            for cell, c in zip(row, columns, strict=True)
        ]
        for k in range(max(map(len, lines))):
            rows.append([line[k] if k < len(line) else "" for line in lines])
    return rows


def _rows_of_figures(figures: Sequence[DrawnFigure]) -> list[list[DrawnFigure]]:
    """Put narrow figures side by side in pairs."""
    rows: list[list[DrawnFigure]] = []
    for figure in figures:
        last = rows[-1] if rows else []
        if last and not figure.is_wide and not last[0].is_wide and len(last) == 1:
            last.append(figure)
        else:
            rows.append([figure])
    return rows


def _add_figures(pages: _Pages, figures: list[DrawnFigure]) -> None:
    """Draw one wide figure or up to two narrow ones as images, with their captions below."""
    images = [_image(it.figure) for it in figures]
    width_in = _ROOM_IN if figures[0].is_wide else 0.5 * (_ROOM_IN - _GAP_IN)
    heights = [min(width_in * image.shape[0] / image.shape[1], _TALLEST_IN) for image in images]
    captions = [textwrap.wrap(it.caption, int(width_in * 15.0)) for it in figures]
    tall_in = max(heights) + 0.16 * max(map(len, captions))
    page = pages.with_room(tall_in + 0.3)
    page.top_in -= 0.12
    for k, (image, height_in, lines) in enumerate(zip(images, heights, captions, strict=True)):
        left_in = LEFT_IN + k * (width_in + _GAP_IN)
        _place(page, image, (left_in, page.top_in - height_in, width_in, height_in))
        for line, text in enumerate(lines, start=1):
            top_in = page.top_in - max(heights) - 0.15 * line
            _write(page, left_in, top_in, text)
    page.top_in -= tall_in + 0.05


def _place(page: Page, image: FloatArray, box_in: tuple[float, float, float, float]) -> None:
    wide_in, tall_in = page.figure.get_size_inches()
    left, bottom, width, height = box_in
    axes = page.figure.add_axes((left / wide_in, bottom / tall_in, width / wide_in, height / tall_in))
    axes.imshow(image, aspect="equal", interpolation="antialiased")
    axes.set_axis_off()


def _write(page: Page, left_in: float, bottom_in: float, text: str) -> None:
    wide_in, tall_in = page.figure.get_size_inches()
    page.figure.text(left_in / wide_in, bottom_in / tall_in, text, fontsize=7.0, color=MUTED)


def _image(figure: Figure) -> FloatArray:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DPI)
    buffer.seek(0)
    image: FloatArray = matplotlib.image.imread(buffer, format="png")
    return image


def _add_signature(pages: _Pages, labels: tuple[str, ...]) -> None:
    """Draw a line to fill in for each label."""
    page = pages.with_room(0.4 + 0.36 * len(labels))
    page.top_in -= 0.1
    for label in labels:
        page.top_in -= 0.34
        page.paragraph(f"{label}:   {'_' * (90 - len(label))}")

"""Documents of sections with statements, tables and figures, written as HTML or PDF from one content.

A `Document` holds chapters; within a chapter statements, paragraphs, tables and figures stand in that order.
`write_document` writes a folder, one HTML file by the template ``document.html.j2``, or a PDF of A4 pages.
"""

import base64
import csv
import io
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import matplotlib.image
from matplotlib.figure import Figure

from survey.core import ConfigError, FloatArray, PictureKind, replacing
from survey.core.replacement import replacing_folder
from survey.core.text import csv_cell
from survey.figures.layout import is_wide
from survey.figures.page_layout import LEFT_IN, RIGHT_IN, WIDTH_IN, Column, Page, pdf_bytes
from survey.figures.style import MUTED, styled
from survey.reporting.rendering import Picture, PictureForm, picture_of, render


class Statement(NamedTuple):
    """Text that is quoted as it is, with its language and a note below it."""

    text: str
    language: str = "en"
    note: str = ""


class Table(NamedTuple):
    """Table of text: name of its file, caption, headings, which columns hold numbers, rows."""

    name: str
    caption: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    n_text_columns: int = 1

    @property
    def csv(self) -> str:
        """The table for spreadsheets; cells that begin like a formula are escaped."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.headings)
        for row in self.rows:
            words = [csv_cell(cell) for cell in row[: self.n_text_columns]]
            writer.writerow([*words, *(cell.replace("\u2212", "-") for cell in row[self.n_text_columns :])])
        return text.getvalue()


class DrawnFigure(NamedTuple):
    """Figure with the name of its file, alternative text and caption."""

    name: str
    figure: Figure
    alt: str
    caption: str

    @property
    def is_wide(self) -> bool:
        """Whether it takes the width of a page."""
        return is_wide(self.figure)


@dataclass(frozen=True)
class Chapter:
    """Chapter of a document.

    `heading`: its heading. `statements`: quoted texts. `paragraphs`: text below them. `tables`: tables.
    `figures`: figures; two narrow ones stand side by side.
    """

    heading: str
    statements: tuple[Statement, ...] = ()
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[DrawnFigure, ...] = ()


@dataclass(frozen=True)
class Document:
    """Document with a title block, sections, and lines to sign on.

    `kind`: what it is, such as ``"Accuracy report"``. `title`: what it is about. `subtitle`: line below the
    title, with date and program. `sections`: in order. `signature`: labels of the lines to fill in by hand.
    """

    kind: str
    title: str
    subtitle: str
    sections: tuple[Chapter, ...]
    signature: tuple[str, ...] = ()

    @property
    def figures(self) -> tuple[DrawnFigure, ...]:
        """All figures."""
        return tuple(figure for section in self.sections for figure in section.figures)

    @property
    def tables(self) -> tuple[Table, ...]:
        """All tables."""
        return tuple(table for section in self.sections for table in section.tables)


OUTPUTS = ("index.html", "report.pdf", "figures", "figures/*", "tables", "tables/*")
"""Files that are written into a folder."""
SUFFIXES = (".html", ".pdf")
"""Endings of single files; a name without ending is a folder."""


def check_target(target: str | Path) -> Path:
    """Refuse a file of another kind."""
    path = Path(target)
    if path.suffix.lower() not in ("", *SUFFIXES):
        raise ConfigError(
            f"a report cannot be written to {path.name}; a folder or a file that ends in .html or .pdf was expected."
        )
    return path


def write_document(target: str | Path, document: Document, kind: PictureKind = "png") -> Path:
    """Write a document; the ending of the target chooses the form. Equal documents give equal bytes.

    `kind`: format of the figures beside or within a page.
    """
    path = check_target(target)
    if not path.suffix:
        return _write_folder(path, document, kind)
    with replacing(path) as draft:
        if path.suffix.lower() == ".pdf":
            draft.write_bytes(_pdf(document))
        else:
            draft.write_text(html_page(document, kind), encoding="utf-8")
    return path


def html_page(document: Document, kind: PictureKind = "png") -> str:
    """Return the HTML page, which holds its downloads."""
    return _page(document, _pictures(document, kind), is_alone=True)


def _pictures(document: Document, kind: PictureKind) -> dict[str, Picture]:
    form = PictureForm(kind)
    return {it.name: picture_of(it.figure, it.alt, it.caption, form) for it in document.figures}


def _page(document: Document, pictures: dict[str, Picture], *, is_alone: bool) -> str:
    """Return the HTML page; alone it holds its downloads, else they are files beside it."""
    tables = {table.name: _table_source(table.csv) for table in document.tables}
    links = (
        {**{name: it.file_source for name, it in pictures.items()}, **tables}
        if is_alone
        else {
            **{name: f"figures/{name}.{it.kind}" for name, it in pictures.items()},
            **{n: f"tables/{n}.csv" for n in tables},
        }
    )
    return render("document.html.j2", document=document, pictures=pictures, links=links)


def _write_folder(folder: Path, document: Document, kind: PictureKind) -> Path:
    pictures = _pictures(document, kind)
    with replacing_folder(folder, own=OUTPUTS) as draft:
        for place in ("figures", "tables"):
            (draft / place).mkdir()
        for name, picture in pictures.items():
            (draft / "figures" / f"{name}.{kind}").write_bytes(picture.image)
        for table in document.tables:
            (draft / "tables" / f"{table.name}.csv").write_text(table.csv, encoding="utf-8", newline="\n")
        (draft / "index.html").write_text(_page(document, pictures, is_alone=False), encoding="utf-8")
        (draft / "report.pdf").write_bytes(_pdf(document))
    return folder / "index.html"


def _pdf(document: Document) -> bytes:
    return pdf_bytes(document_pages(document), f"{document.kind}: {document.title}")


def _table_source(text: str) -> str:
    return "data:text/csv;base64," + base64.b64encode(text.encode("utf-8")).decode("ascii")


_ROOM_IN = WIDTH_IN - LEFT_IN - RIGHT_IN
_GAP_IN = 0.2
_DPI = 220
_TALLEST_IN = 6.4
# Letters of the tables' size per inch, with some room.
_LETTERS_PER_INCH = 15.0


@styled
def document_pages(document: Document) -> list[Figure]:
    """Draw a document on A4 pages."""
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

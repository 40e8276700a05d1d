"""Content of a document: sections of statements, paragraphs, tables and figures, in that order."""

import csv
import io
from dataclasses import dataclass
from typing import NamedTuple

from matplotlib.figure import Figure

from survey.core.text import csv_cell


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
        return bool(self.figure.get_figwidth() > 6.0)


@dataclass(frozen=True)
class Chapter:
    """Chapter of a document.

    Parameters
    ----------
    heading : str
        Its heading.
    statements : tuple of Statement
        Quoted texts.
    paragraphs : tuple of str
        Text below them.
    tables : tuple of Table
        Tables.
    figures : tuple of DrawnFigure
        Figures; two narrow ones stand side by side.
    """

    heading: str
    statements: tuple[Statement, ...] = ()
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[DrawnFigure, ...] = ()


@dataclass(frozen=True)
class Document:
    """Document with a title block, sections, and lines to sign on.

    Parameters
    ----------
    kind : str
        What it is, such as ``"Accuracy report"``.
    title : str
        What it is about.
    subtitle : str
        Line below the title, with date and program.
    sections : tuple of Chapter
        In order.
    signature : tuple of str
        Labels of the lines to fill in by hand.
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

"""Text tables of other programs: commas, semicolons, tabs or blanks between cells, decimal points or commas."""

import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import CapacityError, InputError
from survey.core.files.library_messages import first_line
from survey.core.files.reading import existing_file
from survey.core.text import printable
from survey.io.last_line import refuse_cut_off
from survey.io.tables import refuse_repeated_columns
from survey.io.text_tables.angles import Axis, degrees
from survey.io.text_tables.number_marks import NumberMarks, is_decimal

LARGEST_BYTES = 200_000_000
"""Largest table of text that is read."""
_COMMENTS = ("#", "%", "sep=")
# Rows of so many numbers have no names.
_LEAST_NUMBERS = 3
_N_COLOURS = 3
_LONGEST_CELL = 40
_UTF16 = (b"\xff\xfe", b"\xfe\xff")


class TextTable(NamedTuple):
    """Cells of a text table, with the numbers of their lines."""

    header: list[str]
    rows: list[list[str]]
    lines: list[int]
    marks: NumberMarks
    where: str

    def texts(self, name: str) -> tuple[str, ...]:
        """Return the cells of a column as they are."""
        index = self.header.index(name)
        return tuple(row[index].strip() for row in self.rows)

    def numbers(self, name: str, axis: Axis | None = None) -> FloatArray:
        """Return a column of numbers (N,); of angles [deg], in whatever way they are written, where an axis is named.

        Raises
        ------
        InputError
            A cell that is no number, by its line.
        """
        values = np.empty(len(self.rows))
        for k, (line, cell) in enumerate(zip(self.lines, self.texts(name), strict=True)):
            number = self._number(cell, axis)
            if number is None:
                raise self._no_number(cell, line, name, axis)
            values[k] = number
        return values

    def is_number(self, name: str, row: int, axis: Axis | None = None) -> bool:
        """Return whether a cell of a column is a number, with the marks of the table."""
        return self._number(self.rows[row][self.header.index(name)].strip(), axis) is not None

    def _number(self, cell: str, axis: Axis | None) -> float | None:
        text = self.marks.plain(cell)
        try:
            if "_" not in text:
                return float(text)
        except ValueError:
            pass
        if axis is None:
            return None
        return degrees(cell.replace(",", ".") if self.marks.decimal == "," else cell, axis)

    def _no_number(self, cell: str, line: int, name: str, axis: Axis | None) -> InputError:
        kind, remedy = "number", "correct it"
        if axis is not None:
            kind, remedy = (
                "angle",
                f"write decimal degrees, or such as 46 30 12.5 {'N' if axis == 'latitude' else 'E'}",
            )
        elif re.search(r"\d[.,]\d{3}$", cell):
            remedy = "write it without a separator of thousands and with a decimal point"
        both = " (the table has decimal commas)" if self.marks.decimal == "," else ""
        return InputError(
            f"{self.where}, line {line}: {printable(cell)[:_LONGEST_CELL]!r} in the column {name} is no {kind}{both}; {remedy}."
        )


def read_text_table(path: str | Path, what: str, unnamed: Sequence[str] = ()) -> TextTable:
    """Read a table, with a header unless its columns are known; the separator is found by itself.

    Parameters
    ----------
    path : str or pathlib.Path
        Text file in UTF-8, UTF-16 or Windows-1252. Lines before the header that begin with ``#`` or ``%``, the line
        ``sep=;`` of spreadsheets and empty lines are skipped; the last of them is the header where it has as many names as
        the first row has numbers.
    what : str
        What the table is, for the message.
    unnamed : sequence of str, optional
        Names of the columns of a table without a header; colours may follow.

    Returns
    -------
    TextTable
        The cells. Numbers have decimal commas where cells are not separated by commas and a number has one;
        `NumberMarks` has the separator of thousands.

    Raises
    ------
    InputError
        Missing, no text, no header, no rows, a row of another length, or cut off in the middle of a line.
    CapacityError
        Larger than `LARGEST_BYTES`.
    """
    file = existing_file(path, what)
    where = f"{what} {file}"
    lines = _lines(file, where)
    header_at = next(
        (k for k, line in enumerate(lines) if line.strip() and not line.startswith(_COMMENTS)), None
    )
    if header_at is None:
        raise InputError(f"{where} is empty; a header such as Point,Easting,Northing,Elevation was expected.")
    last = lines[-1]
    lines = [line.rstrip("\r\n") for line in lines]
    separator = _separator(lines[header_at])
    cells = _cells(lines[header_at:], separator, where)
    names = _names_of(cells[0], unnamed) or _names_in_comment(lines[:header_at], separator, cells[0])
    header = _header(names or cells[0], where)
    numbered = [(header_at + k, row) for k, row in enumerate(cells, start=1) if any(map(str.strip, row))]
    numbered = numbered if names else numbered[1:]
    header, numbered = _as_counted(header, numbered)
    _check_rows(numbered, header, where)
    rows = [row for _, row in numbered]
    refuse_cut_off(last, rows, where)
    marks = NumberMarks.among((cell for row in rows for cell in row), has_commas=separator != ",")
    return TextTable(header, rows, [line for line, _ in numbered], marks, where)


def _lines(file: Path, where: str) -> list[str]:
    """Return the lines of a file in UTF-8, or in the Windows encoding that spreadsheets still write."""
    if file.stat().st_size > LARGEST_BYTES:
        raise CapacityError(
            f"{where} has {file.stat().st_size:,} bytes; tables of up to {LARGEST_BYTES:,} are read, split it."
        )
    content = file.read_bytes()
    if content.startswith(_UTF16):  # "Unicode text" of spreadsheets
        content = content.decode("utf-16", errors="replace").encode()
    if b"\0" in content:
        raise InputError(f"{where} is no text table (it holds bytes of 0); a CSV file was expected.")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        try:
            text = content.decode("cp1252")
        except UnicodeDecodeError as error:
            raise InputError(
                f"{where} is no text table ({first_line(error)}); a CSV file was expected."
            ) from error
    return text.splitlines(keepends=True)


def _separator(header: str) -> str:
    """Return what separates cells: a semicolon, a tab or a comma where the header has one, else blanks."""
    return next((mark for mark in (";", "\t", ",") if mark in header), " ")


def _cells(lines: list[str], separator: str, where: str) -> list[list[str]]:
    if separator == " ":
        return [line.split() for line in lines]
    try:
        return list(csv.reader(lines, delimiter=separator, strict=True))
    except csv.Error as error:
        raise InputError(
            f"{where} is no text table ({first_line(error)}); a CSV file was expected."
        ) from error


def _are_numbers(cells: Sequence[str]) -> bool:
    return sum(map(is_decimal, cells)) >= _LEAST_NUMBERS


def _names_of(first: Sequence[str], unnamed: Sequence[str]) -> list[str]:
    """Return names for a table without a header: those of its columns, and numbers for colours behind them."""
    colours = first[len(unnamed) :]
    has_colours = not colours or (len(colours) >= _N_COLOURS and all(map(_is_byte, colours[:_N_COLOURS])))
    if not unnamed or len(first) < len(unnamed) or not all(map(is_decimal, first)) or not has_colours:
        return []
    return [*unnamed, *(f"column_{k}" for k in range(len(unnamed) + 1, len(first) + 1))]


def _is_byte(cell: str) -> bool:
    return cell.strip().isdecimal() and int(cell) <= 255


def _names_in_comment(before: Sequence[str], separator: str, first: Sequence[str]) -> list[str]:
    """Return the names that the last comment before a row of numbers holds; none where their number differs."""
    comment = next((line for line in reversed(before) if line.strip()), "")
    names = _cells([comment.lstrip("#% ")], separator, "")[0] if comment.startswith(_COMMENTS[:2]) else []
    return names if len(names) == len(first) and _are_numbers(first) else []


def _header(cells: Sequence[str], where: str) -> list[str]:
    names = [cell.strip() for cell in cells]
    while names and not names[-1]:  # a separator at the end of the line
        names.pop()
    if _are_numbers(names):
        raise InputError(
            f"{where} has no header line (it begins with {printable(', '.join(names))[:80]}); "
            "add one that names its columns in their order, such as Point,Easting,Northing,Elevation."
        )
    refuse_repeated_columns(names, where)
    return names


def _as_counted(
    header: list[str], numbered: list[tuple[int, list[str]]]
) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Return header and rows without a line that counts the rows (CloudCompare), and with a name for those of R.

    R numbers the rows in quotes and leaves the name of that column out.
    """
    if numbered and numbered[0][1] == [str(len(numbered) - 1)]:
        numbered = numbered[1:]
    if numbered and all(
        len(row) == len(header) + 1 and row[0] == f'"{k}"' for k, (_, row) in enumerate(numbered, start=1)
    ):
        header = ["row", *header]
    return header, numbered


def _check_rows(numbered: list[tuple[int, list[str]]], header: list[str], where: str) -> None:
    if not numbered:
        raise InputError(f"{where} has a header and no rows; it may be half-written, make it again.")
    for line, row in numbered:
        while len(row) > len(header) and not row[-1].strip():
            row.pop()
        if len(row) != len(header):
            raise InputError(
                f"{where}, line {line}: {len(row)} values where the header names {len(header)}; "
                "remove lines before the header, or make the file again where it is cut off."
            )

"""Text tables of other programs: separators, decimal marks, angles and times.

`read_text_table` finds the separator (comma, semicolon, tab or blanks) and the header. Apostrophes and blanks between
groups of three digits can only separate thousands. A comma or a point does so in a table that proves it: by a number with
both marks (1,234.5 or 1.234,5), or with one of them twice (1,234,567). Angles may be written
in degrees, minutes and seconds. Degrees whose hemisphere stands in a column of its own, without a sign, are refused, and so
are times of day and dates written as one number (100015 for 10:00:15).
"""

import csv
import logging
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from survey.core import CapacityError, FloatArray, InputError, existing_file, first_line, printable
from survey.io import plain_columns
from survey.io.tables import refuse_cut_off_line, refuse_repeated_columns

_NUMBER = r"[+-]?\d{{1,3}}({0}\d{{3}})+"
_BLANKS = re.compile(_NUMBER.format("['\u2019 \u00a0\u202f]") + r"([.,]\d*)?")
_GROUPED = {
    mark: re.compile(_NUMBER.format(re.escape(mark)) + rf"({other}\d*)?")
    for mark, other in ((",", r"\."), (".", ","))
}
_PROOFS = {
    mark: re.compile(rf"[+-]?\d{{1,3}}(({group}\d{{3}})+{other}\d+|({group}\d{{3}}){{2,}})")
    for mark, group, other in ((",", ",", r"\."), (".", r"\.", ","))
}


class NumberMarks(NamedTuple):
    """Decimal mark of a table, and the mark that separates thousands beside apostrophes and blanks; "" for none."""

    decimal: str = "."
    thousands: str = ""

    @classmethod
    def among(cls, cells: Iterable[str], *, has_commas: bool) -> "NumberMarks":
        """Return the marks of a table by its cells; `has_commas` is true where commas do not separate cells.

        >>> NumberMarks.among(["1,234.5", "812.5", "2,001"], has_commas=True)
        NumberMarks(decimal='.', thousands=',')
        >>> NumberMarks.among(["812,5", "2,001"], has_commas=True)
        NumberMarks(decimal=',', thousands='')
        """
        proved, has_decimal_commas = set(), False
        for cell in map(_without_blanks, cells):
            proved |= {mark for mark, proof in _PROOFS.items() if proof.fullmatch(cell)}
            has_decimal_commas |= has_commas and "," in cell and is_decimal(cell)
        if proved == {","}:
            return cls(".", ",")
        if proved == {"."}:
            return cls(",", ".")
        return cls("," if has_decimal_commas else ".")

    def plain(self, cell: str) -> str:
        """Return a cell with a decimal point and without separators of thousands; what is no number as it is.

        >>> NumberMarks().plain("1'234.5"), NumberMarks(",", ".").plain("1.234,5"), NumberMarks(",").plain("1.234")
        ('1234.5', '1234.5', '1;234')
        """
        text = _without_blanks(cell)
        if self.thousands and _GROUPED[self.thousands].fullmatch(text):
            text = text.replace(self.thousands, "")
        if self.decimal == ".":
            return text
        return text.replace(".", ";").replace(",", ".")


def _without_blanks(cell: str) -> str:
    """Return a number without the apostrophes and blanks that separate its thousands; what is no number as it is."""
    text = cell.strip()
    return re.sub(r"['\u2019 \u00a0\u202f]", "", text) if _BLANKS.fullmatch(text) else text


def is_decimal(cell: str) -> bool:
    """Return whether a cell is a number with a decimal point or a decimal comma."""
    try:
        float(cell.strip().replace(",", ".", 1))
    except ValueError:
        return False
    return "_" not in cell


Axis = Literal["longitude", "latitude"]

_LETTERS = {"longitude": "EW", "latitude": "NS"}
_LIMITS = {"longitude": 360.0, "latitude": 90.0}
_DEGREES = r"(?P<degrees>\d{1,3}(?:\.\d+)?)\s*(?:[°º˚d]|deg)?"
_MINUTES = r"(?P<minutes>\d{1,2}(?:\.\d+)?)\s*(?:['′’‘´m]|min)?"
_SECONDS = r"(?P<seconds>\d{1,2}(?:\.\d+)?)\s*(?:[\"″”“]|''|′′|’’|sec)?"
# The letter s marks no seconds: it stands for the south. A mark or a blank has to part the numbers.
_PARTED = r"(?:(?<=[^\d.])\s*|\s+|[:-])"
_ANGLE = re.compile(
    rf"(?P<before>[NSEW])?\s*(?P<sign>[+-])?\s*{_DEGREES}(?:{_PARTED}{_MINUTES}(?:{_PARTED}{_SECONDS})?)?\s*(?P<after>[NSEW])?",
    re.IGNORECASE,
)


def degrees(text: str, axis: Axis) -> float | None:
    r"""Return an angle in degrees, negative to the south and the west; None for what is none, or could be another one.

    >>> round(degrees("46 30 12.5 N", "latitude"), 6), degrees("7 15 0 W", "longitude"), degrees("46 75 0", "latitude")
    (46.503472, -7.25, None)
    """
    found = _ANGLE.fullmatch(text.strip())
    if found is None:
        return None
    letters = [letter.upper() for letter in found.group("before", "after") if letter]
    if len(letters) + (found["sign"] is not None) > 1 or any(one not in _LETTERS[axis] for one in letters):
        return None
    parts = [part for part in found.group("degrees", "minutes", "seconds") if part is not None]
    values = [float(part) for part in parts]
    if any("." in part for part in parts[:-1]) or any(value >= 60.0 for value in values[1:]):
        return None
    angle = sum(value / 60.0**k for k, value in enumerate(values))
    if angle > _LIMITS[axis]:
        return None
    return -angle if found["sign"] == "-" or (letters and letters[0] in "SW") else angle


LARGEST_BYTES = 200_000_000
"""Largest table of text that is read."""
_COMMENTS = ("#", "%", "sep=")
# Rows of so many numbers have no names.
_LEAST_NUMBERS = 3
_N_COLOURS = 3
_LONGEST_CELL = 40
_UNNAMED = "column_"
# First lines of a table, which show what it holds.
_HEAD_BYTES = 65536
_UTF16 = (b"\xff\xfe", b"\xfe\xff")


class TextTable(NamedTuple):
    """Columns of a text table, with the numbers of its lines.

    `cells`: texts of a column by its index. `parsed`: numbers (N,) of the columns that were read as such.
    """

    header: list[str]
    cells: Callable[[int], Sequence[str]]
    lines: Sequence[int]
    marks: NumberMarks
    where: str
    parsed: Mapping[int, FloatArray] = {}

    def texts(self, name: str) -> tuple[str, ...]:
        """Return the cells of a column as they are."""
        return tuple(cell.strip() for cell in self.cells(self.header.index(name)))

    def numbers(self, name: str, axis: Axis | None = None) -> FloatArray:
        """Return a column of numbers (N,); of angles [deg], in whatever way they are written, where an axis is named."""
        parsed = self.parsed.get(self.header.index(name))
        if parsed is not None:
            return parsed.copy()
        values = np.empty(len(self.lines))
        for k, (line, cell) in enumerate(zip(self.lines, self.texts(name), strict=True)):
            number = self._number(cell, axis)
            if number is None:
                raise self._no_number(cell, line, name, axis)
            values[k] = number
        return values

    def is_number(self, name: str, row: int, axis: Axis | None = None) -> bool:
        """Return whether a cell of a column is a number, with the marks of the table."""
        index = self.header.index(name)
        return index in self.parsed or self._number(self.cells(index)[row].strip(), axis) is not None

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


def read_text_table(path: str | Path, what: str, unnamed: Sequence[str] = (), width: int = 0) -> TextTable:
    """Read a table, with a header unless its columns are known; the separator is found by itself.

    `width`: number of columns that are named by their positions, if any; what rows hold behind them, such as descriptions
    with commas, is left out.
    """
    file = existing_file(path, what)
    where = f"{what} {file}"
    content = _content(file, where)
    table = _plain_table(content, where, unnamed, width) or _table(
        _lines(content, where), where, unnamed, width
    )
    if width and table.header[0] == f"{_UNNAMED}1":
        logging.getLogger(__name__).warning(
            "%s: the columns 1 to %d are read, and nothing behind them.", where, width
        )
    return table


def _table(
    lines: list[str], where: str, unnamed: Sequence[str], width: int, is_whole: bool = True
) -> TextTable:
    """Return the table of all lines of a file, or of its first ones, by a look at every cell."""
    header_at = _header_at(lines)
    if header_at is None:
        raise InputError(f"{where} is empty; a header such as Point,Easting,Northing,Elevation was expected.")
    last = lines[-1]
    lines = [line.rstrip("\r\n") for line in lines]
    separator = _separator(lines[header_at])
    cells = _cells(lines[header_at:], separator, where)
    last_cells = len(cells[-1])
    width = width if _are_numbers(cells[0]) else 0
    if width:
        cells = _first_columns(cells, width, header_at, where)
    names = [f"{_UNNAMED}{k}" for k in range(1, width + 1)] or _names_of(cells[0], unnamed)
    names = names or _names_in_comment(lines[:header_at], separator, cells[0])
    header = _header(names or cells[0], where)
    numbered = [(header_at + k, row) for k, row in enumerate(cells, start=1) if any(map(str.strip, row))]
    numbered = numbered if names else numbered[1:]
    header, numbered = _as_counted(header, numbered)
    _check_rows(numbered, header, where)
    rows = [row for _, row in numbered]
    if is_whole and not 0 < width < last_cells:  # what is cut off there is not read
        refuse_cut_off_line(last, rows, where)
    marks = NumberMarks.among((cell for row in rows for cell in row), has_commas=separator != ",")
    columns = list(zip(*rows, strict=True))
    return TextTable(header, columns.__getitem__, [line for line, _ in numbered], marks, where)


def _header_at(lines: Sequence[str]) -> int | None:
    return next((k for k, line in enumerate(lines) if line.strip() and not line.startswith(_COMMENTS)), None)


def _plain_table(content: bytes, where: str, unnamed: Sequence[str], width: int) -> TextTable | None:
    """Return a large table as `_table` does, where that needs no look at every cell; None for all others.

    The first lines show the names of the columns, and which begin with a number.
    """
    if len(content) < plain_columns.LEAST_BYTES or not content.endswith(b"\n"):
        return None
    head = content[: content.rfind(b"\n", 0, _HEAD_BYTES) + 1]
    try:
        lines = _lines(head, where)
        first = _table(lines, where, unnamed, width, is_whole=False)
    except InputError:
        return None  # it may be a fault of the first lines alone
    at, separator = first.lines[0] - 1, _separator(lines[_header_at(lines) or 0])
    n_columns = len(_cells([lines[at].rstrip("\r\n")], separator, where)[0])
    is_cut = width and first.header[0] == f"{_UNNAMED}1"
    if len(lines) != head.count(b"\n") or not (is_cut or n_columns == len(first.header)):
        return None
    body = content[len(b"".join(head.splitlines(keepends=True)[:at])) :]
    return _parsed(first, body, separator, n_columns)


def _parsed(first: TextTable, body: bytes, separator: str, n_columns: int) -> TextTable | None:
    """Return the table of all rows by that of the first ones; None where a cell has to be looked at."""
    kinds: list[plain_columns.Kind] = [
        "number" if first.is_number(name, 0) else "text" for name in first.header
    ]
    kinds += ["unused"] * (n_columns - len(kinds))
    decimal = "," if separator != "," and b"," in body and b"." not in body else "."
    found = plain_columns.plain_columns(body, separator, kinds, decimal)
    parsed = {k: column for k, column in (found or {}).items() if kinds[k] == "number"}
    if (
        not found
        or not parsed
        or (decimal == "," and not any((column % 1.0).any() for column in parsed.values()))
    ):
        return None  # commas that stand in texts alone are no marks of the table
    texts = (cell for k in found.keys() - parsed for cell in plain_columns.may_be_numbers(found[k]))
    if NumberMarks.among(texts, has_commas=separator != ",") not in (NumberMarks(), NumberMarks(decimal)):
        return None

    @cache
    def cells(index: int) -> Sequence[str]:
        only: list[plain_columns.Kind] = ["text" if k == index else "unused" for k in range(n_columns)]
        column = plain_columns.plain_columns(body, separator, only, decimal)
        assert column is not None  # the body is plain
        return list(column[index].to_pylist())

    lines = range(first.lines[0], first.lines[0] + len(next(iter(parsed.values()))))
    return TextTable(first.header, cells, lines, NumberMarks(decimal), first.where, parsed)


def _first_columns(cells: list[list[str]], width: int, header_at: int, where: str) -> list[list[str]]:
    """Return the first cells of each row; refuse rows of fewer."""
    for line, row in enumerate(cells, start=header_at + 1):
        if 0 < len(row) < width and any(map(str.strip, row)):
            raise InputError(
                f"{where}, line {line}: {len(row)} values, and column {width} was named by its position; correct --columns or --format, or "
                "make the file again where it is cut off."
            )
    return [row[:width] for row in cells]


def _content(file: Path, where: str) -> bytes:
    """Return the bytes of a file of text, in UTF-8 or a local encoding."""
    if file.stat().st_size > LARGEST_BYTES:
        raise CapacityError(
            f"{where} has {file.stat().st_size:,} bytes; tables of up to {LARGEST_BYTES:,} are read, split it."
        )
    content = file.read_bytes()
    if content.startswith(_UTF16):  # "Unicode text" of spreadsheets
        content = content.decode("utf-16", errors="replace").encode()
    if b"\0" in content:
        raise InputError(f"{where} is no text table (it holds bytes of 0); a CSV file was expected.")
    return content


def _lines(content: bytes, where: str) -> list[str]:
    """Return the lines of a text in UTF-8, or in the Windows encoding that spreadsheets still write."""
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
    return [*unnamed, *(f"{_UNNAMED}{k}" for k in range(len(unnamed) + 1, len(first) + 1))]


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
            "name the order of its columns with --format pnezd (penz, xyz), or their positions with --columns x=3,y=2,z=4, or add a line such as "
            "Point,Easting,Northing,Elevation."
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


def refuse_hemispheres(table: TextTable, longitude: FloatArray, latitude: FloatArray) -> None:
    """Refuse a table whose degrees count to the south or the west in a column of their own, without a sign.

    `longitude`, `latitude` (N,): degrees as it states them.
    """
    for name in (name for name in table.header if not table.is_number(name, 0)):
        cells = [cell.upper() for cell in table.texts(name)]
        for letters, negative, degrees in (("NS", "S", latitude), ("EW", "W", longitude)):
            is_hemisphere = all(cell and cell in letters and len(cell) == 1 for cell in cells)
            if is_hemisphere and any(c == negative and v > 0.0 for c, v in zip(cells, degrees, strict=True)):
                raise InputError(
                    f"{table.where} states {negative} in the column {name} beside degrees without a sign; "
                    "write those with a minus sign and remove the column."
                )


# 19700101000000 to 21000101000000
_CALENDAR = (1.97e13, 2.1e13)
_DAY_CLOCK = 240000.0
# Seconds that a number of hours, minutes and seconds leaps over from one minute to the next.
_LEAP_S = 40.0
_EVEN_S = 1.0


def refuse_clock_numbers(numbers: FloatArray, where: str) -> None:
    """Refuse numbers that are dates or times of day and would be taken for seconds.

    `numbers` (N,): the column of times.

    >>> refuse_clock_numbers(np.array([0.0, 40.0, 80.0, 120.0]), "fixes.csv")
    >>> refuse_clock_numbers(np.array([100040.0, 100050.0, 100100.0]), "fixes.csv")
    Traceback (most recent call last):
    survey.core.errors.InputError: fixes.csv counts hours, minutes and seconds in one number (100040); ...
    """
    if ((numbers > _CALENDAR[0]) & (numbers < _CALENDAR[1])).all() or _is_days(numbers):
        raise InputError(
            f"{where} writes dates as one number ({numbers[0]:.0f}); write them as 2024-06-12T10:00:15Z or as Unix time."
        )
    if _is_clock(numbers):
        raise InputError(
            f"{where} counts hours, minutes and seconds in one number ({numbers[0]:.6g}); "
            "write seconds, or dates such as 2024-06-12T10:00:15Z."
        )


def _is_days(numbers: FloatArray) -> bool:
    """Return whether all numbers are days such as 20240612."""
    years, rest = np.divmod(numbers, 10000.0)
    months, days = np.divmod(rest, 100.0)
    is_day = (years >= 1900) & (years <= 2100) & (months >= 1) & (months <= 12) & (days >= 1) & (days <= 31)
    return bool((is_day & (numbers == np.rint(numbers))).all())


def _is_clock(numbers: FloatArray) -> bool:
    """Return whether numbers of uneven steps have even ones when they are read as hours, minutes and seconds."""
    hours, rest = np.divmod(numbers, 10000.0)
    minutes, seconds = np.divmod(rest, 100.0)
    is_possible = (numbers >= 0.0) & (numbers < _DAY_CLOCK) & (minutes < 60.0) & (seconds < 60.0)
    if len(numbers) < 3 or not is_possible.all():
        return False
    uneven, even = np.ptp(np.diff(numbers)), np.ptp(np.diff(3600.0 * hours + 60.0 * minutes + seconds))
    return bool(uneven >= _LEAP_S - _EVEN_S and even < _EVEN_S)

"""Tables of numbers as CSV: a header with units, full precision, every cell checked."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import CapacityError, InputError
from survey.core.files.library_messages import first_line
from survey.core.files.reading import existing_file
from survey.core.files.writing import replacing
from survey.core.text import printable
from survey.io.last_line import last_lines, refuse_cut_off

LARGEST_ROWS = 30_000_000
"""Longest table that is read: 1 GB for four columns."""
_ROWS_AT_ONCE = 50_000
_LONGEST_CELL = 40


def write_table(path: str | Path, columns: Mapping[str, FloatArray]) -> None:
    """Write equally long columns with a header; numbers read back exactly as they were.

    Parameters
    ----------
    path : str or pathlib.Path
        The CSV file.
    columns : mapping of str to (N,) ndarray
        Units stand in the names.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    rows = zip(*(np.asarray(column, dtype=np.float64).tolist() for column in columns.values()), strict=True)
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(columns) + "\n")
        file.writelines(",".join(map(repr, row)) + "\n" for row in rows)


def read_table(
    path: str | Path, required: Sequence[str], *, what: str, texts: Sequence[str] = ()
) -> dict[str, FloatArray]:
    """Read every column of a CSV table of numbers, but for those named in `texts`.

    Parameters
    ----------
    path : str or pathlib.Path
        The CSV file, with commas between the cells and points in the numbers.
    required : sequence of str
        Columns that the header must hold; others may stand beside them.
    what : str
        What the table is, for the message.
    texts : sequence of str
        Columns that are passed over.

    Returns
    -------
    dict of str to (N,) ndarray
        Columns by name, in the order of the header.

    Raises
    ------
    InputError
        The file is missing, lacks a required column or names one twice, has a row that is too short or too
        long, or holds something that is no number; the message names the line.
    CapacityError
        It has more than `LARGEST_ROWS` rows.
    """
    file = existing_file(path, what)
    where = f"{what} {file}"
    try:
        with file.open(encoding="utf-8-sig", newline="") as stream:
            rows = csv.reader(stream, strict=True)
            header = _header(next(rows, []), required, where)
            kept = [index for index, name in enumerate(header) if name not in texts]
            parts = list(_parts(rows, header, kept, where))
        _refuse_cut_off(file, len(header), where)
    except (UnicodeError, csv.Error, OSError) as error:
        raise InputError(
            f"{where} is no text table ({first_line(error)}); a CSV file was expected."
        ) from error
    if not parts:
        raise InputError(f"{where} has a header and no rows; it may be half-written, make it again.")
    numbers = np.concatenate(parts)
    return {header[index]: np.ascontiguousarray(numbers[:, k]) for k, index in enumerate(kept)}


def _header(cells: list[str], required: Sequence[str], where: str) -> list[str]:
    names = [name.strip() for name in cells]
    missing = [name for name in required if name not in names]
    if missing:
        found = printable(", ".join(names))[:200] or "nothing"
        raise InputError(
            f"{where} lacks the column {missing[0]!r} (found {found}); the header must hold {', '.join(required)}."
        )
    refuse_repeated_columns(names, where)
    return names


def refuse_repeated_columns(names: Sequence[str], where: str) -> None:
    """Refuse a header that names a column twice."""
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(
            f"{where} names the column {twice!r} {names.count(twice)} times; leave the one that is meant."
        )


def _parts(rows: Any, header: list[str], kept: list[int], where: str) -> Iterator[FloatArray]:
    """Yield the numbers (n, k) of the rows, many at a time, so that memory is taken for numbers alone.

    Empty lines are skipped, as in the tables of other programs.
    """
    n_read = 0
    while chunk := list(islice(rows, _ROWS_AT_ONCE)):
        first = n_read + 2
        for number, row in enumerate(chunk, start=first):
            if row and len(row) != len(header):
                raise InputError(
                    f"{where}, line {number}: {len(row)} values where the header names {len(header)}; "
                    "the file may be cut off, make it again."
                )
        n_read += len(chunk)
        if n_read > LARGEST_ROWS:
            raise CapacityError(
                f"{where} has more than {LARGEST_ROWS:,} rows, which are the most that can be read; split or thin it."
            )
        lines = [number for number, row in enumerate(chunk, start=first) if row]
        if lines:
            yield _numbers(
                [[row[index] for index in kept] for row in chunk if row], header, kept, lines, where
            )


def _numbers(
    cells: list[list[str]], header: list[str], kept: list[int], lines: list[int], where: str
) -> FloatArray:
    try:
        # Python's own grouping of digits, 1_000, is no number in a table.
        if not any("_" in cell for row in cells for cell in row):
            numbers: FloatArray = np.array(cells, dtype=np.float64)
            return numbers
    except ValueError:
        pass
    number, index, cell = next(
        (number, index, cell)
        for number, row in zip(lines, cells, strict=True)
        for index, cell in zip(kept, row, strict=True)
        if not _is_number(cell)
    )
    raise InputError(
        f"{where}, line {number}: {cell[:_LONGEST_CELL]!r} in the column {header[index]} is no number; correct it."
    )


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell


def _refuse_cut_off(file: Path, n_columns: int, where: str) -> None:
    """Refuse a table whose last line has no line break and could be cut off, by the lines at its end."""
    lines = last_lines(file)
    # The first line is the header, or the rest of a line.
    rows = [row for row in csv.reader(lines[1:]) if len(row) == n_columns]
    refuse_cut_off(lines[-1], rows, where)

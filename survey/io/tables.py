"""Tables of numbers as CSV: a header with units, full precision, every cell checked.

Numbers read back exactly as they were written. A last line without a line break is refused where it could be cut off in
the middle of a value; text tables of other programs are checked in the same way.
"""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from survey.core import CapacityError, FloatArray, InputError, existing_file, first_line, printable, replacing
from survey.io import plain_columns

LARGEST_ROWS = 30_000_000
"""Longest table that is read: 1 GB for four columns."""
_ROWS_AT_ONCE, _BYTES_AT_ONCE = 50_000, 2**25
_LONGEST_CELL = 40


def write_table(path: str | Path, columns: Mapping[str, FloatArray]) -> None:
    """Write equally long columns with a header; numbers read back exactly as they were."""
    rows = zip(*(np.asarray(column, dtype=np.float64).tolist() for column in columns.values()), strict=True)
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(columns) + "\n")
        file.writelines(",".join(map(repr, row)) + "\n" for row in rows)


def read_table(
    path: str | Path, required: Sequence[str], *, what: str, texts: Sequence[str] = ()
) -> dict[str, FloatArray]:
    """Read every column of a CSV table of numbers, but for those named in `texts`."""
    file = existing_file(path, what)
    where = f"{what} {file}"
    try:
        with file.open(encoding="utf-8-sig", newline="") as stream:
            rows = csv.reader(stream, strict=True)
            header = _header(next(rows, []), required, where)
            kept = [index for index, name in enumerate(header) if name not in texts]
            parts = _plain_parts(file, len(header), kept) or list(_parts(rows, header, kept, where))
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


def _plain_parts(file: Path, n_columns: int, kept: Sequence[int]) -> list[FloatArray]:
    """Return the numbers (n, k) of all rows of a large plain table; none where every cell has to be looked at."""
    if file.stat().st_size < plain_columns.LEAST_BYTES or not kept:
        return []
    kinds: list[plain_columns.Kind] = ["number" if k in kept else "unused" for k in range(n_columns)]
    parts: list[FloatArray] = []
    with file.open("rb") as stream:
        stream.readline()
        while block := stream.read(_BYTES_AT_ONCE):
            found = plain_columns.plain_columns(block + stream.readline(), ",", kinds)
            if found is None or sum(map(len, parts)) > LARGEST_ROWS:
                return []
            parts.append(np.array([found[index] for index in kept]).T)
    return parts


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
        if "_" in cell or not is_number(cell)
    )
    raise InputError(
        f"{where}, line {number}: {cell[:_LONGEST_CELL]!r} in the column {header[index]} is no number; correct it."
    )


def is_number(cell: str) -> bool:
    """Return whether a cell is a number to Python, which takes 1_000 for one too."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _refuse_cut_off(file: Path, n_columns: int, where: str) -> None:
    """Refuse a table whose last line has no line break and could be cut off, by the lines at its end."""
    lines = last_lines(file)
    # The first line is the header, or the rest of a line.
    rows = [row for row in csv.reader(lines[1:]) if len(row) == n_columns]
    refuse_cut_off_line(lines[-1], rows, where)


# With fewer other rows, an equal number of decimals could be chance.
_LEAST_ROWS = 3
_TAIL_BYTES = 65536
_FIXED_POINT = re.compile(r"[+-]?\d+[.,](\d+)")


def last_lines(file: Path) -> list[str]:
    """Return the lines at the end of a text file with their line breaks; the first of them may be the rest of one."""
    with file.open("rb") as stream:
        size = stream.seek(0, 2)
        stream.seek(max(size - _TAIL_BYTES, 0))
        return stream.read().decode(errors="replace").splitlines(keepends=True)


def refuse_cut_off_line(last: str, rows: Sequence[Sequence[str]], where: str) -> None:
    r"""Refuse a table whose last line has no line break and could be cut off in the middle of its last value.

    Google Sheets and many editors end a table so. The last value is complete where a shorter one would be seen: in
    quotes, a text that other rows hold and that begins no other text, or a number of a table in which every column has
    as many decimals in all rows.

    >>> rows = [["1.0", "811.20"], ["2.0", "811.95"], ["3.0", "812.10"]]
    >>> refuse_cut_off_line("4.0,812.55", [*rows, ["4.0", "812.55"]], "a.csv")
    >>> refuse_cut_off_line("4.0,812.5", [*rows, ["4.0", "812.5"]], "a.csv")
    Traceback (most recent call last):
    survey.core.errors.InputError: a.csv ends in the middle of a line; it may be cut off, ...
    """
    if last.endswith(("\n", "\r")) or (rows and _is_complete(last, rows)):
        return
    raise InputError(
        f"{where} ends in the middle of a line; it may be cut off, make it again or end it with a line break."
    )


def _is_complete(last: str, rows: Sequence[Sequence[str]]) -> bool:
    *others, cell = [row[-1].strip() for row in rows]
    if last.rstrip(" ").endswith('"') and not cell.endswith('"'):
        return True  # the mark that ends a quoted cell; in the middle of one a strict reader finds none
    if len(others) < _LEAST_ROWS or not cell:
        return False
    if not any(map(_begins_as_number, others)):
        return cell in others and not any(other != cell and other.startswith(cell) for other in others)
    has_decimals = _FIXED_POINT.fullmatch(cell) is not None
    return has_decimals and all(map(_has_fixed_decimals, zip(*rows, strict=True)))


def _has_fixed_decimals(column: Sequence[str]) -> bool:
    """Return whether all numbers of a column have as many decimals; a column of texts has none."""
    found = [_FIXED_POINT.fullmatch(cell.strip()) for cell in column]
    return len({0 if match is None else len(match.group(1)) for match in found}) == 1


def _begins_as_number(cell: str) -> bool:
    return bool(re.match(r"[+-]?[.,]?\d", cell))

"""The last line of a text table that has no line break: complete, or cut off in the middle of a value."""

import re
from collections.abc import Sequence
from pathlib import Path

from survey.core.errors import InputError

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


def refuse_cut_off(last: str, rows: Sequence[Sequence[str]], where: str) -> None:
    r"""Refuse a table whose last line has no line break and could be cut off in the middle of its last value.

    Google Sheets and many editors end a table so. The last value is complete where a shorter one would be seen: in
    quotes, a text that other rows hold and that begins no other text, or a number of a table in which every column has
    as many decimals in all rows.

    Parameters
    ----------
    last : str
        The last line, with its line break where it has one.
    rows : sequence of sequence of str
        Cells of all rows, as many in each, those of the last line included.
    where : str
        Name of the file, for the message.

    Raises
    ------
    InputError
        The last value could be the beginning of a longer one.

    Examples
    --------
    >>> rows = [["1.0", "811.20"], ["2.0", "811.95"], ["3.0", "812.10"]]
    >>> refuse_cut_off("4.0,812.55", [*rows, ["4.0", "812.55"]], "a.csv")
    >>> refuse_cut_off("4.0,812.5", [*rows, ["4.0", "812.5"]], "a.csv")
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
    if not any(map(_is_number, others)):
        return cell in others and not any(other != cell and other.startswith(cell) for other in others)
    has_decimals = _FIXED_POINT.fullmatch(cell) is not None
    return has_decimals and all(map(_has_fixed_decimals, zip(*rows, strict=True)))


def _has_fixed_decimals(column: Sequence[str]) -> bool:
    """Return whether all numbers of a column have as many decimals; a column of texts has none."""
    found = [_FIXED_POINT.fullmatch(cell.strip()) for cell in column]
    return len({0 if match is None else len(match.group(1)) for match in found}) == 1


def _is_number(cell: str) -> bool:
    return bool(re.match(r"[+-]?[.,]?\d", cell))

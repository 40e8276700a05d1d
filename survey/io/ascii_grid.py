"""Esri ASCII grids (``.asc``): every number is checked, for GDAL reads letters and what is missing as 0."""

import math
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError

_KEYS = frozenset(
    [
        "ncols",
        "nrows",
        "xllcorner",
        "yllcorner",
        "xllcenter",
        "yllcenter",
        "cellsize",
        "dx",
        "dy",
        "nodata_value",
    ],
)
_LONGEST_HEADER = 16
_LONGEST_LINE = 64 * 2**20


def check_ascii_grid(file: Path) -> None:
    """Refuse an ASCII grid that holds anything but the numbers that its header announces.

    Parameters
    ----------
    file : pathlib.Path
        An existing ``.asc`` file.

    Raises
    ------
    InputError
        A header line that is unknown or given twice, a word that is no number, too few or too
        many numbers, or lines of unequal length where there is one line per row.
    """
    with file.open("rb") as stream, warnings.catch_warnings():
        # NumPy warns of text behind the numbers, and will refuse it.
        warnings.simplefilter("error", DeprecationWarning)
        header, first = _header(stream, file)
        counts = [len(row) for row in _rows(stream, first, file, len(header) + 1)]
    _check_place(header, file)
    columns, rows = _whole(header, "ncols", file), _whole(header, "nrows", file)
    if sum(counts) != columns * rows:
        raise InputError(
            f"{file} holds {sum(counts):,} numbers where its header names {rows:,} rows of {columns:,}; it was cut off or changed, get it again."
        )
    uneven = next((k for k, n in enumerate(counts) if n != columns), None)
    if len(counts) == rows and uneven is not None:
        raise InputError(
            f"{file}, row {uneven + 1}: {counts[uneven]:,} numbers where the header names {columns:,}; correct the row."
        )


def _check_place(header: dict[str, float], file: Path) -> None:
    """Refuse a header without a place: GDAL puts the grid at 0, 0 where corner and centre are mixed."""
    if not any({f"xll{at}", f"yll{at}"} <= header.keys() for at in ("corner", "center")):
        raise InputError(
            f"{file} has a header with {', '.join(key for key in header if key.startswith(('xll', 'yll'))) or 'no place'}; xllcorner and yllcorner, "
            "or xllcenter and yllcenter, were expected."
        )


def _header(stream: IO[bytes], file: Path) -> tuple[dict[str, float], bytes]:
    """Return the values of the header, and the first line behind it."""
    header: dict[str, float] = {}
    for _ in range(_LONGEST_HEADER):
        line = stream.readline(_LONGEST_LINE)
        words = line.split()
        if not words and line:
            continue
        if not words or not words[0][:1].isalpha() or words[0].lower() in (b"nan", b"inf"):
            return header, line
        key = words[0].decode("ascii", "replace").lower()
        if len(words) != 2 or key not in _KEYS or key in header:
            found = line.decode("ascii", "replace").strip()[:60]
            raise InputError(
                f"{file} has the header line {found!r}; each of ncols, nrows, xllcorner, yllcorner, cellsize and nodata_value was expected once with one number."
            )
        header[key] = float(_numbers(words[1], file, len(header) + 1)[0])
    raise InputError(f"{file} has a header of more than {_LONGEST_HEADER} lines; it is no ASCII grid.")


def _rows(stream: IO[bytes], first: bytes, file: Path, number: int) -> Iterator[FloatArray]:
    """Yield the numbers of each line that holds any."""
    line = first
    while line:
        if len(line) >= _LONGEST_LINE:
            raise InputError(
                f"{file}, line {number}: it is longer than {_LONGEST_LINE:,} bytes; write one line per row."
            )
        if not line.isspace():
            yield _numbers(line, file, number)
        line, number = stream.readline(_LONGEST_LINE), number + 1


def _numbers(text: bytes, file: Path, number: int) -> FloatArray:
    try:
        values: FloatArray = np.fromstring(text, dtype=np.float64, sep=" ")
    except (DeprecationWarning, ValueError):
        values = np.empty(0)
    if len(values) == 0:
        raise InputError(
            f"{file}, line {number}: {_first_wrong(text)!r} is no number; correct it, or get the file again."
        )
    if not np.isfinite(values).all():
        raise InputError(
            f"{file}, line {number}: it holds nan or inf, which GDAL may read as 0; write the number that nodata_value names."
        )
    return values


def _first_wrong(text: bytes) -> str:
    for word in text.split():
        try:
            float(word)
        except ValueError:
            return word.decode("utf-8", "replace")[:40]
    return text[:40].decode("utf-8", "replace")


def _whole(header: dict[str, float], key: str, file: Path) -> int:
    value = header.get(key, math.nan)
    if not (value >= 1 and value.is_integer()):
        raise InputError(f"{file} has the {key} {value:g}; a whole number of at least 1 was expected.")
    return int(value)

"""Tables of numbers as CSV: a header with units, full precision, nothing guessed."""

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.core.files import existing_file, replacing


def write_table(path: str | Path, columns: Mapping[str, FloatArray]) -> None:
    """Write equally long columns with a header; numbers read back exactly as they were."""
    names = list(columns)
    rows = zip(*(np.asarray(column, dtype=np.float64).tolist() for column in columns.values()), strict=True)
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(names) + "\n")
        file.writelines(",".join(map(repr, row)) + "\n" for row in rows)


def read_table(
    path: str | Path, required: Sequence[str], *, what: str, texts: Sequence[str] = ()
) -> dict[str, FloatArray]:
    """Read every column of a CSV table of numbers, but for those named in `texts`.

    Raises
    ------
    InputError
        The file is missing, lacks a required column, has a row that is too short, or
        holds something that is no number; the message names the line.
    """
    file = existing_file(path, what)
    try:
        with file.open(encoding="utf-8", newline="") as stream:
            content = stream.read()
        rows = list(csv.reader(io.StringIO(content, newline="")))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{what} {file} is no text table ({error}); a CSV file was expected.") from error
    header = [name.strip() for name in rows[0]] if rows else []
    missing = [name for name in required if name not in header]
    if missing:
        raise InputError(
            f"{what} {file} lacks the column {missing[0]!r} (found {', '.join(header) or 'nothing'}); "
            f"the header must hold {', '.join(required)}."
        )
    body = rows[1:]
    if not body:
        raise InputError(f"{what} {file} has a header and no rows; it may be half-written, make it again.")
    for number, row in enumerate(body, start=2):
        if len(row) != len(header):
            raise InputError(
                f"{what} {file}, line {number}: {len(row)} values where the header names {len(header)}; "
                "the file may be cut off, make it again."
            )
    if not content.endswith(("\n", "\r")):
        raise InputError(
            f"{what} {file} ends in the middle of a line; it may be cut off, make it again or end it with a line break."
        )
    return {
        name: _numbers(body, index, f"{what} {file}", name)
        for index, name in enumerate(header)
        if name not in texts
    }


def _numbers(body: list[list[str]], index: int, where: str, name: str) -> FloatArray:
    try:
        return np.array([row[index] for row in body], dtype=np.float64)
    except ValueError:
        for number, row in enumerate(body, start=2):
            try:
                float(row[index])
            except ValueError as error:
                raise InputError(
                    f"{where}, line {number}: {row[index]!r} in the column {name} is no number; correct it."
                ) from error
        raise

"""Points in text tables: firnline's own CSV of numbers, and exports of receivers and other programs."""

import re
from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path

from survey.core.errors import InputError
from survey.core.files.reading import existing_file
from survey.io.point_columns import PLACE, in_own_columns, place_columns
from survey.io.points.table import PointTable
from survey.io.tables import read_table, write_table
from survey.io.text_tables.delimited import LARGEST_BYTES, TextTable, read_text_table
from survey.io.text_tables.hemispheres import refuse_hemispheres
from survey.io.text_tables.spellings import (
    ColumnNames,
    axis_of,
    datum_of_column,
    metres_factor,
    one_column,
    refuse_feet,
    renamed_header,
    say_columns,
    spelled,
)

_WHAT = "the point file"
_SIGMA = "sigma_z_m"
# Columns of a file .xyz, which has no header as a rule.
_UNNAMED = ("x", "y", "z")
# A coordinate of 100 km or more with at most four digits, and how many rows are looked at.
_SHORTENED = re.compile(r"(?<![\d.])\d([.,]\d{1,3})?E\+0*[5-9](?!\d)", re.IGNORECASE)
_N_LOOKED_AT = 50
# Digits with separators of thousands, in cells that commas part.
_SEPARATED = re.compile(rb"\d('|\xe2\x80\x99)\d|\"[+-]?\d{1,3},\d{3}")


def read_csv(path: Path, columns: Mapping[str, str] | None = None) -> PointTable:
    """Read a table of points: commas between numbers, or the export of another program with its usual names.

    `columns` names columns of the file by own name, such as ``{"z_m": "Ellipsoidal height"}``.
    """
    file = existing_file(path, _WHAT)
    _refuse_shortened(file)
    if path.suffix.lower() == ".xyz":
        return _read_export(file, columns or {}, _UNNAMED)
    if not columns and _is_plain(file):
        numbers = read_table(file, (), what=_WHAT)
        refuse_feet(list(numbers), f"{_WHAT} {path}")
        return PointTable(*in_own_columns(numbers, f"{_WHAT} {path}"))
    return _read_export(file, columns or {})


def _refuse_shortened(file: Path) -> None:
    """Refuse coordinates such as 5.00E+05, as a spreadsheet shows and exports them in narrow columns."""
    with file.open(encoding="utf-8", errors="replace") as stream:
        first = [line for line in islice(stream, 1, 1 + _N_LOOKED_AT) if line.strip()]
    if len(first) > 1 and all(map(_SHORTENED.search, first)):
        shown = _SHORTENED.search(first[0])
        assert shown is not None
        raise InputError(
            f"{_WHAT} {file} holds coordinates that were shortened in all rows ({shown.group()}); "
            "export it again with the columns formatted as numbers."
        )


def write_csv(path: Path, table: PointTable) -> None:
    """Write a CSV table of points."""
    write_table(path, table.columns)


def _is_plain(file: Path) -> bool:
    """Return whether a table has firnline's own columns, or commas, numbers alone and no standard deviation."""
    if file.stat().st_size <= LARGEST_BYTES and _SEPARATED.search(file.read_bytes()):
        return False
    with file.open(encoding="utf-8-sig", errors="replace") as stream:
        header, first = stream.readline(), stream.readline()
    if "\ufffd" in header:  # another encoding
        return False
    names = {name.strip() for name in header.split(",")}
    if set(PLACE) <= names or not first.strip():
        return True
    has_sigma = any(spelled(name, "sigma_z") for name in names)
    return "," in header and not has_sigma and all(map(_is_number, first.split(",")))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _read_export(file: Path, given: Mapping[str, str], unnamed: Sequence[str] = ()) -> PointTable:
    """Read the columns of numbers; those that begin with a text, such as codes, are passed over and named in the log."""
    text = read_text_table(file, _WHAT, unnamed)
    refuse_feet(text.header, text.where)
    known = dict(zip(text.header, renamed_header(text.header, given, text.where), strict=True))
    sigma = one_column("sigma_z", list(known.values()), text.where)
    asked = {*given, sigma}
    names = {
        name: own for name, own in known.items() if own in asked or text.is_number(name, 0, axis_of(own))
    }
    names = {name: _SIGMA if own == sigma else own for name, own in names.items()}
    numbers = {own: metres_factor(name) * text.numbers(name, axis_of(own)) for name, own in names.items()}
    unused = tuple(name for name in text.header if name not in names)
    say_columns(text.where, ColumnNames({own: name for name, own in names.items()}, unused))
    _refuse_places_of_text(text, known, set(numbers))
    height = place_columns(list(numbers), text.where).names[2]
    datum = datum_of_column(next(name for name, own in names.items() if own == height))
    places, crs = in_own_columns(numbers, text.where)
    if crs is not None:
        refuse_hemispheres(text, *(places[name] for name in PLACE[:2]))
    return PointTable(places, crs, datum)


def _refuse_places_of_text(text: TextTable, known: Mapping[str, str], numbers: set[str]) -> None:
    """Refuse coordinates that begin with a text by their line: a unit, or thousands with separators."""
    try:
        place_columns(list(numbers), text.where)
    except InputError:
        names = place_columns(list(known.values()), text.where).names
        for name in (name for name, own in known.items() if own in names):
            text.numbers(name, axis_of(known[name]))

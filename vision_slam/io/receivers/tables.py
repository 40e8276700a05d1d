"""Tables of fixes of other programs: usual names of columns, times as numbers or dates, a mapping by the user."""

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.core.text import printable
from survey.io.text_tables.angles import Axis
from survey.io.text_tables.clock_numbers import refuse_clock_numbers
from survey.io.text_tables.delimited import TextTable, read_text_table
from survey.io.text_tables.hemispheres import refuse_hemispheres
from survey.io.text_tables.spellings import (
    ColumnNames,
    axis_of,
    metres_factor,
    normalized,
    one_column,
    parsed_columns,
    renamed_header,
)
from survey.io.text_tables.usual_names import OWN_NAMES
from vision_slam.io.receivers.rows import ReceiverFixes, axis_sigma_m

KEYS = {key: OWN_NAMES[key] for key in ("time", "x", "y", "z", "lon", "lat", "sigma_xy")}
# Unix times beyond these count nano-, micro- and milliseconds.
_UNITS = ((1e17, 1e-9, "nanoseconds"), (1e14, 1e-6, "microseconds"), (1e11, 1e-3, "milliseconds"))
_DATED_S = 1e8
_RADII = ("acc",)  # accuracy, hAcc
_CLOCK = re.compile(r"\d{1,2}:\d{2}:")
_DAY_FIRST = re.compile(r"^(\d{2})\.(\d{2})\.(\d{4})\b")


def read_fix_table(file: Path, columns: Sequence[str] = ()) -> ReceiverFixes:
    """Read a table with columns of time, place and height by their usual names.

    Parameters
    ----------
    file : Path
        Text table with a header; commas, semicolons, tabs or blanks between the cells.
    columns : sequence of str
        ``key=column`` pairs for names that are not usual; keys are those of `KEYS`.

    Returns
    -------
    ReceiverFixes
        In degrees or in metres. Times are numbers (seconds, or Unix milli-, micro- or
        nanoseconds) or dates as ISO 8601 or ``31.12.2026 23:59:59``, of UTC unless they state an offset; a date
        and a time of day may stand in two columns. A column of accuracy
        counts as the radius of 68 %, one of a horizontal standard deviation as that of the
        distance; a note says which columns were read.

    Raises
    ------
    InputError
        A column is missing, could be several, or holds something else.
    ConfigError
        The mapping is not understood.
    """
    table = read_text_table(file, "the table of fixes")
    given = parsed_columns(columns, KEYS)
    table = table._replace(header=renamed_header(table.header, given, table.where))
    names = _names(table)
    date = _date_column(table, names["time"])
    time_s, unit = _times(table, names["time"], date)
    is_geodetic = "longitude" in names
    first, second = ("longitude", "latitude") if is_geodetic else ("easting", "northing")
    kinds = (first, second, "height")
    place = np.column_stack([_metres(table, names[kind], axis_of(kind)) for kind in kinds])
    if is_geodetic and (np.abs(place[:, :2]) > (360.0, 90.0)).any():
        raise InputError(
            f"{table.where} holds places that are no degrees in {names[first]} and {names[second]}; "
            f"name columns of metres with --columns x={names[first]},y={names[second]}."
        )
    if is_geodetic:
        refuse_hemispheres(table, place[:, 0], place[:, 1])
    names |= {} if date is None else {"date": date}
    read = ColumnNames({kind: given.get(name, name) for kind, name in names.items()}, _unused(table, names))
    return ReceiverFixes(
        time_s,
        place,
        _sigma_m(table, names, given),
        is_geodetic=is_geodetic,
        is_dated=bool(time_s[0] > _DATED_S),
        notes=(read.sentence(str(file)).rstrip(".") + unit, *_gps_time_notes(read.columns["time"])),
    )


def _gps_time_notes(name: str) -> tuple[str, ...]:
    """Return a note where the name of the column of times means GPS time, which is not UTC."""
    if not normalized(name).startswith("gps"):
        return ()
    return (
        f"the times of the column {name} are taken for UTC; GPS time is 18 s ahead of it, convert it where the column holds that",
    )


def _names(table: TextTable) -> dict[str, str]:
    """Return the columns of time, place, height and error by what they hold; metres before degrees."""
    header, where = table.header, table.where
    found: dict[str, str] = {}
    for kind in ("time", "x", "y", "easting", "northing", "longitude", "latitude", "height", "sigma_xy"):
        name = one_column(kind, header, where)
        if name is not None:
            found[kind] = name
    for old, new in (("x", "easting"), ("y", "northing")):
        if old in found:
            found[new] = found.pop(old)
    metric, degrees = {"easting", "northing"}, {"longitude", "latitude"}
    is_metric = metric <= found.keys() or (metric & found.keys() and not degrees & found.keys())
    drop = degrees if is_metric else metric
    found = {kind: name for kind, name in found.items() if kind not in drop}
    place = metric if is_metric else degrees
    missing = [kind for kind in ("time", *sorted(place), "height") if kind not in found]
    if missing:
        keys = {"longitude": "lon", "latitude": "lat", "height": "z", "easting": "x", "northing": "y"}
        key = keys.get(missing[0], missing[0])
        raise InputError(
            f"{where} has no column of {' and '.join(missing)} (found {printable(', '.join(header))[:200]}); "
            f"name it with --columns {key}=NAME."
        )
    return found


def _unused(table: TextTable, names: dict[str, str]) -> tuple[str, ...]:
    return tuple(name for name in table.header if name not in names.values())


def _metres(table: TextTable, name: str, axis: Axis | None = None) -> FloatArray:
    return metres_factor(name) * table.numbers(name, axis)


def _sigma_m(table: TextTable, names: dict[str, str], given: dict[str, str]) -> FloatArray | None:
    """Return the standard deviation in each axis; None without a column."""
    if "sigma_xy" not in names:
        return None
    name = names["sigma_xy"]
    stated = _metres(table, name)
    if not (stated > 0.0).all():
        raise InputError(
            f"{table.where} holds an error that is not above 0 in the column {name}; correct it."
        )
    is_radius = any(part in normalized(given.get(name, name)) for part in _RADII)
    return axis_sigma_m(stated) if is_radius else stated / np.sqrt(2.0)


def _date_column(table: TextTable, name: str) -> str | None:
    """Return the column of days beside a column of times of day; None where times are complete."""
    return one_column("date", table.header, table.where) if _CLOCK.match(table.texts(name)[0]) else None


def _times(table: TextTable, name: str, date: str | None) -> tuple[FloatArray, str]:
    """Return seconds (N,) of a column of numbers or dates, and what they were where not seconds."""
    if table.is_number(name, 0):
        numbers = table.numbers(name)
        refuse_clock_numbers(numbers, f"{table.where}, column {name}")
        for least, factor, word in _UNITS:
            if numbers[0] > least:
                return factor * numbers, f", times are Unix {word}"
        return numbers, ""
    days = ("",) * len(table.rows) if date is None else table.texts(date)
    return _dates(table, name, days), ", times are dates"


def _dates(table: TextTable, name: str, days: Sequence[str]) -> FloatArray:
    """Return Unix times (N,) [s] of the cells of a column, each after its day where the day is apart."""
    times = np.empty(len(table.rows))
    cells = zip(table.lines, days, table.texts(name), strict=True)
    for k, (line, day, cell) in enumerate(cells):
        text = _DAY_FIRST.sub(r"\3-\2-\1", f"{day} {cell}".strip().replace("/", "-"))
        try:
            date = datetime.fromisoformat(text)
        except ValueError as error:
            raise InputError(
                f"{table.where}, line {line}: {printable(cell)[:40]!r} in the column {name} is no number and no date such as "
                "2024-06-12T10:15:02.5Z; correct it."
            ) from error
        times[k] = (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
    return times

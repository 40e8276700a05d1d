"""Files of stakes that were surveyed repeatedly: point, time, x, y, z."""

import csv
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.core.files.reading import existing_file
from survey.data.sensors.stakes import StakeSurveys
from survey.io.text_tables.clock_numbers import refuse_clock_numbers

_COLUMNS = ("point", "time", "x", "y", "z")
_LONGEST_CELL = 40
# Stakes are not surveyed over and over within minutes, half an hour after a clock began.
_YEARS = (1900.0, 2100.0)


class NamedStakeSurveys(NamedTuple):
    """Surveys of stakes with the names of these.

    Parameters
    ----------
    names : tuple of str
        Names of the stakes, in the order of their indices.
    surveys : StakeSurveys
        Surveys, by time.
    """

    names: tuple[str, ...]
    surveys: StakeSurveys


def read_stake_surveys(path: str | Path, *, sigma_m: float = 0.03, zero: float = 0.0) -> NamedStakeSurveys:
    """Read repeated surveys of stakes from a CSV table with the columns point, time, x, y and z.

    Parameters
    ----------
    path : str or pathlib.Path
        Coordinates are easting, northing and elevation of the foot of the stake [m]; times are ISO 8601 dates, in UTC
        unless they state an offset, or seconds. A column ``sigma`` states standard deviations [m].
    sigma_m : float
        Standard deviation of each coordinate where the file states none [m].
    zero : float
        Time that is subtracted [s]; dates count from 1970.

    Returns
    -------
    NamedStakeSurveys
        Stakes in the order of their names in the file.

    Raises
    ------
    InputError
        A missing file or column, a cell that is no number or no time.
    """
    file = existing_file(path, "the table of stakes")
    with file.open(encoding="utf-8-sig", newline="") as stream:
        rows = list(csv.DictReader(stream))
    if not rows:
        raise InputError(
            f"the table of stakes {file} has no rows; give a header and one row for each survey."
        )
    missing = [name for name in _COLUMNS if name not in rows[0]]
    if missing:
        raise InputError(
            f"the table of stakes {file} lacks the column {missing[0]!r}; the header must hold {', '.join(_COLUMNS)}."
        )
    points = [str(row["point"]).strip() for row in rows]
    names = tuple(dict.fromkeys(points))
    times = _times([row["time"] for row in rows], file) - zero
    place = np.array(
        [[_number(row[axis], f"{file}, line {k}") for axis in "xyz"] for k, row in enumerate(rows, start=2)]
    )
    sigma = [
        _number(row.get("sigma") or str(sigma_m), f"{file}, line {k}") for k, row in enumerate(rows, start=2)
    ]
    stake = np.array([names.index(point) for point in points], dtype=np.float64)
    order = np.argsort(times, kind="stable")
    return NamedStakeSurveys(
        names, StakeSurveys(times[order], stake[order], place[order], np.array(sigma)[order])
    )


def _times(cells: list[str | None], file: Path) -> FloatArray:
    """Return the times (N,) [s] of a column of dates, or of one of seconds."""
    times = np.array([_seconds(cell, f"{file}, line {k}") for k, cell in enumerate(cells, start=2)])
    is_number = np.array([_is_number(cell or "") for cell in cells])
    if not is_number.any():
        return times
    if not is_number.all():
        k = int(np.flatnonzero(is_number != is_number[0])[0])
        raise InputError(
            f"{file}, line {k + 2}: the times begin as {'numbers' if is_number[0] else 'dates'} and go on otherwise; write all as dates."
        )
    refuse_clock_numbers(times, f"{file}, column time")
    if ((times > _YEARS[0]) & (times < _YEARS[1])).all():
        raise InputError(
            f"{file}, column time, counts years ({times[0]:g}); write dates such as 2026-07-01T09:30:00Z, or seconds from 0."
        )
    return times


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _seconds(cell: str | None, where: str) -> float:
    """Return a time in seconds: a number, or an ISO 8601 date."""
    text = (cell or "").strip()
    try:
        return float(text)
    except ValueError:
        pass
    try:
        date = datetime.fromisoformat(text)
    except ValueError as error:
        raise InputError(
            f"{where}: {text[:_LONGEST_CELL]!r} is no time; give seconds or a date such as 2026-07-01T09:30:00Z."
        ) from error
    return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()


def _number(cell: str | None, where: str) -> float:
    try:
        value = float((cell or "").strip())
    except ValueError as error:
        raise InputError(f"{where}: {(cell or '')[:_LONGEST_CELL]!r} is no number; correct it.") from error
    if not np.isfinite(value):
        raise InputError(f"{where}: {cell} is no finite number; correct it or leave the row out.")
    return value

"""Files of stakes that were surveyed repeatedly: point, time, x, y, z."""

import csv
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from survey.core.errors import InputError
from survey.core.files.reading import existing_file
from survey.data.sensors.stakes import StakeSurveys

_COLUMNS = ("point", "time", "x", "y", "z")
_LONGEST_CELL = 40


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
    names = tuple(dict.fromkeys(str(row["point"]) for row in rows))
    times = (
        np.array([_seconds(row["time"], f"{file}, line {k}") for k, row in enumerate(rows, start=2)]) - zero
    )
    place = np.array(
        [[_number(row[axis], f"{file}, line {k}") for axis in "xyz"] for k, row in enumerate(rows, start=2)]
    )
    sigma = [
        _number(row.get("sigma") or str(sigma_m), f"{file}, line {k}") for k, row in enumerate(rows, start=2)
    ]
    stake = np.array([names.index(str(row["point"])) for row in rows], dtype=np.float64)
    order = np.argsort(times, kind="stable")
    return NamedStakeSurveys(
        names, StakeSurveys(times[order], stake[order], place[order], np.array(sigma)[order])
    )


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

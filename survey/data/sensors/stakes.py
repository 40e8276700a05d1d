"""Stakes in the ice: their places, repeated surveys of them, and sightings from a drive.

Surveys of stakes are read from text tables of other programs with the columns point, time, x, y and z.
"""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from survey.core import DataObject, FloatArray, InputError, IntArray, checked, printable
from survey.core.lengths import log_converted
from survey.data.sensors.records import SensorRecords
from survey.io.column_names import ColumnNames, log_columns, metres_factor, one_column
from survey.io.point_table import place_columns
from survey.io.tables import is_number, read_table, write_table
from survey.io.text_tables import TextTable, read_text_table, refuse_clock_numbers


@dataclass(frozen=True, eq=False, repr=False)
class StakeSightings(SensorRecords):
    """Sightings of surveyed stakes.

    ``stake`` (N,) is the index into the recording's stakes, ``offset`` (N, 3) the stake's
    foot relative to the body [m] in the body frame, ``covariance`` (N, 3, 3) its error [m²].

    `time_s` (N,): times, strictly increasing [s]. `stake` (N,): index into the stakes of the recording.
    `offset` (N, 3): foot of the stake in the body frame [m]. `covariance` (N, 3, 3): of `offset` [m²].
    """

    COLUMNS: ClassVar = {
        "offset": ("forward_m", "left_m", "up_m"),
        "covariance": ("var_ff_m2", "cov_fl_m2", "cov_fu_m2", "var_ll_m2", "cov_lu_m2", "var_uu_m2"),
    }
    WHAT: ClassVar = "sightings of stakes"

    stake: FloatArray
    offset: FloatArray
    covariance: FloatArray

    def _check_order(self, times: FloatArray) -> None:
        """Check that times do not decrease; several stakes may be seen at once."""
        refuse_backward_times(times, self.WHAT)

    @property
    def index(self) -> IntArray:
        """Index of the stake (N,), integer."""
        return self.stake.astype(np.int64)


@dataclass(frozen=True, eq=False, repr=False)
class StakeSurveys(SensorRecords):
    """Repeated surveys of stakes that move with the ice.

    `time_s` (N,): times, not decreasing [s], on the clock of the recording. `stake` (N,): index of the stake.
    `position` (N, 3): easting, northing and elevation of its foot, where it meets the surface [m]. `sigma_m`
    (N,): standard deviation of each coordinate [m].
    """

    COLUMNS: ClassVar = {"position": ("easting_m", "northing_m", "elevation_m")}
    WHAT: ClassVar = "surveys of stakes"

    stake: FloatArray
    position: FloatArray
    sigma_m: FloatArray

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.sigma_m > 0.0).all():
            raise InputError(
                f"some {self.WHAT} have a standard deviation of 0 or less; state their standard deviations."
            )
        if (self.stake < 0).any() or (self.stake != np.floor(self.stake)).any():
            raise InputError(f"some {self.WHAT} name no stake; number the stakes 0, 1, 2 and so on.")

    def _check_order(self, times: FloatArray) -> None:
        """Check that times do not decrease; several stakes may be surveyed at once."""
        refuse_backward_times(times, self.WHAT)

    @property
    def index(self) -> IntArray:
        """Index of the stake (N,), integer."""
        return self.stake.astype(np.int64)


def refuse_backward_times(times: FloatArray, what: str) -> None:
    """Refuse times (N,) that decrease."""
    if (np.diff(times) < 0).any():
        raise InputError(f"the times of the {what} run backwards; sort them.")


@dataclass(frozen=True, eq=False, repr=False)
class Stakes(DataObject):
    """Benchmarks of surveyed position: `position` (K, 3) world [m], `sigma_m` (K,) of each coordinate.

    `position` (K, 3): easting, northing and elevation [m]. `sigma_m` (K,): standard deviation of each
    coordinate [m]. `time_s` (K,): times of the survey on the clock of the recording [s], for stakes that move
    with the ice.
    """

    position: FloatArray
    sigma_m: FloatArray
    time_s: Any = None

    def __post_init__(self) -> None:
        position = checked(self.position, (None, 3), "the positions of the stakes")
        object.__setattr__(self, "position", position)
        object.__setattr__(
            self, "sigma_m", checked(self.sigma_m, (len(position),), "the errors of the stakes")
        )
        if self.time_s is not None:
            times = checked(self.time_s, (len(position),), "the times of the stakes")
            object.__setattr__(self, "time_s", times)

    def __len__(self) -> int:
        return len(self.position)

    def write(self, path: str | Path) -> None:
        """Write a CSV table."""
        east, north, up = self.position.T
        columns = {"easting_m": east, "northing_m": north, "elevation_m": up, "sigma_m": self.sigma_m}
        write_table(path, columns if self.time_s is None else columns | {"time_s": self.time_s})

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read the CSV table of `write`."""
        names = ("easting_m", "northing_m", "elevation_m", "sigma_m")
        table = read_table(path, names, what="the table of stakes")
        place = np.column_stack([table[name] for name in names[:3]])
        return cls(place, table["sigma_m"], table.get("time_s"))


_LONGEST_CELL = 40
# Stakes are not surveyed over and over within minutes, half an hour after a clock began.
_YEARS = (1900.0, 2100.0)


class NamedStakeSurveys(NamedTuple):
    """Surveys of stakes with the names of these.

    `names`: names of the stakes, in the order of their indices. `surveys`: surveys, by time.
    """

    names: tuple[str, ...]
    surveys: StakeSurveys


def read_stake_surveys(path: str | Path, *, sigma_m: float = 0.03, zero: float = 0.0) -> NamedStakeSurveys:
    r"""Read repeated surveys of stakes from a table with the columns point, time, x, y and z.

    `path`: text with commas, semicolons or tabs. Coordinates are easting, northing and elevation of the foot
    of the stake [m]; times are ISO 8601 dates, in UTC unless they state an offset, or seconds. A column
    ``sigma`` states standard deviations [m]. Usual names of columns are understood, and the log states which
    were read. `sigma_m`: standard deviation of each coordinate where the file states none [m]. `zero`: time
    that is subtracted [s]; dates count from 1970.

    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "stakes.csv"
    >>> _ = file.write_text("point,time,x,y,z\nA,2026-07-01,0,0,10\nA,2026-08-01,0,3,9\n")
    >>> stakes = read_stake_surveys(file)
    >>> stakes.names, len(stakes.surveys)
    (('A',), 2)
    """
    table = read_text_table(path, "the table of stakes")
    names = _names(table)
    points = table.texts(names["point"])
    stakes = tuple(dict.fromkeys(points))
    times = _times(table, names["time"]) - zero
    place = np.column_stack([_metres(table, names[axis]) for axis in "xyz"])
    sigma = _metres(table, names["sigma"]) if "sigma" in names else np.full(len(points), sigma_m)
    stake = np.array([stakes.index(point) for point in points], dtype=np.float64)
    order = np.argsort(times, kind="stable")
    return NamedStakeSurveys(stakes, StakeSurveys(times[order], stake[order], place[order], sigma[order]))


def _names(table: TextTable) -> dict[str, str]:
    """Return the columns of point, time, place and standard deviation by what they hold."""
    header, where = table.header, table.where
    places = place_columns(header, where)
    if places.is_geographic:
        raise InputError(
            f"{where} has its places in degrees ({', '.join(places.names[:2])}); project them to the CRS of the survey."
        )
    found = {
        "point": one_column("name", header, where),
        "time": one_column("time", header, where) or one_column("date", header, where),
    }
    missing = next((kind for kind, name in found.items() if name is None), None)
    if missing is not None:
        raise InputError(
            f"{where} has no column of {missing}s (found {printable(', '.join(header))[:200]}); name it {missing}."
        )
    found |= dict(zip("xyz", places.names, strict=True))
    found["sigma"] = "sigma" if "sigma" in header else one_column("sigma_z", header, where)
    names = {kind: name for kind, name in found.items() if name is not None}
    log_columns(where, ColumnNames(names, tuple(name for name in header if name not in names.values())))
    return names


def _metres(table: TextTable, name: str) -> FloatArray:
    """Return a column of finite numbers [m]."""
    metres = metres_factor(name)
    log_converted(f"{table.where}, column {name},", [("numbers", metres)])
    values = metres * table.numbers(name)
    if not np.isfinite(values).all():
        line = table.lines[int(np.flatnonzero(~np.isfinite(values))[0])]
        raise InputError(
            f"{table.where}, line {line}: the column {name} holds no finite number; correct it or leave the row out."
        )
    return values


def _times(table: TextTable, name: str) -> FloatArray:
    """Return the times (N,) [s] of a column of dates, or of one of seconds."""
    cells, where = table.texts(name), f"{table.where}, column {name},"
    times = np.array(
        [_seconds(cell, f"{table.where}, line {line}") for cell, line in zip(cells, table.lines, strict=True)]
    )
    has_number = np.array([is_number(cell) for cell in cells])
    if not has_number.any():
        return times
    if not has_number.all():
        line = table.lines[int(np.flatnonzero(has_number != has_number[0])[0])]
        raise InputError(
            f"{table.where}, line {line}: the times begin as {'numbers' if has_number[0] else 'dates'} and go on otherwise; "
            "write all as dates."
        )
    refuse_clock_numbers(times, where.rstrip(","))
    if ((times > _YEARS[0]) & (times < _YEARS[1])).all():
        raise InputError(
            f"{where} counts years ({times[0]:g}); write dates such as 2026-07-01T09:30:00Z, or seconds from 0."
        )
    return times


def _seconds(text: str, where: str) -> float:
    """Return a time in seconds: a number, or an ISO 8601 date."""
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

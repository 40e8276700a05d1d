"""Logs of a science payload: readings of one scalar quantity, by time or by place."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from survey.core import DataObject, FloatArray, InputError, Section, checked, existing_file, printable
from survey.core.time_units import refuse_other_unit
from survey.data.trajectory import Trajectory
from survey.io.tables import read_table, write_table
from survey.io.text_tables import read_text_table

_TIME, _PLACE = "time_s", ("easting_m", "northing_m")
_N_LEAST = 10
# What loggers write where a sensor gave nothing.
_MARKS = (-999.0, -6999.0, -7999.0, -9999.0, -32767.0, -32768.0, -99999.0)


class Quantity(Section):
    """A scalar quantity that a payload measures, with its unit and the properties of its sensor.

    >>> Quantity(name="air_temperature", unit="degC", noise_sd=0.1, lag_s=8.0).label
    'Air temperature [degC]'
    """

    name: str
    """Name of the quantity and of its column: lower case, digits and underscores."""
    unit: str
    """Unit as UDUNITS spells it: degC, W m-2, m s-1, m, 1."""
    standard_name: str | None = None
    """Standard name after the climate and forecast (CF) conventions, where there is one."""
    noise_sd: float
    """Standard deviation of the noise of a reading, in the unit."""
    lag_s: float = 0.0
    """Time constant with which the sensor follows its surroundings [s]; 0 for one that follows at once."""

    @property
    def label(self) -> str:
        """Name and unit, for axes."""
        return f"{self.name.replace('_', ' ').capitalize()} [{self.unit}]"


@dataclass(frozen=True, eq=False, repr=False)
class PayloadLog(DataObject):
    """Readings of one quantity on one drive.

    `quantity`: what was measured, and by which sensor. `value` (N,): readings in the unit of the quantity, in
    the order in which they were taken. `time_s` (N,): times on the clock of the drive, strictly increasing
    [s]. Give this, `xy`, or both. `xy` (N, 2): easting and northing of the readings [m], where places were
    logged.

    >>> warm = Quantity(name="air_temperature", unit="degC", noise_sd=0.1)
    >>> len(PayloadLog(warm, np.zeros(12), np.arange(12.0)))
    12
    """

    quantity: Quantity
    value: FloatArray
    time_s: FloatArray | None = None
    xy: FloatArray | None = None

    def __post_init__(self) -> None:
        name = self.quantity.name
        value = checked(self.value, (None,), f"the readings of {name}")
        if len(value) < _N_LEAST:
            raise InputError(f"{len(value)} readings of {name} were given; at least {_N_LEAST} are needed.")
        object.__setattr__(self, "value", value)
        if self.time_s is not None:
            time_s = checked(self.time_s, (len(value),), f"the times of {name}")
            if (np.diff(time_s) <= 0.0).any():
                raise InputError(f"the times of {name} do not increase; sort the readings by time.")
            refuse_other_unit(time_s, f"the times of {name}")
            object.__setattr__(self, "time_s", time_s)
        if self.xy is not None:
            object.__setattr__(self, "xy", checked(self.xy, (len(value), 2), f"the places of {name}"))
        self._check_placement()

    def _check_placement(self) -> None:
        name = self.quantity.name
        if self.time_s is None and self.xy is None:
            raise InputError(
                f"the readings of {name} have neither times nor places; add the column {_TIME}, or {' and '.join(_PLACE)}."
            )
        if self.time_s is None and self.quantity.lag_s > 0.0:
            raise InputError(
                f"the sensor of {name} lags, which needs times; add {_TIME}, or set its lag to 0."
            )

    def __len__(self) -> int:
        return len(self.value)

    def placed(self, trajectory: Trajectory | None) -> Self:
        """Return the readings with the places where the trajectory was at their times."""
        if self.xy is not None:
            return self
        if trajectory is None or self.time_s is None:
            raise InputError(
                f"the readings of {self.quantity.name} have no places; give the trajectory of the drive, or add the "
                f"columns {', '.join(_PLACE)}."
            )
        during = (self.time_s >= trajectory.time_s[0]) & (self.time_s <= trajectory.time_s[-1])
        if during.sum() < _N_LEAST:
            raise InputError(
                f"{int(during.sum())} of {len(self)} readings of {self.quantity.name} fall into the drive from "
                f"{trajectory.time_s[0]:.1f} to {trajectory.time_s[-1]:.1f} s; give times on the drive's clock."
            )
        times = self.time_s[during]
        xy = np.column_stack(
            [np.interp(times, trajectory.time_s, axis) for axis in trajectory.position[:, :2].T]
        )
        return type(self)(self.quantity, self.value[during], times, xy)

    @classmethod
    def read(cls, path: str | Path, quantity: Quantity) -> Self:
        """Read a CSV with the column of the quantity and ``time_s``, or ``easting_m`` and ``northing_m``."""
        columns = _columns(Path(path), quantity.name)
        _refuse_marks(columns[quantity.name], f"the log of {quantity.name} {path}")
        places = [columns.get(name) for name in _PLACE]
        xy: Any = None if any(place is None for place in places) else np.column_stack(places)  # type: ignore[arg-type]
        return cls(quantity, columns[quantity.name], columns.get(_TIME), xy)

    def write(self, path: str | Path) -> None:
        """Write a CSV that `read` reads."""
        columns = {} if self.time_s is None else {_TIME: self.time_s}
        if self.xy is not None:
            columns |= dict(zip(_PLACE, self.xy.T, strict=True))
        write_table(path, columns | {self.quantity.name: self.value})


def _columns(path: Path, name: str) -> dict[str, FloatArray]:
    """Read the columns of a log: firnline's own, or a table with semicolons or tabs and decimal commas."""
    what = f"the log of {name}"
    file = existing_file(path, what)
    with file.open(encoding="utf-8-sig", errors="replace") as stream:
        header = stream.readline()
    if ";" not in header and "\t" not in header:
        return read_table(file, (name,), what=what)
    table = read_text_table(file, what)
    if name not in table.header:
        raise InputError(
            f"{table.where} has no column {name} (found {printable(', '.join(table.header))[:200]}); name one of those with --name."
        )
    return {own: table.numbers(own) for own in (name, _TIME, *_PLACE) if own in table.header}


def _refuse_marks(values: FloatArray, where: str) -> None:
    """Refuse readings such as -999 that lie farther below all others than those lie apart."""
    known = values[np.isfinite(values)]
    lowest = float(known.min()) if known.size else 0.0
    others = known[known > lowest]
    if lowest in _MARKS and others.size and others.min() - lowest > np.ptp(others):
        raise InputError(
            f"{where} holds {lowest:g} in {int((known == lowest).sum())} rows, which stands for a missing reading; remove those rows."
        )

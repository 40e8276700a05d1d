"""Sensor records: tables of times and readings, and those of the aiding sensors.

`SensorRecords` is the base class: increasing times and one row per reading, checked, written and read as CSV with units.
Derived from it here are GPS fixes, barometer, wheels, inertial unit, compass and weather.
"""

import logging
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from survey.core import BoolArray, DataObject, FloatArray, InputError, checked, printable
from survey.core.time_units import LONGEST_STEP_S, refuse_other_unit
from survey.io.tables import read_table, write_table

UPPER = np.triu_indices(3)


@dataclass(frozen=True, eq=False, repr=False)
class SensorRecords(DataObject):
    """Base class of sensor records: increasing times, one row per reading, a CSV table with units.

    `time_s` (N,): times of the readings [s], increasing.
    """

    COLUMNS: ClassVar[dict[str, tuple[str, ...]]] = {}
    """Columns of the fields that take several: 3 for a vector, 6 for a symmetric matrix."""
    WHAT: ClassVar[str] = "readings"
    LEAST: ClassVar[int] = 1
    SLOWEST_S: ClassVar[float] = np.inf
    """Longest median step; readings beyond it are in another unit than seconds."""

    time_s: FloatArray

    def __post_init__(self) -> None:
        times = checked(self.time_s, (None,), f"the times of the {self.WHAT}")
        if len(times) < self.LEAST:
            raise InputError(f"there are {len(times)} {self.WHAT}; at least {self.LEAST} are needed.")
        self._check_order(times)
        refuse_other_unit(times, f"the times of the {self.WHAT}", self.SLOWEST_S)
        object.__setattr__(self, "time_s", times)
        for field in fields(self)[1:]:
            if getattr(self, field.name) is None:
                continue
            shape = (len(times), *self._shape(field.name))
            values = checked(getattr(self, field.name), shape, f"the {field.name} of the {self.WHAT}")
            object.__setattr__(self, field.name, values)

    def _check_order(self, times: FloatArray) -> None:
        if (np.diff(times) <= 0).any():
            raise InputError(f"the times of the {self.WHAT} do not increase; sort them or remove repeats.")

    @classmethod
    def _shape(cls, name: str) -> tuple[int, ...]:
        return {0: (), 3: (3,), 6: (3, 3)}[len(cls.COLUMNS.get(name, ()))]

    def __len__(self) -> int:
        return len(self.time_s)

    def select(self, which: BoolArray) -> Self:
        """Return some of the readings.

        Parameters
        ----------
        which : (N,) ndarray of bool
            Whether each reading is selected.

        Returns
        -------
        SensorRecords
            The selected readings, of the same class.
        """
        values: dict[str, Any] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            values[field.name] = None if value is None else value[which]
        return type(self)(**values)

    def write(self, path: str | Path) -> None:
        """Write a CSV table whose header names the units.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.
        """
        columns: dict[str, FloatArray] = {}
        for field in fields(self):
            if getattr(self, field.name) is None:
                continue
            values = np.asarray(getattr(self, field.name), dtype=np.float64)
            names = self.COLUMNS.get(field.name, (field.name,))
            flat = values[:, UPPER[0], UPPER[1]] if values.ndim == 3 else values.reshape(len(values), -1)
            columns |= dict(zip(names, flat.T, strict=True))
        write_table(path, columns)

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read the CSV table of `write`.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.

        Returns
        -------
        SensorRecords
            The records, of the class of the call.

        Raises
        ------
        InputError
            Missing, cut off, a column lacks, or something is no number.
        """
        needed = [field.name for field in fields(cls) if field.default is MISSING]
        names = {name: cls.COLUMNS.get(name, (name,)) for name in needed}
        table = read_table(path, [column for group in names.values() for column in group], what="the table")
        names |= {field.name: (field.name,) for field in fields(cls) if field.name in table}
        unused = sorted(set(table) - {column for group in names.values() for column in group})
        if unused:
            logging.getLogger(__name__).warning("%s: not used: %s", path, printable(", ".join(unused)))
        return cls(
            **{field: join_columns([table[column] for column in group]) for field, group in names.items()}
        )


def join_columns(columns: list[FloatArray]) -> FloatArray:
    """Put the columns of one field back together: a scalar, a vector or a symmetric matrix a row."""
    if len(columns) == 1:
        return columns[0]
    rows = np.column_stack(columns)
    if len(columns) == 3:
        return rows
    matrices = np.empty((len(rows), 3, 3))
    matrices[:, UPPER[0], UPPER[1]] = matrices[:, UPPER[1], UPPER[0]] = rows
    return matrices


@dataclass(frozen=True, eq=False, repr=False)
class GpsFixes(SensorRecords):
    """Positions from a satellite receiver: ``time_s`` (N,), ``position`` (N, 3) east, north, up [m].

    Times without a fix are simply not there.

    Parameters
    ----------
    time_s : (N,) array_like
        Times, strictly increasing [s].
    position : (N, 3) array_like
        Easting, northing and elevation of the antenna [m].
    sigma_m : (N,) array_like, optional
        Horizontal standard deviation of each fix as the receiver states it, in each axis [m]. Where
        it is missing, all fixes have the errors that the configuration of localization assumes.
    sigma_z_m : (N,) array_like, optional
        Standard deviation of the height of each fix as the receiver states it [m]. Where it is missing, heights
        have the horizontal error times the factor that the configuration of localization assumes.
    """

    COLUMNS: ClassVar = {"position": ("easting_m", "northing_m", "height_m")}
    WHAT: ClassVar = "GPS fixes"
    LEAST: ClassVar = 2

    position: FloatArray
    sigma_m: FloatArray | None = None
    sigma_z_m: FloatArray | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Barometer(SensorRecords):
    """Pressure altitude: ``time_s`` (N,), ``height_m`` (N,) above an unknown datum.

    Parameters
    ----------
    time_s : (N,) array_like
        Times, strictly increasing [s].
    height_m : (N,) array_like
        Pressure altitude above an unknown datum [m].
    """

    WHAT: ClassVar = "barometer readings"

    height_m: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Wheels(SensorRecords):
    """Encoders: ``time_s`` (N,), distance rolled by the left and the right track since the start [m].

    Slip is in it: a track that spins on the spot goes on counting.

    Parameters
    ----------
    time_s : (N,) array_like
        Times, strictly increasing [s].
    left_m : (N,) array_like
        Distance rolled by the left track since the start [m].
    right_m : (N,) array_like
        Distance rolled by the right track since the start [m].
    """

    WHAT: ClassVar = "encoder readings"
    SLOWEST_S: ClassVar = LONGEST_STEP_S

    left_m: FloatArray
    right_m: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Inertial(SensorRecords):
    """Gyro and accelerometer in the body frame.

    ``gyro_rad_s`` (N, 3) are the rates about x, y and z; ``specific_force_m_s2`` (N, 3)
    is what an accelerometer reads: +g along z when standing level.

    Parameters
    ----------
    time_s : (N,) array_like
        Times, strictly increasing [s].
    gyro_rad_s : (N, 3) array_like
        Angular rates in the body frame [rad/s].
    specific_force_m_s2 : (N, 3) array_like
        Specific force in the body frame [m/s²].
    """

    COLUMNS: ClassVar = {
        "gyro_rad_s": ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s"),
        "specific_force_m_s2": ("force_x_m_s2", "force_y_m_s2", "force_z_m_s2"),
    }
    WHAT: ClassVar = "inertial readings"
    SLOWEST_S: ClassVar = 1.0

    gyro_rad_s: FloatArray
    specific_force_m_s2: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Compass(SensorRecords):
    """Magnetic heading: ``heading_rad`` (N,), counter-clockwise from grid east, with its distortion.

    Parameters
    ----------
    time_s : (N,) array_like
        Times, strictly increasing [s].
    heading_rad : (N,) array_like
        Magnetic heading [rad], counter-clockwise from grid east.
    """

    WHAT: ClassVar = "compass readings"

    heading_rad: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Weather(SensorRecords):
    """Science payload: ``temperature_c`` (N,) and relative ``humidity_percent`` (N,).

    `time_s` (N,): times, strictly increasing [s]. `temperature_c` (N,): air temperature [°C].
    `humidity_percent` (N,): relative humidity [%].
    """

    WHAT: ClassVar = "weather readings"

    temperature_c: FloatArray
    humidity_percent: FloatArray

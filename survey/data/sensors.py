"""Sensor records: tables of times and readings, one class per sensor.

Body frame: x forward, y left, z up, origin on the ground between the tracks. World frame:
easting, northing, elevation. Attitudes are roll, pitch (nose down positive) and yaw
(counter-clockwise from east); R = Rz(yaw) Ry(pitch) Rx(roll) takes the body to the world.
"""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Self, get_args, get_type_hints

import numpy as np

from survey.core.arrays import FloatArray, IntArray, checked, frozen
from survey.core.data_object import DataObject
from survey.core.errors import InputError
from survey.io.tables import read_table, write_table

_UPPER = np.triu_indices(3)


@dataclass(frozen=True, eq=False, repr=False)
class SensorRecords(DataObject):
    """Base class of sensor records: increasing times, one row per reading, a CSV table with units.

    Parameters
    ----------
    time_s : (N,) array_like
        Times of the readings [s], increasing.

    Raises
    ------
    InputError
        Wrong shapes, NaN, too few readings, or times that do not increase.
    """

    COLUMNS: ClassVar[dict[str, tuple[str, ...]]] = {}
    """Columns of the fields that take several: 3 for a vector, 6 for a symmetric matrix."""
    WHAT: ClassVar[str] = "readings"
    LEAST: ClassVar[int] = 1

    time_s: FloatArray

    def __post_init__(self) -> None:
        times = checked(self.time_s, (None,), f"the times of the {self.WHAT}")
        if len(times) < self.LEAST:
            raise InputError(f"there are {len(times)} {self.WHAT}; at least {self.LEAST} are needed.")
        self._check_order(times)
        object.__setattr__(self, "time_s", times)
        for field in fields(self)[1:]:
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

    def write(self, path: str | Path) -> None:
        """Write a CSV table whose header names the units.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.
        """
        columns: dict[str, FloatArray] = {}
        for field in fields(self):
            values = np.asarray(getattr(self, field.name), dtype=np.float64)
            names = self.COLUMNS.get(field.name, (field.name,))
            flat = values[:, _UPPER[0], _UPPER[1]] if values.ndim == 3 else values.reshape(len(values), -1)
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
        names = {field.name: cls.COLUMNS.get(field.name, (field.name,)) for field in fields(cls)}
        table = read_table(path, [column for group in names.values() for column in group], what="the table")
        return cls(**{field: _joined([table[column] for column in group]) for field, group in names.items()})


def _joined(columns: list[FloatArray]) -> FloatArray:
    """Put the columns of one field back together: a scalar, a vector or a symmetric matrix a row."""
    if len(columns) == 1:
        return columns[0]
    rows = np.column_stack(columns)
    if len(columns) == 3:
        return rows
    matrices = np.empty((len(rows), 3, 3))
    matrices[:, _UPPER[0], _UPPER[1]] = matrices[:, _UPPER[1], _UPPER[0]] = rows
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
    """

    COLUMNS: ClassVar = {"position": ("easting_m", "northing_m", "height_m")}
    WHAT: ClassVar = "GPS fixes"
    LEAST: ClassVar = 2

    position: FloatArray


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

    Parameters
    ----------
    time_s : (N,) array_like
        Times, strictly increasing [s].
    temperature_c : (N,) array_like
        Air temperature [°C].
    humidity_percent : (N,) array_like
        Relative humidity [%].
    """

    WHAT: ClassVar = "weather readings"

    temperature_c: FloatArray
    humidity_percent: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class StakeSightings(SensorRecords):
    """Sightings of surveyed stakes.

    ``stake`` (N,) is the index into the recording's stakes, ``offset`` (N, 3) the stake's
    foot relative to the body [m] in the body frame, ``covariance`` (N, 3, 3) its error [m²].

    Parameters
    ----------
    time_s : (N,) array_like
        Times, strictly increasing [s].
    stake : (N,) array_like
        Index into the stakes of the recording.
    offset : (N, 3) array_like
        Foot of the stake in the body frame [m].
    covariance : (N, 3, 3) array_like
        Of `offset` [m²].
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
        if (np.diff(times) < 0).any():
            raise InputError(f"the times of the {self.WHAT} run backwards; sort them.")

    @property
    def index(self) -> IntArray:
        """Index of the stake (N,), integer."""
        return self.stake.astype(np.int64)


@dataclass(frozen=True, eq=False, repr=False)
class LoopClosures(SensorRecords):
    """Loop closures: relative positions of two poses of the drive.

    Parameters
    ----------
    time_s, earlier_s : (N,) array_like
        Times of the later and of the earlier pose [s].
    offset : (N, 3) array_like
        Position of the body at `time_s` relative to that at `earlier_s` [m], in the body frame
        at `earlier_s`.
    covariance : (N, 3, 3) array_like
        Of `offset` [m²].
    """

    COLUMNS: ClassVar = StakeSightings.COLUMNS
    WHAT: ClassVar = "loop closures"

    earlier_s: FloatArray
    offset: FloatArray
    covariance: FloatArray

    def _check_order(self, times: FloatArray) -> None:
        """Check that times do not decrease; several places may be recognized at once."""
        if (np.diff(times) < 0).any():
            raise InputError(f"the times of the {self.WHAT} run backwards; sort them.")


@dataclass(frozen=True, eq=False, repr=False)
class Stakes(DataObject):
    """Benchmarks of surveyed position: `position` (K, 3) world [m], `sigma_m` (K,) of each coordinate.

    Parameters
    ----------
    position : (K, 3) array_like
        Easting, northing and elevation [m].
    sigma_m : (K,) array_like
        Standard deviation of each coordinate [m].
    """

    position: FloatArray
    sigma_m: FloatArray

    def __post_init__(self) -> None:
        position = checked(self.position, (None, 3), "the positions of the stakes")
        object.__setattr__(self, "position", position)
        object.__setattr__(
            self, "sigma_m", checked(self.sigma_m, (len(position),), "the errors of the stakes")
        )

    def __len__(self) -> int:
        return len(self.position)

    def write(self, path: str | Path) -> None:
        """Write a CSV table.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.
        """
        east, north, up = self.position.T
        write_table(
            path, {"easting_m": east, "northing_m": north, "elevation_m": up, "sigma_m": self.sigma_m}
        )

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read the CSV table of `write`.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.

        Returns
        -------
        Stakes
            The records.

        Raises
        ------
        InputError
            Missing, cut off, a missing column, or a value that is no number.
        """
        names = ("easting_m", "northing_m", "elevation_m", "sigma_m")
        table = read_table(path, names, what="the table of stakes")
        return cls(np.column_stack([table[name] for name in names[:3]]), table["sigma_m"])


@dataclass(frozen=True, eq=False, repr=False)
class Odometry(DataObject):
    """Incremental motion from vision and wheels.

    Parameters
    ----------
    time_s : (N,) array_like
        Times of the poses [s].
    step : (N - 1, 3) array_like
        Motion from each pose to the next [m], in the body frame of the earlier one.
    attitude_rad : (N, 3) array_like
        Roll, pitch and yaw of the body in the world.
    step_sigma_m, turn_sigma_rad : (N - 1,) array_like, optional
        Error of each step, and of the turn that goes with it, beyond what such odometry
        usually has: where nothing saw the motion. Zero unless given.
    """

    time_s: FloatArray
    step: FloatArray
    attitude_rad: FloatArray
    step_sigma_m: FloatArray | None = None
    turn_sigma_rad: FloatArray | None = None

    def __post_init__(self) -> None:
        times = checked(self.time_s, (None,), "the times of the odometry")
        if len(times) < 2:
            raise InputError(f"there are {len(times)} odometry poses; at least 2 are needed.")
        if (np.diff(times) <= 0).any():
            raise InputError("the times of the odometry do not increase; sort them or remove repeats.")
        object.__setattr__(self, "time_s", times)
        object.__setattr__(self, "step", checked(self.step, (len(times) - 1, 3), "the steps of the odometry"))
        object.__setattr__(self, "attitude_rad", checked(self.attitude_rad, (len(times), 3), "the attitudes"))
        for name in _TORN:
            errors = getattr(self, name)
            if errors is not None:
                object.__setattr__(
                    self, name, checked(errors, (len(times) - 1,), f"the {name} of the odometry")
                )

    def write(self, path: str | Path) -> None:
        """Write a CSV table with one row per pose; the step of the first row is zero.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.
        """
        steps = np.vstack([np.zeros((1, 3)), self.step])
        body = np.hstack([self.time_s[:, None], steps, self.attitude_rad])
        columns = dict(zip(_ODOMETRY, body.T, strict=True))
        torn = {name: getattr(self, name) for name in _TORN}
        columns |= {name: np.r_[0.0, errors] for name, errors in torn.items() if errors is not None}
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
        Odometry
            The records.

        Raises
        ------
        InputError
            Missing, cut off, a missing column, or a value that is no number.
        """
        table = read_table(path, _ODOMETRY, what="the odometry table")
        body = np.column_stack([table[name] for name in _ODOMETRY[1:]])
        torn = {name: table[name][1:] for name in _TORN if name in table}
        return cls(table["time_s"], body[1:, :3], body[:, 3:], **torn)


@dataclass(frozen=True, eq=False, repr=False)
class Sightings(DataObject):
    """Landmarks as triangulated from the rover.

    Parameters
    ----------
    pose : (M,) array_like of int
        Index of the odometry pose from which the landmark is given.
    offset : (M, 3) array_like
        Landmark relative to the body [m], body frame.
    covariance : (M, 3, 3) array_like
        Of `offset` [m²].
    range_m : (M,) array_like
        Distance at first sight [m].
    """

    pose: IntArray
    offset: FloatArray
    covariance: FloatArray
    range_m: FloatArray

    def __post_init__(self) -> None:
        pose: Any = frozen(self.pose, np.int64)
        m = len(pose)
        object.__setattr__(self, "pose", pose)
        object.__setattr__(self, "offset", checked(self.offset, (m, 3), "the landmark offsets"))
        object.__setattr__(
            self, "covariance", checked(self.covariance, (m, 3, 3), "the landmark covariances")
        )
        object.__setattr__(self, "range_m", checked(self.range_m, (m,), "the landmark ranges"))

    def write(self, path: str | Path) -> None:
        """Write a CSV table with the upper triangle of the covariances.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.
        """
        covariance = self.covariance[:, _UPPER[0], _UPPER[1]]
        body = np.column_stack([self.pose.astype(np.float64), self.offset, self.range_m, covariance])
        write_table(path, dict(zip(_SIGHTINGS, body.T, strict=True)))

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read the CSV table of `write`.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.

        Returns
        -------
        Sightings
            The records.

        Raises
        ------
        InputError
            Missing, cut off, a missing column, or a value that is no number.
        """
        table = read_table(path, _SIGHTINGS, what="the table of sightings")
        body = np.column_stack([table[name] for name in _SIGHTINGS])
        return cls(body[:, 0].astype(np.int64), body[:, 1:4], _joined(list(body[:, 5:].T)), body[:, 4])


_ODOMETRY = ("time_s", "forward_m", "left_m", "up_m", "roll_rad", "pitch_rad", "yaw_rad")
_TORN = ("step_sigma_m", "turn_sigma_rad")
_SIGHTINGS = (
    *("pose", "forward_m", "left_m", "up_m", "range_m"),
    *("var_ff_m2", "cov_fl_m2", "cov_fu_m2", "var_ll_m2", "cov_lu_m2", "var_uu_m2"),
)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SensorTables(DataObject):
    """Optional tables of a recording; None where a sensor gave no readings.

    A field declared here is a table of every recording: it is written to and read from a CSV
    file (`table_file`), and the simulator collects its readings.
    """

    odometry: Odometry | None = None
    barometer: Barometer | None = None
    sightings: Sightings | None = None
    wheels: Wheels | None = None
    inertial: Inertial | None = None
    compass: Compass | None = None
    weather: Weather | None = None
    base: GpsFixes | None = None
    base_barometer: Barometer | None = None
    stakes: Stakes | None = None
    stake_sightings: StakeSightings | None = None
    loop_closures: LoopClosures | None = None


def table_types() -> dict[str, Any]:
    """Return the record type of every table of a recording, by the table's name.

    Examples
    --------
    >>> table_types()["base"].__name__
    'GpsFixes'
    """
    hints = get_type_hints(SensorTables)
    optional = {field.name: get_args(hints[field.name])[0] for field in fields(SensorTables)}
    return {"gps": GpsFixes} | optional


def table_file(name: str) -> str:
    """Return the file name of a table in a recording's folder.

    Examples
    --------
    >>> table_file("gps"), table_file("loop_closures")
    ('gps.csv', 'closures.csv')
    """
    return _FILE_NAMES.get(name, f"{name}.csv")


_FILE_NAMES = {"loop_closures": "closures.csv"}

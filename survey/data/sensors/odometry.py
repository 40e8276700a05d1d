"""Odometry and constraints between poses: increments, sightings of terrain points, loop closures, ties between drives.

`Odometry` holds increments of the path with their covariances. `Sightings` are points of the terrain seen from poses.
`LoopClosures` and `DriveTies` are relative positions of places that one drive, or two, have seen twice.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from survey.core import BoolArray, DataObject, FloatArray, InputError, IntArray, checked, frozen
from survey.core.time_units import LONGEST_STEP_S, refuse_other_unit
from survey.data.sensors.records import UPPER, SensorRecords, join_columns
from survey.data.sensors.stakes import StakeSightings, refuse_backward_times
from survey.io.tables import read_table, write_table


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
        refuse_other_unit(times, "the times of the odometry", LONGEST_STEP_S)
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


_ODOMETRY = ("time_s", "forward_m", "left_m", "up_m", "roll_rad", "pitch_rad", "yaw_rad")
_TORN = ("step_sigma_m", "turn_sigma_rad")


@dataclass(frozen=True, eq=False, repr=False)
class Sightings(DataObject):
    """Landmarks as triangulated from the rover.

    `pose` (M,) int: index of the odometry pose from which the landmark is given. `offset` (M, 3): landmark
    relative to the body [m], body frame. `covariance` (M, 3, 3): of `offset` [m²]. `range_m` (M,): distance
    at first sight [m].
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

    def select(self, which: BoolArray) -> Self:
        """Return some of the landmarks.

        `which` (M,) bool: whether each landmark is selected.
        """
        return type(self)(self.pose[which], self.offset[which], self.covariance[which], self.range_m[which])

    def write(self, path: str | Path) -> None:
        """Write a CSV table with the upper triangle of the covariances."""
        covariance = self.covariance[:, UPPER[0], UPPER[1]]
        body = np.column_stack([self.pose.astype(np.float64), self.offset, self.range_m, covariance])
        write_table(path, dict(zip(_SIGHTINGS, body.T, strict=True)))

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read the CSV table of `write`."""
        table = read_table(path, _SIGHTINGS, what="the table of sightings")
        body = np.column_stack([table[name] for name in _SIGHTINGS])
        return cls(body[:, 0].astype(np.int64), body[:, 1:4], join_columns(list(body[:, 5:].T)), body[:, 4])


_SIGHTINGS = (
    *("pose", "forward_m", "left_m", "up_m", "range_m"),
    *("var_ff_m2", "cov_fl_m2", "cov_fu_m2", "var_ll_m2", "cov_lu_m2", "var_uu_m2"),
)


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
class DriveTies(SensorRecords):
    """Relative positions of two poses of different drives.

    `time_s` (N,): times of the poses of the first drive, on its clock [s]. `first`, `second` (N,): numbers of
    the drives, counted from 0; the second number is the larger one. `second_s` (N,): times of the poses of
    the second drive, on its clock [s]. `offset` (N, 3): position of the second body relative to the first:
    east, north, up [m]. `covariance` (N, 3, 3): of `offset` [m²].
    """

    COLUMNS: ClassVar = {
        "offset": ("east_m", "north_m", "up_m"),
        "covariance": ("var_ee_m2", "cov_en_m2", "cov_eu_m2", "var_nn_m2", "cov_nu_m2", "var_uu_m2"),
    }
    WHAT: ClassVar = "ties between drives"

    first: FloatArray
    second: FloatArray
    second_s: FloatArray
    offset: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        super().__post_init__()
        if not ((self.first >= 0) & (self.first < self.second)).all():
            raise InputError(
                f"some {self.WHAT} do not name two drives in their order; count drives from 0, the smaller number first."
            )

    def _check_order(self, times: FloatArray) -> None:
        """Check that times do not decrease; several places may be shared at once."""
        refuse_backward_times(times, self.WHAT)

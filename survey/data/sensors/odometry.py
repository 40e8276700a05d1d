"""Increments of the path with their covariances."""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from survey.core.arrays import FloatArray, checked
from survey.core.data_object import DataObject
from survey.core.errors import InputError
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

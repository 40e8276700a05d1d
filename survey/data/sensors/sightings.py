"""Sightings of points of the terrain from poses."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from survey.core.arrays import BoolArray, FloatArray, IntArray, checked, frozen
from survey.core.data_object import DataObject
from survey.data.sensors.records import UPPER, joined_columns
from survey.io.tables import read_table, write_table


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

    def select(self, which: BoolArray) -> Self:
        """Return some of the landmarks.

        Parameters
        ----------
        which : (M,) ndarray of bool
            Whether each landmark is selected.

        Returns
        -------
        Sightings
            The selected landmarks.
        """
        return type(self)(self.pose[which], self.offset[which], self.covariance[which], self.range_m[which])

    def write(self, path: str | Path) -> None:
        """Write a CSV table with the upper triangle of the covariances.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.
        """
        covariance = self.covariance[:, UPPER[0], UPPER[1]]
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
        return cls(body[:, 0].astype(np.int64), body[:, 1:4], joined_columns(list(body[:, 5:].T)), body[:, 4])


_SIGHTINGS = (
    *("pose", "forward_m", "left_m", "up_m", "range_m"),
    *("var_ff_m2", "cov_fl_m2", "cov_fu_m2", "var_ll_m2", "cov_lu_m2", "var_uu_m2"),
)

"""Where a rover was, when, and how surely."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pyproj import CRS

from survey.arrays import FloatArray, checked
from survey.errors import InputError
from survey.geodesy import projected_crs


@dataclass(frozen=True)
class Trajectory:
    """Poses of a rover in the survey's CRS.

    Parameters
    ----------
    time_s : (N,) array_like
        Seconds since the start, strictly increasing.
    position : (N, 3) array_like
        Easting, northing, elevation [m] of the body's origin.
    quaternion : (N, 4) array_like
        Rotation from the body (x forward, y left, z up) to the world (east, north, up),
        as x, y, z, w.
    covariance : (N, 3, 3) array_like
        Of the position [m²].
    crs : str or pyproj.CRS
        Projected, in metres.
    health : (N,) array_like, optional
        1 where the pose can be trusted, 0 where it is lost; 1 by default.

    Raises
    ------
    InputError
        Wrong shapes, NaN, times that do not increase, quaternions that are not of unit length.
    """

    time_s: FloatArray
    position: FloatArray
    quaternion: FloatArray
    covariance: FloatArray
    crs: CRS
    health: Any = None

    def __post_init__(self) -> None:
        time_s = checked(self.time_s, (None,), "the times of the trajectory")
        n = len(time_s)
        if n == 0:
            raise InputError("the trajectory has no poses.")
        if (np.diff(time_s) <= 0).any():
            first = int(np.flatnonzero(np.diff(time_s) <= 0)[0])
            raise InputError(
                f"the times of the trajectory do not increase after pose {first} ({time_s[first]:.3f} s); sort them or remove repeats."
            )
        quaternion = checked(self.quaternion, (n, 4), "the orientations of the trajectory")
        if (np.abs(np.linalg.norm(quaternion, axis=1) - 1.0) > 1e-3).any():
            raise InputError(
                "some orientations of the trajectory are no unit quaternions (x, y, z, w); check the columns."
            )
        object.__setattr__(self, "time_s", time_s)
        object.__setattr__(
            self, "position", checked(self.position, (n, 3), "the positions of the trajectory")
        )
        object.__setattr__(self, "quaternion", quaternion)
        object.__setattr__(
            self, "covariance", checked(self.covariance, (n, 3, 3), "the covariances of the trajectory")
        )
        object.__setattr__(self, "crs", projected_crs(self.crs, "the trajectory"))
        health = np.ones(n) if self.health is None else self.health
        object.__setattr__(self, "health", checked(health, (n,), "the health of the trajectory"))

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def length_m(self) -> float:
        """Distance travelled [m]."""
        return float(np.linalg.norm(np.diff(self.position, axis=0), axis=1).sum())

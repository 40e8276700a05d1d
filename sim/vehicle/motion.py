"""Motion of the rover: states at equal time steps, interpolated for the sensors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from sim.vehicle.physics import RoverState
from survey.core.arrays import FloatArray


@dataclass(frozen=True)
class RoverMotion:
    """States of the rover at equal time steps, interpolated in between.

    Parameters
    ----------
    time_s : (N,) ndarray
        Times [s].
    position : (N, 3) ndarray
        Position of the body's origin in the world [m].
    quaternion : (N, 4) ndarray
        Rotation from the body to the world (x, y, z, w).
    velocity, rate : (N, 3) ndarray
        Velocity and rate of turn in the world [m/s, rad/s].
    rolled_m : (N, 2) ndarray
        Distance rolled by the left and the right track [m].
    """

    time_s: FloatArray
    position: FloatArray
    quaternion: FloatArray
    velocity: FloatArray
    rate: FloatArray
    rolled_m: FloatArray

    @classmethod
    def of(cls, states: Sequence[RoverState]) -> "RoverMotion":
        """Return the motion through states in the order of time."""
        return cls(*(np.array([state[k] for state in states]) for k in range(6)))

    def displaced(self, displacement: Callable[[FloatArray, FloatArray], FloatArray]) -> "RoverMotion":
        """Return the motion with displacements (N, 3) of its places (N, 2) at its times (N,) added [m]."""
        moved = displacement(self.position[:, :2], self.time_s)
        return replace(self, position=self.position + moved)

    @property
    def rotation(self) -> Rotation:
        """Rotation from the body to the world at every time."""
        return Rotation.from_quat(self.quaternion)

    def position_at(self, time_s: FloatArray) -> FloatArray:
        """Return the origin (M, 3) at times within the stretch."""
        return _between(self.time_s, self.position, time_s)

    def rotation_at(self, time_s: FloatArray) -> Rotation:
        """Return the attitude at times within the stretch."""
        return self._turning(np.clip(time_s, self.time_s[0], self.time_s[-1]))

    @cached_property
    def _turning(self) -> Slerp:
        """Interpolator of the attitude."""
        return Slerp(self.time_s, self.rotation)

    def rolled_at(self, time_s: FloatArray) -> FloatArray:
        """Return the distances (M, 2) rolled by both tracks at times within the stretch [m]."""
        return _between(self.time_s, self.rolled_m, time_s)

    def velocity_at(self, time_s: FloatArray) -> FloatArray:
        """Return the origin's velocity (M, 3) in the world at times within the stretch [m/s]."""
        return _between(self.time_s, self.velocity, time_s)

    def pose_at(self, time_s: float) -> FloatArray:
        """Return T_world_body (4, 4) at a time."""
        pose = np.eye(4)
        pose[:3, :3] = self.rotation_at(np.array([time_s])).as_matrix()[0]
        pose[:3, 3] = self.position_at(np.array([time_s]))[0]
        return pose


def _between(time_s: FloatArray, values: FloatArray, at_s: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(at_s, time_s, column) for column in values.T])

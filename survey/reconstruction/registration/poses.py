r"""Poses of an estimated path between its own times, and the errors that they give to places seen from them.

Between two poses the position is linear in time, and the attitude turns at a constant rate. What this leaves out is
estimated from the path itself: with A'' the change of turn from one interval to the next, the error at a share s of an
interval is about s (1 - s) / 2 · A'', for the larger change at its two ends.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.trajectory import Trajectory


class Poses(NamedTuple):
    """Poses at times (N,): positions (N, 3) [m], rotations R_world_body (N, 3, 3), error of interpolation (N,) [rad]."""

    position: FloatArray
    rotation: FloatArray
    turn_sigma_rad: FloatArray


class PathInterpolator:
    """Interpolator of the poses of an estimated path.

    `path`: at least two poses.
    """

    def __init__(self, path: Trajectory) -> None:
        if len(path) < 2:
            raise InputError("the trajectory has a single pose; scans need two or more around them.")
        self._path = path
        self._turning = Slerp(path.time_s, Rotation.from_quat(path.quaternion))
        self._bend_rad = _bends(path.quaternion)

    def covers(self, time_s: FloatArray) -> bool:
        """Return whether the path covers all of the times (N,) [s]."""
        first, last = self._path.time_s[[0, -1]]
        return bool(time_s.min() >= first and time_s.max() <= last)

    def at(self, time_s: FloatArray) -> Poses:
        """Return the poses at times (N,) [s] that the path covers."""
        path = self._path
        position = np.column_stack([np.interp(time_s, path.time_s, axis) for axis in path.position.T])
        before = np.clip(np.searchsorted(path.time_s, time_s, side="right") - 1, 0, len(path) - 2)
        share = (time_s - path.time_s[before]) / np.diff(path.time_s)[before]
        sigma: FloatArray = 0.5 * share * (1.0 - share) * self._bend_rad[before]
        return Poses(position, self._turning(time_s).as_matrix(), sigma)


def _bends(quaternion: FloatArray) -> FloatArray:
    """Return, for each interval (N - 1,), the larger change of turn at its two ends [rad]."""
    turns = Rotation.from_quat(quaternion)
    steps = (turns[:-1].inv() * turns[1:]).as_rotvec()
    changes = np.r_[0.0, np.linalg.norm(np.diff(steps, axis=0), axis=1), 0.0]
    larger: FloatArray = np.maximum(changes[:-1], changes[1:])
    return larger


def covariance_by_pose(arm: FloatArray, rotation: FloatArray, pose_covariance: FloatArray) -> FloatArray:
    r"""Return the covariance that places have by the errors of the poses they were seen from.

    .. math::  J P J^T, \qquad J = [I, \hat z \times o, \hat l \times o, \hat x \times o]

    with the arm o from the body to the place, the level direction to the left l and the body's forward axis x.

    `arm` (N, 3): from the body's origin to the places, in the world [m]. `rotation` (N, 3, 3): R_world_body.
    `pose_covariance` (N, 6, 6): of easting, northing, elevation [m], yaw, pitch and roll [rad]. Returns (N,
    3, 3): [m²].
    """
    ahead = rotation[:, :, 0]
    level = np.hypot(ahead[:, 0], ahead[:, 1])
    left = np.column_stack([-ahead[:, 1] / level, ahead[:, 0] / level, np.zeros(len(arm))])
    up = np.broadcast_to([0.0, 0.0, 1.0], arm.shape)
    turned = [np.cross(axis, arm) for axis in (up, left, ahead)]
    identity = np.broadcast_to(np.eye(3), (len(arm), 3, 3))
    jacobian = np.concatenate([identity, np.stack(turned, axis=2)], axis=2)
    covariance: FloatArray = jacobian @ pose_covariance @ jacobian.transpose(0, 2, 1)
    return 0.5 * (covariance + covariance.transpose(0, 2, 1))


def own_covariance(ray: FloatArray, range_sigma_m: float, angle_sigma_rad: FloatArray) -> FloatArray:
    """Return the covariance of returns along and across their rays (N, 3) [m], as (N, 3, 3) [m²]."""
    distance = np.linalg.norm(ray, axis=1)
    unit = ray / distance[:, None]
    along = unit[:, :, None] * unit[:, None, :]
    across = (distance * angle_sigma_rad)[:, None, None] ** 2 * (np.eye(3) - along)
    covariance: FloatArray = range_sigma_m**2 * along + across
    return covariance

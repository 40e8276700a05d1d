"""Roll, pitch and yaw of a body (x forward, y left, z up) in the world (east, north, up).

Positive roll lifts the left side, positive pitch lowers the nose, yaw counts
counter-clockwise from east: right-handed turns about x, y and z, applied as Rz Ry Rx.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray


def rotations(attitude_rad: FloatArray) -> FloatArray:
    """Return R_world_body (N, 3, 3) of roll, pitch, yaw (N, 3) [rad]."""
    matrices: FloatArray = Rotation.from_euler("xyz", attitude_rad).as_matrix()
    return matrices


def quaternions(attitude_rad: FloatArray) -> FloatArray:
    """Return unit quaternions x, y, z, w (N, 4) of roll, pitch, yaw (N, 3) [rad]."""
    values: FloatArray = Rotation.from_euler("xyz", attitude_rad).as_quat(canonical=True)
    return values


def turned(vectors: FloatArray, yaw_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how world vectors (N, 3) answer to a small yaw error and to a small pitch error.

    Both are (N, 3) per radian: the yaw turns about the vertical, the pitch about the
    body's left axis laid level.
    """
    left = np.column_stack([-np.sin(yaw_rad), np.cos(yaw_rad), np.zeros_like(yaw_rad)])
    up = np.zeros_like(vectors)
    up[:, 2] = 1.0
    return np.cross(up, vectors), np.cross(left, vectors)

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


def quaternion_products(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the products (N, 4) of unit quaternions x, y, z, w (N, 4): the second turn, then the first."""
    x, y, z, w = first.T
    a, b, c, d = second.T
    return np.stack(
        [
            w * a + x * d + y * c - z * b,
            w * b - x * c + y * d + z * a,
            w * c + x * b - y * a + z * d,
            w * d - x * a - y * b - z * c,
        ],
        axis=1,
    )


def chained(quaternions_xyzw: FloatArray) -> FloatArray:
    """Return the product (4,) of unit quaternions (N, 4) in their order, normalized."""
    while len(quaternions_xyzw) > 1:
        if len(quaternions_xyzw) % 2:
            quaternions_xyzw = np.vstack([quaternions_xyzw, [0.0, 0.0, 0.0, 1.0]])
        quaternions_xyzw = quaternion_products(quaternions_xyzw[::2], quaternions_xyzw[1::2])
    product: FloatArray = quaternions_xyzw[0] / np.linalg.norm(quaternions_xyzw[0])
    return product

"""Poses on a plane for tests of visual odometry."""

import numpy as np
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray


def pose_at(x_m: float, yaw_deg: float = 0.0) -> FloatArray:
    """Return the pose (4, 4) of a body at x [m] on a plane, turned about the vertical."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", yaw_deg, degrees=True).as_matrix()
    pose[0, 3] = x_m
    return pose

"""Constraints of poses: their derivatives are those of the places at the ends of arms."""

import numpy as np

from vision_slam.attitude import rotations
from vision_slam.fusion.pose_constraints import pose_jacobian


def test_the_derivatives_are_the_numerical_ones() -> None:
    rng = np.random.default_rng(1)
    body, attitude = rng.normal(0.0, 5.0, (4, 3)), rng.uniform(-0.4, 0.4, (4, 3))

    def arm(angles: np.ndarray) -> np.ndarray:
        return np.einsum("mij,mj->mi", rotations(angles), body)

    found = pose_jacobian(arm(attitude), attitude)
    np.testing.assert_array_equal(found[:, :, :3], np.broadcast_to(np.eye(3), (4, 3, 3)))
    for column, angle in ((3, 2), (4, 1), (5, 0)):  # yaw, pitch, roll
        step = 1e-6 * np.eye(3)[angle]
        numerical = (arm(attitude + step) - arm(attitude - step)) / 2e-6
        np.testing.assert_allclose(found[:, :, column], numerical, atol=1e-7)

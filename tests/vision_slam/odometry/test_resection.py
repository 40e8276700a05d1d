"""Resection: the pose that rays to known points were seen from, and its information."""

import cv2
import numpy as np
import pytest

from survey.core.arrays import FloatArray
from vision_slam.odometry.resection import resect, resection_information

SIGMA = 1e-3
POINTS = np.random.default_rng(1).uniform([-4.0, -4.0, 3.0], [4.0, 4.0, 12.0], (60, 3))
HOMOGENEOUS = np.column_stack([POINTS, np.ones(60)])


def pose_of(turn: tuple[float, float, float], place: tuple[float, float, float]) -> FloatArray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(np.array(turn))[0], place
    return pose


def rays_from(pose: FloatArray) -> FloatArray:
    seen = (POINTS - pose[:3, 3]) @ pose[:3, :3]
    rays: FloatArray = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    return rays


def found(rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    return resect(np.eye(4), HOMOGENEOUS, rays, angle_sigma=SIGMA, turn_sigma=np.inf, shift_sigma=np.inf)


def test_exact_rays_give_the_pose_and_no_error() -> None:
    true = pose_of((0.03, -0.02, 0.05), (0.2, -0.1, 0.15))
    pose, error = found(rays_from(true))
    np.testing.assert_allclose(pose, true, atol=1e-6)
    assert error.max() < 1e-6


def test_a_fifth_of_wrong_rays_leaves_the_pose() -> None:
    true = pose_of((0.01, 0.0, 0.02), (0.1, 0.0, 0.0))
    rays = rays_from(true)
    rays[::5] = rays[::5][::-1]
    pose, error = found(rays)
    np.testing.assert_allclose(pose, true, atol=1e-3)
    assert (error[::5] > 10.0 * SIGMA).sum() >= 10


def test_the_scale_of_homogeneous_points_changes_nothing_and_directions_give_the_turn_alone() -> None:
    true = pose_of((0.03, -0.02, 0.05), (0.2, -0.1, 0.15))
    given = {"angle_sigma": SIGMA, "turn_sigma": np.inf, "shift_sigma": np.inf}
    scaled = np.linspace(0.01, 3.0, 60)[:, None] * HOMOGENEOUS
    np.testing.assert_allclose(resect(np.eye(4), scaled, rays_from(true), **given)[0], true, atol=1e-6)
    directions = np.column_stack([POINTS, np.zeros(60)])
    turned = (POINTS @ true[:3, :3]) / np.linalg.norm(POINTS, axis=1, keepdims=True)
    pose, _ = resect(np.eye(4), directions, turned, **given | {"shift_sigma": 0.1})
    np.testing.assert_allclose(pose, pose_of((0.03, -0.02, 0.05), (0.0, 0.0, 0.0)), atol=1e-6)


def test_errors_of_the_pose_are_as_large_as_the_information_says() -> None:
    true, rng = pose_of((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), np.random.default_rng(2)
    information = resection_information(true, HOMOGENEOUS, SIGMA)
    squares = []
    for _ in range(60):
        rays = rays_from(true) + 0.5 * SIGMA * rng.standard_normal((60, 3))
        pose, _ = found(rays / np.linalg.norm(rays, axis=1, keepdims=True))
        step = np.concatenate([cv2.Rodrigues(pose[:3, :3])[0].ravel(), pose[:3, 3]])
        squares.append(4.0 * step @ information @ step)
    # The mean of 60 chi-squared values of 6 degrees of freedom errs by 0.45; weights below 1 add a little.
    assert np.mean(squares) == pytest.approx(6.0, abs=1.5)

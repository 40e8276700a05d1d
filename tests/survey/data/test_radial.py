"""Inverse of pinhole distortion."""

import cv2
import numpy as np
import pytest

from survey.core.arrays import FloatArray
from survey.data.camera import Camera, fold_radius, undistort

MATRIX = np.array([[718.0, 0.0, 607.0], [0.0, 718.0, 185.0], [0.0, 0.0, 1.0]])


def _camera(coefficients: list[float]) -> Camera:
    return Camera("pinhole", 1241, 376, MATRIX, np.array(coefficients), np.eye(4))


def _pixels(camera: Camera) -> FloatArray:
    u, v = np.meshgrid(np.linspace(0.0, camera.width - 1.0, 60), np.linspace(0.0, camera.height - 1.0, 20))
    return np.column_stack([u.ravel(), v.ravel()])


@pytest.mark.parametrize("k1", [-0.3, -0.2, -0.1, -0.02, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("others", [(0.0, 0.0, 0.0, 0.0), (0.05, 1e-3, -2e-3, -0.01)])
def test_rays_agree_with_many_iterations_of_opencv(k1: float, others: tuple[float, ...]) -> None:
    camera = _camera([k1, *others])
    pixels = _pixels(camera)
    rays = camera.rays(pixels)
    shown = np.isfinite(rays).all(axis=1)
    plane = rays[shown, :2] / rays[shown, 2:]
    # Fixed-point iteration converges slowly where the lens nearly folds; both agree within 1e-9 before.
    steady = np.linalg.norm(plane, axis=1) < 0.9 * fold_radius(camera.distortion)
    ends = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 3000, 1e-14)
    expected = cv2.undistortPoints(
        np.ascontiguousarray(pixels[shown][:, None]), MATRIX, camera.distortion, criteria=ends
    )
    assert np.abs(np.asarray(expected)[steady, 0] - plane[steady]).max() < 1e-9
    assert np.abs(camera.project(rays[shown]) - pixels[shown]).max() < 1e-8


def test_pixels_beyond_the_fold_have_no_ray() -> None:
    camera = _camera([-0.3, 0.0, 0.0, 0.0, 0.0])
    pixels = _pixels(camera)
    shown = np.isfinite(camera.rays(pixels)).all(axis=1)
    # r - 0.3 r³ is at most 0.7027 where r is 1.0541.
    radius = np.linalg.norm((pixels - MATRIX[:2, 2]) / 718.0, axis=1)
    assert (shown == (radius < 0.70273)).all()
    assert 0 < shown.sum() < len(shown)


def test_a_lens_without_distortion_changes_nothing() -> None:
    plane = np.array([[0.3, -0.2], [2.0, 1.0]])
    assert undistort(plane, np.zeros(5)).tolist() == plane.tolist()
    assert fold_radius(np.zeros(5)) == np.inf


@pytest.mark.parametrize("coefficients", [(0.0, 0.0, 0.0, 0.0, 0.0), (-0.2, 0.05, 1e-3, -2e-3, -0.01)])
def test_points_are_projected_as_by_opencv(coefficients: tuple[float, ...]) -> None:
    points = np.random.default_rng(1).normal(0.0, 1.0, (500, 3)) + [0.0, 0.0, 4.0]
    nowhere = np.zeros(3)
    pinhole = _camera(list(coefficients))
    expected, _ = cv2.projectPoints(points, nowhere, nowhere, MATRIX, pinhole.distortion)
    assert np.abs(pinhole.project(points) - np.asarray(expected)[:, 0]).max() < 1e-9
    fisheye = Camera("fisheye", 1241, 376, MATRIX, np.array(coefficients[:4]), np.eye(4))
    expected, _ = cv2.fisheye.projectPoints(points[:, None], nowhere, nowhere, MATRIX, fisheye.distortion)
    assert np.abs(fisheye.project(points) - np.asarray(expected)[:, 0]).max() < 1e-9
    assert fisheye.project(np.array([[0.0, 0.0, 2.0]])).tolist() == [MATRIX[:2, 2].tolist()]

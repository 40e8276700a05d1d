"""The error of followed corners is that of the images."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from survey.data.camera import Camera
from tests.vision_slam.odometry.poses import pose_at
from vision_slam.config import VisualOdometryConfig
from vision_slam.motion import RelativeMotion
from vision_slam.odometry.resection import PixelNoise
from vision_slam.odometry.visual_slam import VisualSlam


def test_the_assumed_error_is_the_least() -> None:
    noise = PixelNoise(0.5)
    for _ in range(100):
        noise.update(np.full(20, 0.1))
    assert noise.sigma_px == 0.5


def test_the_measured_error_is_that_of_gaussian_residuals() -> None:
    noise, rng = PixelNoise(0.5), np.random.default_rng(1)
    for _ in range(500):
        noise.update(np.hypot(*rng.normal(0.0, 1.2, (2, 200))))
    assert noise.sigma_px == pytest.approx(1.2, rel=0.02)


def _sigma_px(world: object, camera: Camera, trembling_px: float) -> float:
    """Error of the corners of a drive whose images tremble, patch by patch."""
    rng, slam = np.random.default_rng(3), VisualSlam(camera)
    columns, rows = np.meshgrid(np.arange(320, dtype=np.float32), np.arange(240, dtype=np.float32))
    for k in range(16):
        image = world.image(pose_at(0.2 * k))  # type: ignore[attr-defined]
        shift = trembling_px * rng.normal(size=(2, 12, 16)).astype(np.float32)
        x, y = (cv2.resize(part, (320, 240), interpolation=cv2.INTER_NEAREST) for part in shift)
        moved = np.asarray(cv2.remap(image, columns + x, rows + y, cv2.INTER_LINEAR), np.uint8)
        slam.step(moved, 0.25 * k, RelativeMotion(0.25, np.eye(3), 0.2) if k else None)
    return slam.window.pixel_sigma


def test_trembling_images_have_a_larger_error_than_steady_ones(plane_world: object, camera: Camera) -> None:
    steady_px, trembling_px = (_sigma_px(plane_world, camera, trembling) for trembling in (0.0, 0.8))
    assert steady_px < 1.1 * VisualOdometryConfig().pixel_sigma
    assert trembling_px > 1.1 * steady_px


def test_residuals_of_a_lens_that_nothing_states_are_not_those_of_pixels(
    plane_world: object, camera: Camera
) -> None:
    unstated = replace(camera, distortion_is_assumed=True)
    assert _sigma_px(plane_world, unstated, 1.0) == VisualOdometryConfig().pixel_sigma

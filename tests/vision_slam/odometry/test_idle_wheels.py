"""Wheels that count nothing while the images move."""

import numpy as np
import pytest

from survey.data.camera import Camera
from survey.data.frames import Frames
from survey.data.sensors.records import Wheels
from tests.vision_slam.odometry.poses import pose_at
from vision_slam.config import VisualOdometryConfig
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.visual_odometry import visual_odometry
from vision_slam.readers.sequence import ImageSequence


def _driven(world: object, camera: Camera, step_m: float) -> VisualOdometry:
    images = [world.image(pose_at(step_m * k)) for k in range(8)]  # type: ignore[attr-defined]
    times, none = 0.25 * np.arange(8.0), np.zeros(8)
    drive = ImageSequence(camera, Frames(times, images), Wheels(times, none, none))
    return visual_odometry(drive, VisualOdometryConfig(lens="given"))


def test_idle_wheels_do_not_stop_images_that_move(plane_world: object, camera: Camera) -> None:
    found = _driven(plane_world, camera, 0.2)
    assert np.linalg.norm(found.odometry.step, axis=1).min() > 0.0
    assert found.ignores_wheels
    assert found.notes[-1].startswith("the wheels count no travel while the images move")


def test_idle_wheels_are_used_while_the_camera_stands(plane_world: object, camera: Camera) -> None:
    found = _driven(plane_world, camera, 0.0)
    assert found.odometry.step == pytest.approx(0.0)
    assert not found.ignores_wheels

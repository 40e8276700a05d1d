"""Mountings and wheels against the direction in which images of a drive travel."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from survey.core.errors import InputError
from survey.data.camera import Camera
from survey.data.frames import Frames
from survey.data.sensors.records import Wheels
from tests.vision_slam.odometry.poses import pose_at
from vision_slam.config import VisualOdometryConfig
from vision_slam.odometry.sensor_checks import refuse_other_travel
from vision_slam.odometry.visual_odometry import visual_odometry
from vision_slam.readers.sequence import ImageSequence

_N, _STEP_M = 10, 0.15
_SETTINGS = VisualOdometryConfig()


@pytest.fixture(scope="module")
def frames(plane_world: object) -> Frames:
    images = tuple(plane_world.image(pose_at(_STEP_M * k)) for k in range(_N))  # type: ignore[attr-defined]
    return Frames(0.25 * np.arange(float(_N)), images)


def _wheels(factor: float = 1.0, right: float = 1.0) -> Wheels:
    rolled = factor * _STEP_M * np.arange(float(_N))
    return Wheels(0.25 * np.arange(float(_N)), rolled, right * rolled)


def _turned(camera: Camera, axis: str, angle_deg: float) -> Camera:
    mount = camera.T_body_camera.copy()
    mount[:3, :3] = Rotation.from_euler(axis, angle_deg, degrees=True).as_matrix() @ mount[:3, :3]
    return replace(camera, T_body_camera=mount)


def test_images_that_travel_ahead_are_right(frames: Frames, camera: Camera) -> None:
    refuse_other_travel(frames, camera, _wheels(), _SETTINGS)
    refuse_other_travel(frames, camera, _wheels(2.0), _SETTINGS)
    refuse_other_travel(frames, _turned(camera, "y", 10.0), _wheels(), _SETTINGS)


def test_a_drive_backward_is_right(frames: Frames, camera: Camera) -> None:
    back = Frames(frames.time_s, tuple(frames[_N - 1 - k] for k in range(_N)))
    refuse_other_travel(back, camera, _wheels(-1.0), _SETTINGS)
    with pytest.raises(InputError, match=r"ahead the images travel 1[78].° from ahead, backward"):
        refuse_other_travel(back, camera, _wheels(), _SETTINGS)


@pytest.mark.parametrize(
    ("axis", "angle_deg", "expected"),
    [("y", -90.0, "up"), ("y", 90.0, "down"), ("z", 90.0, "to the left"), ("z", -90.0, "to the right")],
)
def test_a_wrong_mounting_is_refused(
    frames: Frames, camera: Camera, axis: str, angle_deg: float, expected: str
) -> None:
    with pytest.raises(InputError, match=rf"the images travel [89].° from ahead, {expected}, in .* pairs"):
        refuse_other_travel(frames, _turned(camera, axis, angle_deg), _wheels(), _SETTINGS)


def test_reversed_wheels_are_refused_before_work_starts(frames: Frames, camera: Camera) -> None:
    with pytest.raises(
        InputError, match=r"backward, in .*; change the sign of left_m and right_m, or correct"
    ):
        visual_odometry(ImageSequence(camera, frames, _wheels(-1.0)))


def test_turns_and_few_images_say_nothing(frames: Frames, camera: Camera) -> None:
    backward = _turned(camera, "z", 180.0)
    refuse_other_travel(frames, backward, _wheels(right=0.5), _SETTINGS)
    few = Frames(frames.time_s[:7], tuple(frames[k] for k in range(7)))
    refuse_other_travel(few, backward, _wheels(), _SETTINGS)

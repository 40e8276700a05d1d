"""Gyros with axes reversed or exchanged, or in degrees per second, against turns by images."""

import numpy as np
import pytest

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.camera import Camera
from survey.data.frames import Frames
from survey.data.sensors.records import Inertial
from tests.vision_slam.odometry.poses import pose_at
from vision_slam.config import VisualOdometryConfig
from vision_slam.odometry.sensor_checks import ImageTurns, largest_turns, refuse_other_gyro
from vision_slam.odometry.visual_odometry import visual_odometry
from vision_slam.readers.sequence import ImageSequence

_RNG = np.random.default_rng(5)
_TURNS = np.radians(_RNG.normal(0.0, [2.0, 2.0, 6.0], (30, 3)))
_GOOD = np.eye(3)


def _by_gyro(reading: FloatArray, *, bias_deg_s: float = 0.0, noise_deg: float = 0.1) -> ImageTurns:
    seconds = np.full(len(_TURNS), 0.25)
    noise = np.radians(np.random.default_rng(6).normal(0.0, noise_deg, _TURNS.shape))
    return ImageTurns(seconds, _TURNS + noise, (_TURNS + np.radians(bias_deg_s) * 0.25) @ reading.T)


@pytest.mark.parametrize(
    ("reading", "expected"),
    [
        (np.diag([1.0, 1.0, -1.0]), "the images turn about z as the gyro does about -z;"),
        (np.diag([1.0, -1.0, -1.0]), "the images turn about y, z as the gyro does about -y, -z;"),
        (np.eye(3)[[1, 0, 2]], "the images turn about x, y as the gyro does about y, x;"),
        (np.degrees(np.eye(3)), r"by 0.0175 of what the gyro does; .*multiply them by 0.0174533."),
        (np.radians(np.eye(3)), r"by 57.3 of what the gyro does; .*multiply them by 57.2958."),
    ],
)
def test_a_gyro_of_other_axes_or_units_is_refused(reading: FloatArray, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        refuse_other_gyro(_by_gyro(reading))


def test_bias_scale_and_misalignment_are_no_contradiction() -> None:
    refuse_other_gyro(_by_gyro(_GOOD, bias_deg_s=3.0))
    refuse_other_gyro(_by_gyro(1.3 * _GOOD))
    refuse_other_gyro(_by_gyro(_GOOD + 0.2 * np.eye(3)[[1, 2, 0]]))


def test_turns_that_no_reading_of_the_gyro_explains_refuse_nothing() -> None:
    turns = _by_gyro(-_GOOD)
    refuse_other_gyro(turns._replace(by_images=_RNG.permutation(turns.by_images)))


def test_drives_that_hardly_turn_refuse_nothing() -> None:
    turns = _by_gyro(-_GOOD)
    refuse_other_gyro(ImageTurns(*(part[:7] for part in turns)))
    refuse_other_gyro(turns._replace(by_images=0.02 * turns.by_images, by_gyro=0.02 * turns.by_gyro))
    refuse_other_gyro(ImageTurns(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))))


def _winding_drive(plane_world: object, camera: Camera, sign: float) -> ImageSequence:
    times, readings = 0.25 * np.arange(24.0), np.arange(0.0, 6.01, 0.05)
    images = tuple(plane_world.image(pose_at(0.6 * time, 20.0 * np.sin(time))) for time in times)  # type: ignore[attr-defined]
    rates = np.zeros((len(readings), 3))
    rates[:, 2] = sign * np.radians(20.0) * np.cos(readings - 0.025)
    force = np.tile([0.0, 0.0, 9.81], (len(readings), 1))
    return ImageSequence(camera, Frames(times, images), inertial=Inertial(readings, rates, force))


def test_images_of_a_winding_drive_find_its_gyro_reversed(plane_world: object, camera: Camera) -> None:
    with pytest.raises(InputError, match="the images turn about z as the gyro does about -z"):
        visual_odometry(_winding_drive(plane_world, camera, -1.0))


def test_images_of_a_winding_drive_show_the_turns_of_its_gyro(plane_world: object, camera: Camera) -> None:
    drive = _winding_drive(plane_world, camera, 1.0)
    assert drive.inertial is not None
    turns = largest_turns(drive.frames, camera, drive.inertial, VisualOdometryConfig())
    assert np.degrees(np.abs(turns.by_images[:, 2]).max()) > 4.0
    # The epipolar geometry of a plane has two solutions: a few pairs take the other one.
    assert np.degrees(np.median(np.abs(turns.by_images - turns.by_gyro).max(axis=1))) < 0.3
    refuse_other_gyro(turns)


def test_images_that_repeat_or_show_nothing_show_no_turns(plane_world: object, camera: Camera) -> None:
    drive = _winding_drive(plane_world, camera, 1.0)
    assert drive.inertial is not None
    blank = tuple(np.full((camera.height, camera.width), 200 + k % 2, np.uint8) for k in range(24))
    for images in ((drive.frames[0],) * 24, blank):
        frames = Frames(drive.frames.time_s, images)
        assert len(largest_turns(frames, camera, drive.inertial, VisualOdometryConfig()).seconds) == 0

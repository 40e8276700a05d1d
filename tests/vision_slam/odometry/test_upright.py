"""Cameras that are mounted upside down."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.data.camera import Camera
from survey.data.sensors.odometry import Odometry, Sightings
from tests.vision_slam.conftest import mounted
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.sensor_checks import mounting_note

_RNG = np.random.default_rng(2)
_GROUND = np.column_stack(
    [_RNG.uniform(1.0, 6.0, 400), _RNG.uniform(-3.0, 3.0, 400), _RNG.normal(-0.7, 0.05, 400)]
)


def _rolled(points: FloatArray, mount: FloatArray, angle_deg: float) -> FloatArray:
    """Return points as they come out where the camera is rolled about its axis against its stated mounting."""
    turn = Rotation.from_rotvec(np.radians(angle_deg) * mount[:3, 2])
    return turn.apply(points)


@pytest.mark.parametrize("pitch_deg", [0.0, 15.0, 25.0])
def test_ground_above_the_camera_is_noted(pitch_deg: float) -> None:
    mount = mounted(pitch_deg)
    assert mounting_note(_GROUND, mount) is None
    note = mounting_note(_rolled(_GROUND, mount, 180.0), mount)
    assert note is not None
    assert "mounted upside down" in note


def test_cameras_that_look_aside_up_or_straight_down_are_not_noted() -> None:
    for axis, angle_deg in (("z", 90.0), ("z", 180.0), ("y", 30.0), ("y", 65.0)):
        turn = Rotation.from_euler(axis, angle_deg, degrees=True)
        mount = mounted()
        mount[:3, :3] = turn.as_matrix() @ mount[:3, :3]
        assert mounting_note(turn.apply(_GROUND) if axis == "z" else _GROUND, mount) is None
    ceiling = _GROUND * [1.0, 1.0, -1.0]
    assert mounting_note(ceiling, mounted(-30.0)) is None


def test_walls_and_few_landmarks_are_not_noted() -> None:
    wall = np.column_stack([_RNG.uniform(3.0, 9.0, 300), np.full(300, 2.0), _RNG.uniform(-0.7, 6.0, 300)])
    for walls in (wall, np.vstack([wall, wall * [1.0, -1.0, 1.0]]), wall[:, [1, 0, 2]]):
        assert mounting_note(walls, mounted(0.0)) is None
    mount = mounted()
    assert mounting_note(_rolled(_GROUND, mount, 180.0)[:100], mount) is None


@pytest.mark.parametrize("has_wheels", [True, False])
def test_landmarks_count_from_the_camera_and_not_from_the_body(camera: Camera, *, has_wheels: bool) -> None:
    place_m = camera.T_body_camera[:3, 3]
    offset = _rolled(_GROUND, camera.T_body_camera, 180.0) + (place_m if has_wheels else 0.0)
    n = len(offset)
    sightings = Sightings(np.zeros(n, int), offset, np.tile(0.01 * np.eye(3), (n, 1, 1)), np.full(n, 5.0))
    odometry = Odometry(np.arange(2.0), np.ones((1, 3)), np.zeros((2, 3)))
    lever_arm_m = None if has_wheels else place_m
    visual = VisualOdometry(odometry, sightings, (), np.zeros(2, dtype=np.bool_), lever_arm_m=lever_arm_m)
    assert visual.mounting_note(camera) is not None

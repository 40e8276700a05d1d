"""Figures of an estimated drive."""

import numpy as np
import pytest

from survey.data.sensors.odometry import Odometry, Sightings
from vision_slam.attitude import rotations
from vision_slam.drive_estimate import DriveEstimate, compare_from_start
from vision_slam.odometry.health import FrameHealth
from vision_slam.odometry.odometer import VisualOdometry


def test_stretches_that_are_lost_have_no_length() -> None:
    odometry = Odometry(np.arange(5.0), np.tile([2.0, 0.0, 0.0], (4, 1)), np.zeros((5, 3)))
    sightings = Sightings(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))
    lost = np.array([False, False, True, True, False])
    visual = VisualOdometry(odometry, sightings, (FrameHealth(5.0, 0.0, 2.0),) * 5, lost)
    place = np.column_stack([2.0 * np.arange(5.0), np.zeros(5), np.zeros(5)])
    level = np.tile([0.0, 0.0, 0.0, 1.0], (5, 1))
    estimate = DriveEstimate(odometry.time_s, place, level, np.zeros((0, 3)), np.zeros(0), visual)
    assert estimate.length_m == pytest.approx(4.0)


def test_a_path_without_a_scale_is_compared_as_that_of_the_camera() -> None:
    """A body on a circle with the camera 1.5 m ahead; the unit happens to be a metre."""
    times = np.arange(20.0)
    attitude = np.column_stack([np.zeros(20), np.zeros(20), times / 10.0])
    body, arm = np.tile(np.eye(4), (20, 1, 1)), np.array([1.5, 0.0, 0.5])
    body[:, :3, :3] = rotations(attitude)
    body[:, :2, 3] = 10.0 * np.column_stack([np.sin(times / 10.0), 1.0 - np.cos(times / 10.0)])
    place = body[:, :3, 3] + body[:, :3, :3] @ arm
    steps = np.einsum("nji,nj->ni", body[:-1, :3, :3], np.diff(place, axis=0))
    nothing = Sightings(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))
    frames = (FrameHealth(5.0, 0.0, 2.0),) * 20
    visual = VisualOdometry(
        Odometry(times, steps, attitude), nothing, frames, np.zeros(20, dtype=bool), lever_arm_m=arm
    )
    estimate = DriveEstimate.in_first_frame(visual)
    compared = compare_from_start(estimate, times, body @ estimate.T_body_tracked)
    assert np.abs(compared.position - compared.reference).max() < 1e-9

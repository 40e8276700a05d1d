"""Figures of an estimated drive."""

import numpy as np
import pytest

from survey.data.sensors.odometry import Odometry
from survey.data.sensors.sightings import Sightings
from vision_slam.drive_estimate import DriveEstimate
from vision_slam.odometry.health import FrameHealth
from vision_slam.odometry.visual_odometry import VisualOdometry


def test_stretches_that_are_lost_have_no_length() -> None:
    odometry = Odometry(np.arange(5.0), np.tile([2.0, 0.0, 0.0], (4, 1)), np.zeros((5, 3)))
    sightings = Sightings(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))
    lost = np.array([False, False, True, True, False])
    visual = VisualOdometry(odometry, sightings, (FrameHealth(5.0, 0.0, 2.0),) * 5, lost)
    place = np.column_stack([2.0 * np.arange(5.0), np.zeros(5), np.zeros(5)])
    level = np.tile([0.0, 0.0, 0.0, 1.0], (5, 1))
    estimate = DriveEstimate(odometry.time_s, place, level, np.zeros((0, 3)), np.zeros(0), visual)
    assert estimate.length_m == pytest.approx(4.0)

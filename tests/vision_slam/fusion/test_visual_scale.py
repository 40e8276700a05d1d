"""Scale of monocular odometry from the extent of the fixes."""

from dataclasses import replace

import numpy as np
import pytest

from survey.core.errors import InputError
from survey.data.sensors.odometry import Odometry, Sightings
from survey.data.sensors.records import GpsFixes
from vision_slam.agreement.scale import (
    fit_scale,
    refuse_short_fixes,
    refuse_untracked,
    scale_by_fixes,
    scale_visual_odometry,
)
from vision_slam.attitude import rotations
from vision_slam.motion import dead_reckoning
from vision_slam.odometry.health import FrameHealth
from vision_slam.odometry.odometer import VisualOdometry

TIMES = np.arange(60.0)
PATH = np.column_stack([10.0 * np.sin(TIMES / 20.0), 10.0 - 10.0 * np.cos(TIMES / 20.0), np.zeros(60)])


def _visual(is_visual: bool = True) -> VisualOdometry:
    steps = np.tile([0.5, 0.0, 0.0], (59, 1))
    odometry = Odometry(TIMES, steps, np.zeros((60, 3)), step_sigma_m=np.full(59, 0.1))
    sightings = Sightings([3], [[1.0, 2.0, 3.0]], [0.01 * np.eye(3)], [4.0])
    frame = FrameHealth(5.0, 0.0, 10.0, 100, 90, is_visual)
    return VisualOdometry(odometry, sightings, (frame,) * 60, np.zeros(60, dtype=bool))


def test_the_factor_does_not_depend_on_heading_and_origin() -> None:
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    fixes = GpsFixes(TIMES, 3.0 * PATH @ turn.T + [5e5, 6e6, 100.0])
    assert scale_by_fixes(PATH, TIMES, fixes)[0] == pytest.approx(3.0, rel=1e-9)


def test_the_error_of_the_factor_falls_with_the_extent_of_the_fixes() -> None:
    small, large = (scale_by_fixes(PATH, TIMES, GpsFixes(TIMES, k * PATH))[1] for k in (2.0, 8.0))
    assert small == pytest.approx(4.0 * large)


def test_scaling_multiplies_all_lengths_and_squares_covariances() -> None:
    scaled = scale_visual_odometry(_visual(), 2.0)
    assert scaled.odometry.step_sigma_m is not None
    assert scaled.odometry.step[0].tolist() == [1.0, 0.0, 0.0]
    assert scaled.odometry.step_sigma_m[0] == pytest.approx(0.2)
    assert scaled.sightings.offset[0].tolist() == [2.0, 4.0, 6.0]
    assert scaled.sightings.covariance[0, 0, 0] == pytest.approx(0.04)


def test_a_lever_arm_is_applied_in_metres_after_scaling() -> None:
    """A camera 1.5 m ahead, 0.5 m to the left and 2 m above a body that turns, pitches and rolls; its unit is 0.4 m."""
    arm, unit_m = np.array([1.5, 0.5, 2.0]), 0.4
    attitude = np.column_stack([0.05 * np.sin(TIMES), 0.05 * np.cos(TIMES), TIMES / 20.0])
    turn = rotations(attitude)
    body = 3.0 * PATH
    camera = (body + turn @ arm) / unit_m
    point = np.array([20.0, 5.0, 0.0])
    steps = np.einsum("nji,nj->ni", turn[:-1], np.diff(camera, axis=0))
    offset = turn[3].T @ (point / unit_m - camera[3])
    visual = replace(
        _visual(),
        odometry=Odometry(TIMES, steps, attitude),
        sightings=Sightings([3], [offset], [0.01 * np.eye(3)], [4.0]),
        lever_arm_m=arm,
    )
    fixes = GpsFixes(TIMES, body + [5e5, 6e6, 100.0])
    factor, _ = fit_scale(visual, body[0], fixes)
    assert factor == pytest.approx(unit_m, rel=1e-6)
    scaled = scale_visual_odometry(visual, factor)
    assert scaled.lever_arm_m is None
    assert np.abs(dead_reckoning(scaled.odometry, body[0]) - body).max() < 1e-4
    assert body[3] + turn[3] @ scaled.sightings.offset[0] == pytest.approx(point, abs=1e-4)


def test_fixes_outside_the_time_of_the_images_give_no_scale() -> None:
    with pytest.raises(InputError, match=r"spread over 0\.0 m"):
        refuse_short_fixes(GpsFixes(TIMES + 1000.0, 10.0 * PATH), TIMES)


def test_images_of_which_none_was_tracked_are_refused() -> None:
    refuse_untracked(_visual())
    with pytest.raises(InputError, match="none of 60 images"):
        refuse_untracked(_visual(is_visual=False))

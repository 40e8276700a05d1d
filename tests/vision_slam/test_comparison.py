"""Comparison of estimates with references in a CRS and in a frame of their own."""

import numpy as np
import pytest

from survey.core.errors import InputError
from survey.data.trajectory import Trajectory
from vision_slam.comparison import compare_from_start, compare_in_crs
from vision_slam.drive_estimate import DriveEstimate

UTM = "EPSG:32608"


def _line(first_s: float, up_m: float = 0.0) -> Trajectory:
    times = first_s + np.arange(10.0)
    place = np.column_stack([times, np.zeros(10), np.full(10, up_m)])
    level = np.tile([0.0, 0.0, 0.0, 1.0], (10, 1))
    return Trajectory(times, place, level, np.tile(np.eye(3), (10, 1, 1)), UTM)


def test_only_common_times_are_compared() -> None:
    comparison = compare_in_crs(_line(0.0, 0.5), _line(4.0))
    assert len(comparison.position) == 6
    assert comparison.figures["vertical_rms_m"] == 0.5
    assert comparison.figures["horizontal_rms_m"] == 0.0


def test_a_reference_of_another_time_is_refused() -> None:
    with pytest.raises(InputError, match="none of the path"):
        compare_in_crs(_line(0.0), _line(100.0))


def test_references_in_a_frame_of_their_own_are_moved_to_the_first_common_pose() -> None:
    path = _line(0.0)
    estimate = DriveEstimate(
        path.time_s, path.position, path.quaternion, np.zeros((0, 3)), np.zeros(0), trajectory=path
    )
    turned = np.tile(np.eye(4), (10, 1, 1))
    turned[:, :3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    turned[:, :3, 3] = np.column_stack([np.full(10, 7.0), path.time_s, np.zeros(10)])
    comparison = compare_from_start(estimate, path.time_s, turned)
    np.testing.assert_allclose(comparison.reference, path.position, atol=1e-12)
    with pytest.raises(InputError, match="fewer than two"):
        compare_from_start(estimate, path.time_s + 0.5, turned)

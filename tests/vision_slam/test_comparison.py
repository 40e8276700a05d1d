"""Comparison of estimates with references in a CRS and in a frame of their own."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from survey.core.errors import InputError
from survey.data.trajectory import Trajectory
from vision_slam.drive_estimate import DriveEstimate, compare_from_start, compare_in_crs

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


def test_an_arc_with_a_wrong_scale_and_heading_shows_each_error_by_name() -> None:
    times = np.arange(50.0)
    heading = np.linspace(0.0, 1.5, 50)
    place = 40.0 * np.column_stack([np.sin(heading), 1.0 - np.cos(heading), np.zeros(50)])
    turns = Rotation.from_euler("z", heading[:, None])
    wrong = Rotation.from_euler("z", np.radians(2.0))
    sigma = np.tile(np.diag([0.5, 0.5, 0.5]) ** 2, (50, 1, 1))
    real = Trajectory(times, place, turns.as_quat(), np.zeros((50, 3, 3)), UTM)
    found = Trajectory(
        times, 1.1 * wrong.apply(place) + [3.0, 0.0, 0.0], (wrong * turns).as_quat(), sigma, UTM
    )
    figures = compare_in_crs(found, real).figures
    assert figures["ate_sim3_m"] == pytest.approx(0.0, abs=1e-9)
    assert figures["ate_se3_m"] > 0.5
    assert figures["scale_error_per_cent"] == pytest.approx(10.0)
    assert figures["scale_drift_per_cent"] == pytest.approx(0.0, abs=1e-6)
    assert figures["yaw_rms_deg"] == pytest.approx(2.0)
    assert figures["rpe_per_cent"] == pytest.approx(10.0, rel=0.2)
    assert figures["rpe_deg"] == pytest.approx(0.0, abs=1e-6)
    assert figures["nees_2d"] == pytest.approx(np.mean((found.position - place)[:, :2] ** 2) * 2.0 / 0.25)


def test_fixes_as_a_reference_have_no_attitude_to_compare() -> None:
    figures = compare_in_crs(_line(0.0, 0.5), _line(0.0)).figures
    assert "yaw_rms_deg" not in figures
    assert "ate_se3_m" not in figures  # a line fixes no rotation

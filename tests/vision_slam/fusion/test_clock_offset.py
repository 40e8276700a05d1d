"""Offset between the clocks of fixes and images, estimated with the path."""

from dataclasses import replace

import numpy as np
import pytest

from survey.core.arrays import FloatArray
from survey.data.recording import OdometryRecording
from survey.data.sensors.odometry import Odometry, Sightings
from survey.data.sensors.records import GpsFixes
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.online import filter_path
from vision_slam.fusion.smoother import delay_moments, smooth
from vision_slam.motion import dead_reckoning

SPEED_M_S, LATE_S = 10.0, 0.5
TWO_CLOCKS = LocalizationConfig(
    gps_bias_sigma_m=0.3, gps_white_sigma_m=0.1, gps_correlation_time_s=500.0, start="unknown", clock_sigma_s=0.5
)  # fmt: skip


def _drive(turn_deg: float) -> tuple[OdometryRecording, FloatArray]:
    """20 s at 10 m/s with a turn in the middle; the fixes of each second come half a second late."""
    times = np.arange(0.0, 20.05, 0.1)
    heading = np.radians(turn_deg) * np.clip((times - 8.0) / 4.0, 0.0, 1.0)
    attitude = np.column_stack([np.zeros_like(times), np.zeros_like(times), heading])
    odometry = Odometry(times, np.tile([0.1 * SPEED_M_S, 0.0, 0.0], (len(times) - 1, 1)), attitude)
    path = dead_reckoning(odometry, np.zeros(3))
    places = path[5::10] + 0.1 * np.random.default_rng(4).standard_normal((20, 3))
    fixes = GpsFixes(times[5::10] + LATE_S, places)
    sightings = Sightings([3], [[6.0, 0.0, 0.0]], [0.01 * np.eye(3)], [8.0])
    return OdometryRecording("EPSG:32608", path[0], fixes, odometry=odometry, sightings=sightings), path


def _squared(error: FloatArray, covariance: FloatArray) -> float:
    return float(np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0]).mean())


def test_a_turn_shows_the_delay_and_the_path_is_corrected_by_it() -> None:
    recording, path = _drive(turn_deg=90.0)
    found = smooth(recording, path, TWO_CLOCKS)
    assert found.delay_s == pytest.approx(LATE_S, abs=3.0 * found.delay_sigma_s)
    assert found.delay_sigma_s < 0.1
    assert np.linalg.norm((found.position - path)[:, :2], axis=1).max() < 1.5  # of 5 m by the delay


def test_along_a_steady_line_nothing_shows_the_delay_and_the_covariances_contain_it() -> None:
    recording, path = _drive(turn_deg=0.0)
    found = smooth(recording, path, TWO_CLOCKS)
    assert found.delay_s == 0.0
    assert found.delay_sigma_s > 0.3
    error = (found.position - path)[:, :2]
    assert np.abs(error).max() > 4.0
    assert _squared(error, found.covariance[:, :2, :2]) < 3.0
    one_clock = smooth(recording, path, TWO_CLOCKS.model_copy(update={"clock_sigma_s": 0.0}))
    assert _squared((one_clock.position - path)[:, :2], one_clock.covariance[:, :2, :2]) > 100.0


def test_the_causal_path_contains_the_delay_too() -> None:
    recording, path = _drive(turn_deg=0.0)
    found = filter_path(recording, path, TWO_CLOCKS)
    assert found.accepted.all()
    error = (found.position - path)[-1:, :2]
    assert _squared(error, found.covariance[-1:, :2, :2]) < 3.0


def test_the_joint_posterior_has_the_delay_among_its_unknowns() -> None:
    recording, path = _drive(turn_deg=0.0)
    found = smooth(recording, path, TWO_CLOCKS)
    without = smooth(recording, path, TWO_CLOCKS.model_copy(update={"clock_sigma_s": 0.0}))
    assert found.error.information.shape[0] == without.error.information.shape[0] + 1


def test_a_delay_far_beyond_its_prior_is_taken_for_an_error_of_the_odometry() -> None:
    mean_s, sigma_s = delay_moments(2.0, 0.05, 0.5)
    assert mean_s == 0.0
    assert sigma_s == pytest.approx(0.5 * np.sqrt(0.65))


def test_fixes_before_and_after_the_path_are_left_out() -> None:
    recording, path = _drive(turn_deg=0.0)
    far = replace(recording.gps, time_s=recording.gps.time_s + 15.0)
    assert np.isfinite(smooth(replace(recording, gps=far), path, TWO_CLOCKS).position).all()

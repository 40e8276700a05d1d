"""Odometry and fixes that disagree beyond their assumed errors."""

from dataclasses import replace

import numpy as np
import pytest
from pyproj import CRS

from sim.instruments.sensor import gauss_markov
from survey.core.arrays import FloatArray
from survey.data.recording import OdometryRecording
from survey.data.sensors.odometry import Odometry, Sightings
from survey.data.sensors.records import GpsFixes, Inertial
from vision_slam.agreement import evidence
from vision_slam.agreement.drive import Drive
from vision_slam.agreement.evidence import (
    agrees_better_delayed,
    fitted_memory_s,
    fitted_turn_sigma_m,
    reconcile,
    white_error_m,
)
from vision_slam.agreement.steps import widen_white_errors
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.online import filter_path, select_fixes
from vision_slam.fusion.smoother import smooth
from vision_slam.motion import dead_reckoning

RTK = LocalizationConfig(
    gps_bias_sigma_m=0.01, gps_white_sigma_m=0.02, gps_correlation_time_s=300.0, scale_sigma=0.1
)

IMAGES = RTK.model_copy(update={"start": "unknown"}).with_image_errors()


def _hook(factor: float = 1.0, jump_m: float = 0.0) -> tuple[OdometryRecording, FloatArray]:
    """40 m straight on, a turn of 90 degrees and 40 m, at 1 m/s with RTK fixes.

    After the turn the odometry counts `factor` times the travel; in the last 20 s the fixes are
    off by a jump.
    """
    travel = np.arange(0.0, 101.0)
    heading = np.clip((travel - 40.0) / 20.0, 0.0, 1.0) * 0.5 * np.pi
    attitude = np.column_stack([np.zeros_like(travel), np.zeros_like(travel), heading])
    steps = np.tile([1.0, 0.0, 0.0], (100, 1))
    path = dead_reckoning(Odometry(travel, steps, attitude), np.zeros(3))
    counted = steps * np.where(travel[:-1] >= 50.0, factor, 1.0)[:, None]
    rng = np.random.default_rng(7)
    fixes = path + 0.02 * rng.standard_normal(path.shape)
    fixes[81:] += [jump_m, 0.0, 0.0]
    sightings = Sightings([3], [[6.0, 0.0, 0.0]], [0.01 * np.eye(3)], [8.0])
    return OdometryRecording(
        CRS("EPSG:32608"), path[0], GpsFixes(travel, fixes),
        odometry=Odometry(travel, counted, attitude), sightings=sightings,
    ), path  # fmt: skip


def test_odometry_that_agrees_with_its_fixes_is_left_as_it_is() -> None:
    recording, path = _hook()
    online = filter_path(recording, path, RTK)
    agreement = reconcile(recording, path, RTK, online)
    assert agreement.config is RTK
    assert agreement.gain == 0.0
    np.testing.assert_array_equal(agreement.used, online.accepted)


def test_a_gyro_that_the_assumed_errors_do_not_use_is_no_disagreement() -> None:
    recording, path = _hook()
    time_s = np.arange(-1.0, 101.0, 0.1)
    rate = np.where((time_s >= 40.0) & (time_s < 60.0), 0.5 * np.pi / 20.0, 0.0)
    gyro = np.column_stack([np.zeros_like(rate), np.zeros_like(rate), rate])
    with_gyro = replace(
        recording, inertial=Inertial(time_s, gyro, np.tile([0.0, 0.0, 9.81], (len(time_s), 1)))
    )
    agreement = reconcile(with_gyro, path, RTK, filter_path(with_gyro, path, RTK))
    assert agreement.config is RTK
    assert agreement.gain == 0.0


def test_most_fixes_are_no_outliers() -> None:
    """Odometry 25 % too long in a turn, and a filter that took few fixes, one of them near the end by chance."""
    recording, _ = _hook(factor=1.25)
    reckoned = dead_reckoning(recording.odometry, recording.start)
    online = filter_path(recording, reckoned, RTK)
    few = np.zeros_like(online.accepted)
    few[[0, 1, 2, 97]] = True
    agreement = reconcile(recording, reckoned, RTK, replace(online, accepted=few))
    assert agreement.used.all()
    assert agreement.gain > 10.0


def test_odometry_that_is_wrong_in_a_turn_is_not_taken_for_a_delay() -> None:
    wrong, path = _hook(factor=1.25)
    reckoned = dead_reckoning(wrong.odometry, wrong.start)
    assert not agrees_better_delayed(wrong, reckoned, RTK, 2.0)
    right, _ = _hook()
    late = replace(right, gps=replace(right.gps, time_s=right.gps.time_s + 2.0))
    assert agrees_better_delayed(late, path, RTK, 2.0)


def test_scale_that_grows_in_a_turn_widens_the_errors_until_all_fixes_are_used() -> None:
    recording, path = _hook(factor=1.25)
    reckoned = dead_reckoning(recording.odometry, recording.start)
    online = filter_path(recording, reckoned, RTK)
    assert online.n_refused > 20  # the odometry is trusted too much
    agreement = reconcile(recording, reckoned, RTK, online)
    assert agreement.gain > 10.0
    assert agreement.used.all()
    assert "disagree" in agreement.note
    smoothed = smooth(select_fixes(recording, agreement.used), reckoned, agreement.config)
    error = (smoothed.position - path)[:, :2]
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.05
    spread = smoothed.covariance[:, :2, :2]
    squared = np.einsum("ni,ni->n", error, np.linalg.solve(spread, error[:, :, None])[:, :, 0])
    # Two are expected of true covariances; errors that may vary everywhere are claimed too large.
    assert 0.3 < squared.mean() < 4.0


def test_a_jump_of_the_receiver_at_the_end_of_a_drive_is_not_taken_for_an_error_of_the_odometry() -> None:
    recording, path = _hook(jump_m=15.0)
    online = filter_path(recording, path, RTK)
    assert not online.accepted[81:].any()
    agreement = reconcile(recording, path, RTK, online)
    assert agreement.config is RTK
    assert not agreement.used[81:].any()


def test_odometry_that_fails_before_the_last_fix_is_no_outlier_of_the_receiver() -> None:
    """40 m at 8 m/s; steps of the last second are twice too long, so that one fix of six is refused."""
    right, _ = _drifting(50, every=10)
    steps = right.odometry.step.copy()
    steps[40:] *= 2.0
    recording = replace(right, odometry=replace(right.odometry, step=steps))
    reckoned = dead_reckoning(recording.odometry, recording.start)
    online = filter_path(recording, reckoned, IMAGES)
    assert online.accepted.tolist() == [True] * 5 + [False]
    agreement = reconcile(recording, reckoned, IMAGES, online)
    assert agreement.used.all()
    assert agreement.gain > 10.0


def test_a_drift_of_scale_goes_on_where_fixes_end() -> None:
    """Scale grows by a third over 240 m, and the fixes end half-way."""
    recording, path = _drifting(300, every=10, factor=1.3)
    recording = replace(recording, gps=recording.gps.select(recording.gps.time_s <= 15.0))
    reckoned = dead_reckoning(recording.odometry, recording.start)
    agreement = reconcile(recording, reckoned, IMAGES, filter_path(recording, reckoned, IMAGES))
    assert agreement.config.scale_wander_m > 50.0
    smoothed = smooth(select_fixes(recording, agreement.used), reckoned, agreement.config)
    error, spread = (smoothed.position - path)[151:, :2], smoothed.covariance[151:, :2, :2]
    squared = np.einsum("ni,ni->n", error, np.linalg.solve(spread, error[:, :, None])[:, :, 0])
    assert squared.mean() < 6.0


def _drifting(n: int, every: int, factor: float = 1.0) -> tuple[OdometryRecording, FloatArray]:
    """Images at 10 Hz of a drive at 8 m/s in bends, whose scale grows by a factor, and RTK fixes."""
    times = 0.1 * np.arange(n + 1.0)
    heading = 0.5 * np.pi * np.sin(2.0 * np.pi * times / times[-1])
    attitude = np.column_stack([np.zeros((n + 1, 2)), heading])
    steps = np.tile([0.8, 0.0, 0.0], (n, 1))
    path = dead_reckoning(Odometry(times, steps, attitude), np.zeros(3))
    rng = np.random.default_rng(8)
    counted = steps * np.linspace(1.0, factor, n)[:, None] + 0.005 * rng.standard_normal(steps.shape)
    fixes = GpsFixes(times[::every], path[::every] + 0.02 * rng.standard_normal((n // every + 1, 3)))
    return OdometryRecording(
        CRS("EPSG:32608"), path[0], fixes, odometry=Odometry(times, counted, attitude),
        sightings=Sightings([3], [[6.0, 0.0, 0.0]], [0.01 * np.eye(3)], [8.0]), start_is_surveyed=False,
    ), path  # fmt: skip


@pytest.mark.parametrize("first", [0, 40])
def test_outliers_that_end_are_errors_of_the_receiver(first: int) -> None:
    recording, path = _hook(factor=1.25)
    fixes = recording.gps.position.copy()
    fixes[first + 5 : first + 10] += [0.0, 30.0, 0.0]
    outlying = replace(recording, gps=replace(recording.gps, position=fixes))
    reckoned = dead_reckoning(outlying.odometry, outlying.start)
    agreement = reconcile(outlying, reckoned, RTK, filter_path(outlying, reckoned, RTK))
    smoothed = smooth(select_fixes(outlying, agreement.used), reckoned, agreement.config)
    assert np.hypot(*(smoothed.position - path)[:, :2].T).max() < 1.0
    assert not agreement.used[first + 5 : first + 10].any()


def _slow(memory_s: float) -> tuple[OdometryRecording, FloatArray]:
    """An hour at 0.5 m/s around a square of 450 m with fixes whose errors of 0.5 m last."""
    times = np.arange(0.0, 3600.0, 5.0)
    heading = 0.5 * np.pi * np.floor(times / 900.0)
    attitude = np.column_stack([np.zeros_like(times), np.zeros_like(times), heading])
    steps = np.tile([2.5, 0.0, 0.0], (len(times) - 1, 1))
    path = dead_reckoning(Odometry(times, steps, attitude), np.zeros(3))
    rng = np.random.default_rng(3)
    bias = gauss_markov(np.diff(times), memory_s, 0.5, rng, 3)
    fixes = GpsFixes(times, path + bias + 0.1 * rng.standard_normal(path.shape))
    steps = 1.003 * steps + 0.006 * np.sqrt(2.5) * rng.standard_normal(steps.shape)
    return OdometryRecording(
        CRS("EPSG:32608"), path[0], fixes, odometry=Odometry(times, steps, attitude),
        sightings=Sightings([3], [[6.0, 0.0, 0.0]], [0.01 * np.eye(3)], [8.0]),
    ), path  # fmt: skip


@pytest.mark.parametrize(("memory_s", "expected_s"), [(120.0, {120.0}), (600.0, {480.0, 1920.0})])
def test_errors_of_fixes_that_last_longer_are_given_their_memory(
    memory_s: float, expected_s: set[float]
) -> None:
    recording, _ = _slow(memory_s)
    assumed = LocalizationConfig(gps_bias_sigma_m=0.5, gps_white_sigma_m=0.1, gps_correlation_time_s=120.0)
    reckoned = dead_reckoning(recording.odometry, recording.start)
    assert fitted_memory_s(recording, reckoned, assumed) in expected_s


def test_errors_of_fixes_that_vary_faster_than_assumed_are_no_errors_of_the_odometry() -> None:
    recording, _ = _slow(memory_s=10.0)
    assumed = LocalizationConfig(gps_bias_sigma_m=0.5, gps_white_sigma_m=0.1, gps_correlation_time_s=300.0)
    reckoned = dead_reckoning(recording.odometry, recording.start)
    agreement = reconcile(recording, reckoned, assumed, filter_path(recording, reckoned, assumed))
    assert agreement.config is assumed
    assert agreement.gain == 0.0


def test_precise_fixes_show_that_turns_are_followed_better_than_assumed() -> None:
    recording, path = _hook()
    loose = RTK.model_copy(update={"turn_sigma_m": 0.2, "start": "unknown"})
    assert fitted_turn_sigma_m(recording, path, loose) < 0.15
    coarse = loose.model_copy(update={"gps_bias_sigma_m": 1.0, "gps_white_sigma_m": 0.5})
    assert fitted_turn_sigma_m(recording, path, coarse) == 0.2


@pytest.mark.parametrize("variance_m2", [1e24, np.nan])
def test_a_path_of_no_certain_place_admits_no_refused_fix(
    monkeypatch: pytest.MonkeyPatch, variance_m2: float
) -> None:
    """The covariance of the path is singular to its last digit, as after a fix thousands of kilometres away."""
    recording, path = _hook()
    smoothed = smooth(recording, path, RTK)
    wide = np.full_like(smoothed.covariance, variance_m2)
    aside = smoothed.position + [1e9, -1e9, 0.0]
    monkeypatch.setattr(evidence, "smooth", lambda *_: replace(smoothed, position=aside, covariance=wide))
    used = np.arange(101) < 100
    np.testing.assert_array_equal(evidence._readmitted(recording, path, RTK, used), used)


def _scattered(sigma_m: float, rate_hz: float = 1.0) -> tuple[OdometryRecording, FloatArray]:
    """The hook with fixes of an independent error and one that lasts, some far off; odometry 20 % short and turned by 50°."""
    recording, path = _hook()
    rng = np.random.default_rng(3)
    time_s = np.arange(0.0, 100.0 + 1e-6, 1.0 / rate_hz)
    fixes = np.column_stack([np.interp(time_s, recording.odometry.time_s, axis) for axis in path.T])
    fixes += sigma_m * rng.standard_normal(fixes.shape)
    fixes += gauss_markov(np.diff(time_s), 120.0, 2.0, rng, 3)
    fixes[:: len(fixes) // 2] += 60.0
    turn = np.array([[0.64, -0.77, 0.0], [0.77, 0.64, 0.0], [0.0, 0.0, 1.0]])
    given = replace(recording, gps=GpsFixes(time_s, fixes), start_is_surveyed=False)
    return given, 0.8 * path @ turn.T


@pytest.mark.parametrize("rate_hz", [1.0, 5.0])
@pytest.mark.parametrize("sigma_m", [0.5, 3.0])
def test_the_scatter_of_fixes_is_measured_about_odometry_of_any_heading_and_scale(
    sigma_m: float, rate_hz: float
) -> None:
    assert white_error_m(*_scattered(sigma_m, rate_hz)) == pytest.approx(sigma_m, rel=0.25)


def test_fixes_that_scatter_are_not_blamed_on_the_odometry() -> None:
    assumed = LocalizationConfig(start="unknown")
    drive = widen_white_errors(Drive(_scattered(3.0)[0], assumed))
    assert drive.config.gps_white_sigma_m == pytest.approx(3.0, rel=0.25)
    assert "from second to second" in drive.notes[0]


def test_errors_of_fixes_that_are_stated_are_left_as_they_are() -> None:
    stated = LocalizationConfig(start="unknown", gps_white_sigma_m=0.5)
    drive = Drive(_scattered(3.0)[0], stated)
    assert widen_white_errors(drive) is drive
    few = Drive(select_fixes(drive.recording, np.arange(101) < 5), LocalizationConfig(start="unknown"))
    assert widen_white_errors(few) is few

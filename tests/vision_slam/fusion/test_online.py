"""The filter over recordings: nothing of the future in it, mishaps of the receiver survived, honest errors."""

from dataclasses import replace

import numpy as np
import pytest

from survey.core.arrays import FloatArray
from survey.data.recording import OdometryRecording, Recording
from survey.data.sensors.odometry import Odometry, Sightings
from survey.data.sensors.records import Barometer, Compass, GpsFixes, Wheels
from vision_slam.attitude import rotations
from vision_slam.config import LocalizationConfig
from vision_slam.evaluation import consistency
from vision_slam.fusion.online import filter_path, gate_fixes, predicted_covariance
from vision_slam.fusion.smoother import smooth
from vision_slam.motion import dead_reckoning
from vision_slam.pipeline import localize

CONFIG = LocalizationConfig()


def _gauss_markov(n: int, sigma: float, memory: float, rng: np.random.Generator, k: int = 3) -> FloatArray:
    values = sigma * rng.standard_normal((n, k))
    for i in range(1, n):
        values[i] = memory * values[i - 1] + np.sqrt(1.0 - memory**2) * values[i]
    return values


def _drive(seed: int = 1, n: int = 240) -> tuple[Recording, FloatArray]:
    """Go up and down swaths of 60 m at 1 m/s, with errors as the configuration has them."""
    rng = np.random.default_rng(seed)
    times = np.arange(float(n))
    heading = np.where((times // 60).astype(int) % 2 == 0, 0.0, np.pi) + 0.02 * np.sin(times / 9.0)
    attitude = np.column_stack([np.zeros(n), 0.05 * np.sin(times / 20.0), heading])
    step = np.tile([1.0, 0.0, 0.0], (n - 1, 1))
    place = np.vstack(
        [np.zeros(3), np.cumsum(np.einsum("nij,nj->ni", rotations(attitude[:-1]), step), axis=0)]
    )
    memory = float(np.exp(-1.0 / CONFIG.attitude_correlation_m))
    wrong = _gauss_markov(n, 1.0, memory, rng)
    wrong = wrong * np.radians([CONFIG.tilt_sigma_deg, CONFIG.tilt_sigma_deg, CONFIG.yaw_sigma_deg])
    measured = step * (1.0 + CONFIG.scale_sigma * rng.standard_normal())
    measured = measured + CONFIG.step_sigma_m * rng.standard_normal(measured.shape)
    level = np.array([1.0, 1.0, CONFIG.gps_vertical_factor])
    memory = float(np.exp(-1.0 / CONFIG.gps_correlation_time_s))
    error = _gauss_markov(n, CONFIG.gps_bias_sigma_m, memory, rng)
    error = (error + CONFIG.gps_white_sigma_m * rng.standard_normal((n, 3))) * level
    memory = float(np.exp(-1.0 / CONFIG.barometer_correlation_time_s))
    drift = _gauss_markov(n, CONFIG.barometer_drift_sigma_m, memory, rng, 1)[:, 0]
    height = place[:, 2] + 7.0 + drift + CONFIG.barometer_white_sigma_m * rng.standard_normal(n)
    recording = Recording(
        "EPSG:32608",
        place[0],
        GpsFixes(times, place + error),
        odometry=Odometry(times, measured, attitude + wrong),
        barometer=Barometer(times, height),
    )
    return recording, place


def _reckoned(recording: Recording) -> FloatArray:
    assert recording.odometry is not None
    return dead_reckoning(recording.odometry, recording.start)


def _cut(recording: Recording, n: int) -> Recording:
    odometry, barometer, gps = recording.odometry, recording.barometer, recording.gps
    assert odometry is not None
    assert barometer is not None
    return replace(
        recording,
        odometry=Odometry(odometry.time_s[:n], odometry.step[: n - 1], odometry.attitude_rad[:n]),
        barometer=Barometer(barometer.time_s[:n], barometer.height_m[:n]),
        gps=GpsFixes(gps.time_s[:n], gps.position[:n]),
    )


def test_knows_nothing_of_the_future() -> None:
    recording, _ = _drive()
    whole = filter_path(recording, _reckoned(recording), CONFIG)
    part = _cut(recording, 100)
    np.testing.assert_array_equal(
        filter_path(part, _reckoned(part), CONFIG).position, whole.position[:100], strict=True
    )


def test_agrees_with_the_smoother_at_the_end() -> None:
    recording, _ = _drive()
    reckoned = _reckoned(recording)
    online = filter_path(recording, reckoned, CONFIG)
    fine = CONFIG.model_copy(update={"node_spacing_m": 1.0})
    smoothed = smooth(gate_fixes(recording, online), reckoned, fine)
    # The last moment has no future: one model, two ways. The smoother's attitude errors act with the mean of
    # a step's ends, the filter's with its beginning; the filter's headings are not linearised: millimetres.
    np.testing.assert_allclose(online.position[-1], smoothed.position[-1], atol=0.02)
    np.testing.assert_allclose(online.covariance[-1], smoothed.covariance[-1, :3, :3], atol=0.01)


def test_errors_are_what_the_covariance_says() -> None:
    ends = []
    for seed in range(20):
        recording, place = _drive(100 + seed, 100)
        online = filter_path(recording, _reckoned(recording), CONFIG)
        ends.append((online.position[-1] - place[-1], online.covariance[-1]))
    # Twenty runs, a band that an honest filter leaves once in a thousand.
    judged = consistency(np.array([e for e, _ in ends]), np.array([p for _, p in ends]), 0.999)
    assert judged.is_honest


def test_fixes_that_jump_for_a_minute_are_refused_and_declared() -> None:
    recording, place = _drive()
    jumped = (recording.gps.time_s >= 100.0) & (recording.gps.time_s < 160.0)
    off = recording.gps.position + jumped[:, None] * np.array([9.0, -12.0, 0.0])
    recording = replace(recording, gps=GpsFixes(recording.gps.time_s, off))
    reckoned = _reckoned(recording)
    online = filter_path(recording, reckoned, CONFIG)
    assert not online.accepted[jumped].any()
    assert online.is_lost[105:160].all()
    assert not online.is_lost[170:].any()
    # Rejected, 15 m leave what the drive has anyway: the receiver's metre.
    assert np.hypot(*(online.position - place)[:, :2].T).max() < 3.0
    smoothed = smooth(gate_fixes(recording, online), reckoned, CONFIG)
    assert np.hypot(*(smoothed.position - place)[:, :2].T).max() < 3.0


def test_without_fixes_the_error_is_declared() -> None:
    recording, _ = _drive()
    few = GpsFixes(recording.gps.time_s[:5], recording.gps.position[:5])
    online = filter_path(replace(recording, gps=few), _reckoned(recording), CONFIG)
    sigma = np.sqrt(np.trace(online.covariance[:, :2, :2], axis1=1, axis2=2))
    assert (np.diff(sigma[10:60]) > 0.0).all()


@pytest.mark.parametrize("with_compass", [True, False], ids=["compass", "no compass"])
def test_estimates_an_unknown_heading(with_compass: bool) -> None:
    recording, place = _drive()
    odometry = recording.odometry
    assert odometry is not None
    turned = replace(odometry, attitude_rad=odometry.attitude_rad + [0.0, 0.0, 0.8])
    compass = Compass(odometry.time_s[:5], np.full(5, odometry.attitude_rad[0, 2] + 0.08))
    recording = replace(recording, odometry=turned, compass=compass if with_compass else None)
    config = CONFIG.model_copy(update={"heading_sigma_deg": 5.0})
    online = filter_path(recording, _reckoned(recording), config)
    # Sixty metres under a receiver of one metre give the heading to a degree or two.
    assert np.degrees(abs(online.turn_rad[-1] + 0.8)) < 3.0
    assert np.hypot(*(online.position - place)[60:, :2].T).max() < 3.0


def test_wheels_hold_a_scale_that_wanders() -> None:
    recording, place = _drive()
    odometry = recording.odometry
    assert odometry is not None
    rng = np.random.default_rng(2)
    wander = _gauss_markov(len(odometry.step), 0.05, float(np.exp(-1.0 / 6.0)), rng, 1)
    stretched = replace(odometry, step=odometry.step * (1.0 + wander))
    travel = 1.02 * np.arange(len(place), dtype=float)
    config = CONFIG.model_copy(update={"scale_wander_sigma": 0.05, "scale_sigma": 0.02})
    without = replace(recording, odometry=stretched)
    with_wheels = replace(without, wheels=Wheels(odometry.time_s, travel, travel))
    sigmas = []
    for sensed in (without, with_wheels):
        reckoned = _reckoned(sensed)
        online = filter_path(sensed, reckoned, config)
        smoothed = smooth(sensed, reckoned, config)
        sigmas.append([path.covariance[:, 0, 0].mean() for path in (online, smoothed)])
        # Four standard deviations of the worst of 240 places that share most of their error.
        for path in (online, smoothed):
            off = (path.position - place)[20:, 0] / np.sqrt(path.covariance[20:, 0, 0])
            assert np.abs(off).max() < 4.0
    assert (np.array(sigmas[1]) < 0.9 * np.array(sigmas[0])).all()


def test_a_rover_that_reverses_does_not_contradict_its_wheels() -> None:
    """Every third stretch of 20 m is driven backwards, and the wheels count back."""
    recording, place = _drive()
    odometry = recording.odometry
    assert odometry is not None
    ahead = np.where(np.arange(len(odometry.step)) // 20 % 3 == 1, -1.0, 1.0)
    rng = np.random.default_rng(2)
    wander = _gauss_markov(len(ahead), 0.05, float(np.exp(-1.0 / 6.0)), rng, 1)
    slipping = replace(odometry, step=odometry.step * ahead[:, None] * (1.0 + wander))
    moved = np.diff(place, axis=0) * ahead[:, None]
    shift = np.vstack([np.zeros(3), np.cumsum(moved, axis=0)]) - place
    fixes = replace(recording.gps, position=recording.gps.position + shift)
    travel = 1.02 * np.r_[0.0, np.cumsum(ahead)]
    config = CONFIG.model_copy(update={"scale_wander_sigma": 0.05, "scale_sigma": 0.02})
    without = replace(recording, odometry=slipping, gps=fixes, barometer=None)
    with_wheels = replace(without, wheels=Wheels(odometry.time_s, travel, travel))
    variance = []
    for sensed in (without, with_wheels):
        reckoned = _reckoned(sensed)
        paths = (filter_path(sensed, reckoned, config), smooth(sensed, reckoned, config))
        variance.append([path.covariance[:, 0, 0].mean() for path in paths])
        for path in paths:
            off = (path.position - place - shift)[20:, 0] / np.sqrt(path.covariance[20:, 0, 0])
            # Four standard deviations of the worst of 240 places that share most of their error.
            assert np.abs(off).max() < 4.0
    # Wheels taken for spinning would add no information to the filter, and doubt the odometry in the smoother.
    assert (np.array(variance[1]) < 0.95 * np.array(variance[0])).all()


def test_localization_returns_the_causal_and_the_smoothed_path() -> None:
    recording, place = _drive()
    seen = Sightings([50], [[6.0, 0.0, 0.0]], [0.01 * np.eye(3)], [8.0])
    result = localize(replace(recording, sightings=seen), CONFIG)
    smoothed, online = result.trajectory, result.online_trajectory
    assert online is not None
    np.testing.assert_array_equal(online.time_s, smoothed.time_s)
    assert np.trace(online.covariance[120]) > np.trace(smoothed.covariance[120])
    # The heading of a pose is that of the odometry turned as the filter says: 0.2 deg and a little.
    heading = 2.0 * np.arctan2(online.quaternion[120, 2], online.quaternion[120, 3])
    moved = place[121] - place[120]
    assert np.cos(heading - np.arctan2(moved[1], moved[0])) > 0.999


def test_errors_of_dead_reckoning_grow_with_the_travel_and_are_those_of_the_model() -> None:
    times = np.arange(101.0)
    odometry = Odometry(times, np.tile([1.0, 0.0, 0.0], (100, 1)), np.zeros((101, 3)))
    errors = LocalizationConfig(scale_sigma=0.05, step_sigma_m=0.01, heading_walk_deg_sqrt_m=0.1)
    sigma_m = np.sqrt(np.diagonal(predicted_covariance(odometry, errors), axis1=1, axis2=2))
    assert (np.diff(sigma_m, axis=0) > 0.0).all()
    # Along: 5 % of 100 m. Across: ∫ (L - s)² dW of a heading that walks, L^1.5 / √3, and yaw beside it.
    assert sigma_m[-1, 0] == pytest.approx(5.0, rel=0.02)
    walked_m = np.radians(0.1) * 100.0**1.5 / np.sqrt(3.0)
    assert walked_m < sigma_m[-1, 1] < 1.5 * walked_m


def _straight(sigma_m: FloatArray | None) -> OdometryRecording:
    """100 m straight on; the fixes of the second half are off by 3 m."""
    times = np.arange(101.0)
    odometry = Odometry(times, np.tile([1.0, 0.0, 0.0], (100, 1)), np.zeros((101, 3)))
    place = np.column_stack([times, np.where(times > 50.0, 3.0, 0.0), np.zeros(101)])
    sightings = Sightings([3], [[6.0, 0.0, 0.0]], [0.01 * np.eye(3)], [8.0])
    fixes = GpsFixes(times, place, sigma_m)
    return OdometryRecording("EPSG:32608", np.zeros(3), fixes, odometry=odometry, sightings=sightings)


def test_fixes_whose_stated_error_is_the_assumed_one_give_the_same_bytes() -> None:
    config = LocalizationConfig(gps_bias_sigma_m=0.6, gps_white_sigma_m=0.8)
    plain, stated = (_straight(sigma) for sigma in (None, np.ones(101)))
    path = dead_reckoning(plain.odometry, plain.start)
    online = [filter_path(recording, path, config) for recording in (plain, stated)]
    smoothed = [smooth(recording, path, config) for recording in (plain, stated)]
    assert online[0].position.tobytes() == online[1].position.tobytes()
    assert smoothed[0].position.tobytes() == smoothed[1].position.tobytes()


def test_fixes_that_state_a_larger_error_count_less_online_and_smoothed() -> None:
    config = LocalizationConfig(gps_bias_sigma_m=0.3, gps_white_sigma_m=0.4, yaw_sigma_deg=2.0)
    trusted, doubted = (_straight(np.where(np.arange(101) > 50, sigma, 0.5)) for sigma in (0.5, 10.0))
    path = dead_reckoning(trusted.odometry, trusted.start)
    for estimate in (filter_path, smooth):
        off = [abs(estimate(recording, path, config).position[-1, 1]) for recording in (trusted, doubted)]
        assert off[1] < 0.3 < off[0]

"""Odometry that predicts fixes worse than their neighbours do."""

from dataclasses import replace

import numpy as np
import pytest

from survey.data.recording import OdometryRecording
from survey.data.sensors.odometry import Odometry, Sightings
from survey.data.sensors.records import GpsFixes
from vision_slam.agreement.evidence import along_fixes, is_worse_than_fixes
from vision_slam.config import LocalizationConfig
from vision_slam.motion import dead_reckoning

WIDE = LocalizationConfig(
    start="unknown", scale_wander_sigma=0.25, scale_wander_m=20.0, step_sigma_m=0.2, gps_white_sigma_m=0.3
)  # fmt: skip


def _drive(n_fixes: int = 20) -> OdometryRecording:
    """200 m straight on at 10 m/s with a fix each second."""
    times = np.arange(0.0, 20.05, 0.1)
    level = np.zeros((len(times), 3))
    odometry = Odometry(times, np.tile([1.0, 0.0, 0.0], (len(times) - 1, 1)), level)
    places = dead_reckoning(odometry, np.zeros(3))[5::10] + np.random.default_rng(4).normal(0.0, 0.3, (20, 3))
    fixes = GpsFixes(times[5::10][:n_fixes], places[:n_fixes])
    sightings = Sightings([3], [[6.0, 0.0, 0.0]], [0.01 * np.eye(3)], [8.0])
    return OdometryRecording("EPSG:32608", np.zeros(3), fixes, odometry=odometry, sightings=sightings)


def _wandering(recording: OdometryRecording) -> np.ndarray:
    """Return its path with steps that vary by as much as they are long, and that turn."""
    odometry = recording.odometry
    rng = np.random.default_rng(5)
    turned = np.column_stack(
        [np.zeros((len(odometry.time_s), 2)), np.cumsum(rng.normal(0.0, 0.2, len(odometry.time_s)))]
    )
    steps = odometry.step * rng.uniform(0.0, 4.0, (len(odometry.step), 1))
    return dead_reckoning(Odometry(odometry.time_s, steps, turned), np.zeros(3))


def test_good_odometry_predicts_fixes_better_than_their_neighbours() -> None:
    recording = _drive()
    path = dead_reckoning(recording.odometry, recording.start)
    trusted = LocalizationConfig(start="unknown", gps_white_sigma_m=0.3)
    assert not is_worse_than_fixes(recording, path, trusted)


def test_wandering_odometry_predicts_fixes_worse() -> None:
    recording = _drive()
    assert is_worse_than_fixes(recording, _wandering(recording), WIDE)


@pytest.mark.parametrize("failing", [slice(0, 10), slice(40, 50)])
def test_odometry_that_fails_beside_the_first_fix_or_the_last_is_worse_than_fixes(failing: slice) -> None:
    """5 s at 8 m/s with a turn of 90 degrees and a fix each second; a fifth of the steps are three times too long."""
    times = np.arange(0.0, 5.05, 0.1)
    heading = 0.5 * np.pi * np.clip((times - 1.75) / 1.5, 0.0, 1.0)
    attitude = np.column_stack([np.zeros((51, 2)), heading])
    right = Odometry(times, np.tile([0.8, 0.0, 0.0], (50, 1)), attitude)
    places = dead_reckoning(right, np.zeros(3))
    sightings = Sightings([3], [[6.0, 0.0, 0.0]], [0.01 * np.eye(3)], [8.0])
    fixes = GpsFixes(times[::10], places[::10])
    recording = OdometryRecording("EPSG:32608", places[0], fixes, odometry=right, sightings=sightings)
    precise = WIDE.model_copy(update={"gps_bias_sigma_m": 0.01, "gps_white_sigma_m": 0.02})
    assert not is_worse_than_fixes(recording, places, precise)
    steps = right.step.copy()
    steps[failing] *= 3.0
    wrong = replace(recording, odometry=replace(right, step=steps))
    assert is_worse_than_fixes(wrong, dead_reckoning(wrong.odometry, places[0]), precise)


def test_good_odometry_is_not_blamed_for_the_slow_error_of_the_receiver() -> None:
    rng, times = np.random.default_rng(6), np.arange(0.0, 400.5, 1.0)
    odometry = Odometry(times, np.tile([1.0, 0.0, 0.0], (400, 1)), np.zeros((401, 3)))
    slow = 3.0 * np.sin(times[:, None] / 60.0 + [0.0, 1.0, 2.0])
    path = dead_reckoning(odometry, np.zeros(3))
    fixes = GpsFixes(times, path + slow + rng.normal(0.0, 1.0, (401, 3)))
    sightings = Sightings([3], [[6.0, 0.0, 0.0]], [0.01 * np.eye(3)], [8.0])
    recording = OdometryRecording("EPSG:32608", np.zeros(3), fixes, odometry=odometry, sightings=sightings)
    receiver = LocalizationConfig(gps_bias_sigma_m=3.0, gps_white_sigma_m=1.0, gps_correlation_time_s=300.0)
    assert not is_worse_than_fixes(recording, path, receiver)


def test_fewer_than_five_fixes_decide_nothing() -> None:
    recording = _drive(n_fixes=4)
    assert not is_worse_than_fixes(recording, _wandering(recording), WIDE)


def test_the_path_of_the_fixes_passes_through_them_and_goes_on_beyond() -> None:
    recording, config = along_fixes(_drive(), WIDE)
    path = dead_reckoning(recording.odometry, recording.start)
    np.testing.assert_allclose(path[5::10], recording.gps.position, atol=1e-9)
    assert path[-1, 0] > recording.gps.position[-1, 0] + 2.0  # half a second at 10 m/s, by noisy fixes
    assert config.step_sigma_m == pytest.approx(0.3)

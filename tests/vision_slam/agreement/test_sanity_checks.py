"""Starts and clocks that a recording states wrongly, refuted by its own sensors."""

from dataclasses import replace

import numpy as np
import pytest
from pyproj import CRS

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.recording import Recording
from survey.data.sensors.odometry import Odometry
from survey.data.sensors.records import GpsFixes
from vision_slam.agreement.sanity_checks import (
    check_start_by_fixes,
    fix_delay_s,
    refuse_swapped_images,
)
from vision_slam.attitude import rotations
from vision_slam.config import LocalizationConfig
from vision_slam.motion import dead_reckoning

SITE = CRS("EPSG:32608")
CONFIG = LocalizationConfig()


def _drive(
    late_s: float = 0.0, seed: int = 3, config: LocalizationConfig = CONFIG, radius_m: float = 40.0
) -> tuple[Recording, FloatArray]:
    """Most of a round at 1 m/s with fixes as the configuration has them, and its real path."""
    times = np.arange(0.0, 3.75 * radius_m, 1.0)

    def place(at_s: FloatArray) -> FloatArray:
        angle = np.maximum(at_s, 0.0) / radius_m
        return radius_m * np.column_stack([np.sin(angle), 1.0 - np.cos(angle), np.zeros_like(angle)])

    path = place(times)
    attitude = np.column_stack([np.zeros_like(times), np.zeros_like(times), times / radius_m])
    steps = np.einsum("nji,nj->ni", rotations(attitude[:-1]), np.diff(path, axis=0))
    rng = np.random.default_rng(seed)
    memory, bias, biases = np.exp(-1.0 / config.gps_correlation_time_s), rng.standard_normal(3), []
    for _ in times:
        bias = memory * bias + np.sqrt(1.0 - memory**2) * rng.standard_normal(3)
        biases.append(config.gps_bias_sigma_m * bias)
    fixes = (
        place(times - late_s) + np.array(biases) + config.gps_white_sigma_m * rng.standard_normal(path.shape)
    )
    gps = GpsFixes(times, fixes)
    return Recording(SITE, path[0], gps, odometry=Odometry(times, steps, attitude)), path


def test_a_start_that_fixes_agree_with_is_accepted() -> None:
    recording, path = _drive()
    assert recording.odometry is not None
    kept, config = check_start_by_fixes(recording, path, recording.odometry.time_s, CONFIG)
    assert kept is recording
    assert config is CONFIG


def test_a_start_elsewhere_is_taken_for_unknown(caplog: pytest.LogCaptureFixture) -> None:
    recording, path = _drive()
    assert recording.odometry is not None
    away = np.array([18.0, -24.0, 0.0])
    displaced = Recording(SITE, path[0] + away, recording.gps, odometry=recording.odometry)
    kept, config = check_start_by_fixes(displaced, path + away, recording.odometry.time_s, CONFIG)
    assert config.start == "unknown"
    # The slow error of the fixes, 1 m, and what the heading of the fit adds at the start.
    assert np.hypot(*(kept.start - path[0])[:2]) < 3.0
    assert "the fixes put the start 3" in caplog.text or "the fixes put the start 2" in caplog.text


def test_odometry_of_a_wrong_scale_does_not_refute_the_start_of_a_receiver_of_centimetres() -> None:
    centimetres = CONFIG.model_copy(update={"gps_bias_sigma_m": 0.02, "gps_white_sigma_m": 0.01})
    recording, path = _drive(config=centimetres)
    assert recording.odometry is not None
    stretched = path[0] + (path - path[0]) * (1.0 + 2.0 * centimetres.scale_sigma)
    kept, _ = check_start_by_fixes(recording, stretched, recording.odometry.time_s, centimetres)
    assert kept is recording
    away = stretched + [5.0, 0.0, 0.0]
    displaced = Recording(SITE, away[0], recording.gps, odometry=recording.odometry)
    assert check_start_by_fixes(displaced, away, recording.odometry.time_s, centimetres)[1].start == "unknown"


def test_a_path_that_bends_on_a_long_drive_does_not_refute_its_start() -> None:
    times = np.arange(0.0, 2000.0, 1.0)
    along = np.column_stack([times, np.zeros_like(times), np.zeros_like(times)])
    bent = np.cumsum(
        np.column_stack([np.ones_like(times), times * np.radians(9.0) / 2000.0, 0.0 * times]), axis=0
    )
    fixes = along + CONFIG.gps_white_sigma_m * np.random.default_rng(3).standard_normal(along.shape)
    recording = Recording(SITE, along[0], GpsFixes(times, fixes))
    assert check_start_by_fixes(recording, bent - bent[0], times, CONFIG)[0] is recording


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_fixes_in_time_stay_where_they_are(seed: int) -> None:
    recording, path = _drive(seed=seed)
    assert fix_delay_s(recording, path, CONFIG) == 0.0


def test_fixes_that_forget_sooner_than_assumed_are_not_taken_for_late() -> None:
    minute = CONFIG.model_copy(update={"gps_bias_sigma_m": 3.0, "gps_correlation_time_s": 60.0})
    recording, path = _drive(seed=10, config=minute, radius_m=160.0)
    longer = minute.model_copy(update={"gps_correlation_time_s": 480.0})
    assert fix_delay_s(recording, path, longer) == 0.0


def test_late_fixes_are_moved_back() -> None:
    recording, _ = _drive(late_s=2.0)
    assert recording.odometry is not None
    path = dead_reckoning(recording.odometry, recording.start)
    # Half a second at 1 m/s is what fixes of 1 m with a memory of two minutes can distinguish here.
    assert fix_delay_s(recording, path, CONFIG) == pytest.approx(2.0, abs=0.5)


def test_fixes_of_a_clock_that_is_ahead_are_moved_on() -> None:
    recording, _ = _drive(late_s=-2.0)
    assert recording.odometry is not None
    assert fix_delay_s(
        recording, dead_reckoning(recording.odometry, recording.start), CONFIG
    ) == pytest.approx(-2.0, abs=0.5)


def test_a_delay_that_moves_fixes_beyond_a_short_drive_gains_nothing_by_it() -> None:
    """Ten seconds whose scale is wrong by 30 %: with a delay of seconds few fixes would be left to contradict it."""
    recording, path = _drive()
    assert recording.odometry is not None
    precise = CONFIG.model_copy(update={"gps_bias_sigma_m": 0.01, "gps_white_sigma_m": 0.02})
    times = np.arange(0.0, 11.0)
    odometry = Odometry(times, 1.3 * recording.odometry.step[:10], recording.odometry.attitude_rad[:11])
    fixes = GpsFixes(times, path[:11])
    short = replace(recording, gps=fixes, odometry=odometry)
    reckoned = dead_reckoning(odometry, recording.start)
    assert abs(fix_delay_s(short, reckoned, precise)) <= 2.5


def _stepped(ahead: list[float]) -> Odometry:
    rng = np.random.default_rng(1)
    steps = np.column_stack([ahead, np.zeros((len(ahead), 2))]) + 0.03 * rng.standard_normal((len(ahead), 3))
    return Odometry(0.1 * np.arange(len(ahead) + 1.0), steps, np.zeros((len(ahead) + 1, 3)))


def test_swapped_images_are_refused_by_their_numbers() -> None:
    with pytest.raises(InputError, match=r"images 7 and 8 \(0.700 and 0.800 s\) are in the wrong order"):
        refuse_swapped_images(_stepped([1.0] * 6 + [2.0, -1.0, 2.0] + [1.0] * 4))


@pytest.mark.parametrize(
    "ahead", [[1.0] * 20, [0.0] * 20, [1.0] * 8 + [0.5, -0.5] + [-1.0] * 8, [1.0, -1.0] * 8, [1.0, 1.0, 2.0, 2.0, 2.0, 1.0]]
)  # fmt: skip
def test_a_rover_that_stands_reverses_or_shakes_has_its_images_in_order(ahead: list[float]) -> None:
    refuse_swapped_images(_stepped(ahead))

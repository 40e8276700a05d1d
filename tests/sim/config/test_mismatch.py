"""Assumptions of the estimator that differ from the simulated sensors."""

import numpy as np
import pytest

from benchmarks.mismatched import mismatched
from planners import LawnmowerConfig
from sim.config.mission import MismatchConfig, MissionConfig
from sim.config.world import RandomTerrain
from survey import ConfigError
from vision_slam import LocalizationConfig


def mission(seed: int = 3, **ranges: tuple[float, float]) -> MissionConfig:
    return MissionConfig(
        schema_version=1,
        name="m",
        seed=seed,
        terrain=RandomTerrain(source="random"),
        planner=LawnmowerConfig(swaths=2),
        mismatch=MismatchConfig(**ranges),
    )


def test_without_ranges_the_assumptions_are_the_stated_ones() -> None:
    assert mission().assumed == mission().localization


def test_ratios_lie_in_their_range_and_differ_from_error_to_error() -> None:
    found = [mission(seed, sigma_ratio=(0.5, 2.0)).assumed for seed in range(200)]
    stated = LocalizationConfig()
    bias = np.array([one.gps_bias_sigma_m / stated.gps_bias_sigma_m for one in found])
    yaw = np.array([one.yaw_sigma_deg / stated.yaw_sigma_deg for one in found])
    assert 0.5 <= bias.min() < 0.55
    assert 1.85 < bias.max() <= 2.0
    assert abs(np.corrcoef(np.log(bias), np.log(yaw))[0, 1]) < 0.2
    assert all(one.gps_correlation_time_s == stated.gps_correlation_time_s for one in found)


def test_a_ratio_does_not_depend_on_the_range_of_another() -> None:
    alone = mission(sigma_ratio=(0.5, 2.0)).assumed
    both = mission(sigma_ratio=(0.5, 2.0), correlation_ratio=(0.2, 5.0)).assumed
    assert both.gps_bias_sigma_m == alone.gps_bias_sigma_m
    assert both.gps_correlation_time_s != alone.gps_correlation_time_s


def test_a_range_from_large_to_small_is_refused() -> None:
    with pytest.raises(ConfigError, match="from the smaller ratio to the greater"):
        MismatchConfig(sigma_ratio=(2.0, 0.5))


def test_a_mismatched_mission_has_the_same_sensors_and_other_assumptions() -> None:
    wrong, again = mismatched(mission(), 8), mismatched(mission(), 8)
    assert wrong == again
    assert wrong.sensors == mission().sensors
    assert wrong.assumed.gps_bias_sigma_m != mission().assumed.gps_bias_sigma_m
    assert wrong.assumed.attitude_correlation_m != mission().assumed.attitude_correlation_m
    assert wrong.mismatch.drawn_landmark_ratio(1) == wrong.mismatch.drawn_landmark_ratio(2) != 1.0

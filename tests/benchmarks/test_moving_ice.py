"""Errors and chance rows of the benchmark of surveys on moving ice."""

import numpy as np
import pytest

from benchmarks.moving_ice.cases import MELT_SIGMA_M_PER_DAY, TERRAIN, Case, mission_of
from benchmarks.moving_ice.chance import interval_of_mean, interval_of_share
from benchmarks.moving_ice.figures import share_rows
from survey.reconstruction.gp.config import JointConfig


def test_errors_are_drawn_as_the_estimate_assumes_them():
    missions = [mission_of(Case(1.0, 8.0, 4, seed)) for seed in range(1000, 1200)]
    joint = JointConfig()
    bias = [one.sensors.landmark_far_bias_m for one in missions]
    assert np.std(bias) == pytest.approx(joint.far_bias_sigma_m, rel=0.15)
    assert {one.sensors.landmark_shared_sigma_m for one in missions} == {joint.landmark_shared_sigma_m}
    assert {one.sensors.tilt_bias_sigma_deg for one in missions} == {missions[0].assumed.tilt_bias_sigma_deg}
    assert TERRAIN.nugget_m == missions[0].terrain.micro_relief_sd_m == 0.0


def test_melt_is_drawn_from_what_is_assumed_of_it():
    ice = [mission_of(Case(1.0, 8.0, 4, seed)).ice for seed in range(1000, 1200)]
    off = [one.melt_m_per_day - one.assumed.lowering_m_per_day for one in ice]
    assert np.std(off) == pytest.approx(MELT_SIGMA_M_PER_DAY, rel=0.15)
    assert abs(np.mean(off)) < 3.0 * MELT_SIGMA_M_PER_DAY / np.sqrt(len(off))


def test_still_ice_neither_flows_nor_melts():
    ice = mission_of(Case(0.0, 8.0, 4, 1000)).ice
    assert ice.velocity_m_per_day == ice.melt_m_per_day == ice.assumed.lowering_m_per_day == 0.0


def test_surveys_of_one_site_do_not_narrow_the_chance_of_their_mean():
    one = np.linspace(0.8, 1.0, 200).tolist()
    other = np.random.default_rng(1).permutation(one).tolist()
    assert interval_of_mean([one, one]) == pytest.approx(interval_of_mean([one]))
    assert np.ptp(interval_of_mean([one, other])) < 0.9 * np.ptp(interval_of_mean([one]))


def test_a_share_has_a_bar_where_calibrated_estimates_keep_to_it():
    few, many = (next(share_rows("velocity", [0.0] * n)) for n in (48, 400))
    assert few.holds is None
    assert many.holds is False
    assert interval_of_share(100) == (0.91, 0.98)

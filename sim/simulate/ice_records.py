"""Surveys of stakes and true states of a drive in images on moving ice."""

import numpy as np

from sim.config.mission import MissionConfig
from sim.instruments.stakes import surveyed_repeatedly
from sim.world.moving_ice import MovingIce
from survey.core.arrays import FloatArray
from survey.data.sensors.stakes import StakeSurveys
from survey.data.truth import Truth


def stake_surveys(
    ice: MovingIce, feet: FloatArray, end_s: float, mission: MissionConfig
) -> StakeSurveys | None:
    """Return repeated surveys of stakes that stand at places (K, 3) at the start, or None where the mission has none."""
    if not (len(feet) and ice.config.stake_surveys):
        return None
    sigma_m = mission.instruments.stakes.survey_sigma_m
    return surveyed_repeatedly(feet, ice, np.array([0.0, end_s]), sigma_m, mission.seed)


def truth_of_epoch(truth: Truth, ice: MovingIce, epoch_s: float) -> Truth:
    """Return the terrain of the epoch and the path in fixed coordinates, from those on the ice of the start of the drive."""
    return Truth(ice.terrain_at(truth.dem, epoch_s), ice.carried(truth.trajectory))

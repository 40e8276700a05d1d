"""Stakes: survey and sightings."""

import numpy as np
import pytest

from sim.config.sensors import StakeConfig
from sim.instruments.visual_measurements import StakeSpotter, surveyed_stakes
from tests.sim.instruments.motions import standing


def test_stakes_are_seen_within_reach_and_no_better_than_stated():
    feet = np.array([[0.0, 3.0, 0.0], [50.0, 0.0, 0.0]])
    config = StakeConfig(range_m=8.0, survey_sigma_m=0.05)
    spotter = StakeSpotter(config, feet, 1)
    seen = spotter.sense(standing(2000.0))
    assert set(seen.index) == {0}
    error = seen.offset - feet[0]
    normalised = np.einsum("ni,nij,nj->n", error, np.linalg.inv(seen.covariance), error)
    assert normalised.mean() == pytest.approx(3.0, abs=4.0 * np.sqrt(6.0 / len(seen)))


def test_surveyed_stakes_err_as_stated():
    feet = np.zeros((2000, 3))
    surveyed = surveyed_stakes(StakeConfig(survey_sigma_m=0.05), feet, 1)
    assert surveyed.position.std() == pytest.approx(0.05, rel=4.0 / np.sqrt(2.0 * feet.size))
    assert surveyed_stakes(StakeConfig(), feet[:0], 1) is None

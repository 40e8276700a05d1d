from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from planners import LawnmowerConfig, plan
from planners.guarantee.requirement import MapRequirement
from planners.guarantee.simulated_surveys import GROUNDS, SimulatedErrors, SimulatedSurveys
from planners.prediction.error_model import ErrorModel
from planners.prediction.kernel_posterior import KernelPosterior
from survey import Grid, SurveyArea
from survey.core.streams import stream
from survey.reconstruction.gp.kernel_search import Cell
from survey.terrain.random_fields import CoarseCells, ConditionalTerrain
from tests.planners.guarantee.smooth_site import CRS, SIDE_M, SMOOTH, coarse, smooth_terrain


@pytest.mark.parametrize("name", sorted(GROUNDS))
def test_simulated_ground_agrees_with_the_prior(name):
    cells = CoarseCells(coarse(smooth_terrain()), 0.1)
    world = ConditionalTerrain(cells, SMOOTH.kernel, Grid((0.0, 0.0, SIDE_M, SIDE_M), 5.0, CRS))
    drawn = GROUNDS[name](world, SMOOTH.kernel, stream(5))
    assert np.sqrt(np.mean((cells.seen_in(drawn) - cells.height_m) ** 2)) < 0.5
    other = GROUNDS[name](world, SMOOTH.kernel, stream(6))
    assert np.std(drawn.elevation - other.elevation) > 0.02


def test_simulated_maps_of_swaths_as_far_apart_as_cells_err_as_those_of_others():
    area = SurveyArea.rectangle((0.0, 0.0, SIDE_M, SIDE_M), CRS)
    rough = SMOOTH._replace(cell=Cell.of("squared-exponential", 12.0, -12.0))
    prior, wanted = coarse(smooth_terrain()), MapRequirement(1.0, n_simulations=10)
    model = replace(ErrorModel.from_prior(area, prior, wanted), posterior=KernelPosterior((rough,)))
    surveys = SimulatedSurveys(model, prior, wanted)
    before, meant, after = (
        surveys.errors(plan(area, None, LawnmowerConfig(swaths=n))).rmse_m[:10].mean() for n in (15, 16, 17)
    )
    assert meant == pytest.approx(0.5 * (before + after), rel=0.2)


def _errors(n_met, n_missed):
    rmse_m = np.r_[np.full(n_missed, 0.6), np.full(n_met, 0.3)]
    return SimulatedErrors(rmse_m, ("heavy tails",) * (n_met + n_missed))


def test_a_promise_needs_the_lower_confidence_limit_of_the_share():
    assert _errors(27, 3).share(0.4572) == pytest.approx(0.9)
    assert _errors(27, 3).share(0.4572, "heavy tails") == pytest.approx(0.9)
    assert not _errors(27, 3).prove(0.4572, 0.9)
    assert not _errors(24, 6).prove(0.4572, 0.9)
    assert _errors(57, 3).prove(0.4572, 0.89)
    assert _errors(22, 0).prove(0.4572, 0.9)
    assert not _errors(21, 0).prove(0.4572, 0.9)


def test_confidence_limits_are_those_of_the_binomial_distribution():
    low, high = _errors(27, 3).bounds(0.4572)
    assert binom.sf(26, 30, low) == pytest.approx(0.1)
    assert binom.cdf(27, 30, high) == pytest.approx(0.1)
    assert _errors(0, 5).bounds(0.4572)[0] == 0.0
    assert _errors(5, 0).bounds(0.4572)[1] == 1.0


def test_a_posterior_without_spread_is_the_default():
    assert KernelPosterior((SMOOTH,)).spread == 0.0

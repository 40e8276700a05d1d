import numpy as np
import pytest

from planners.guarantee.belief.kernel_posterior import KernelPosterior
from planners.guarantee.proof.grounds import GROUNDS
from planners.guarantee.proof.simulation import SimulatedErrors
from survey import Grid
from survey.core.streams import stream
from survey.terrain.conditional import CoarseCells, ConditionalTerrain
from tests.planners.guarantee.smooth_site import CRS, SIDE_M, SMOOTH, coarse, smooth_terrain


@pytest.mark.parametrize("name", sorted(GROUNDS))
def test_simulated_ground_agrees_with_the_prior(name):
    cells = CoarseCells(coarse(smooth_terrain()), 0.1)
    world = ConditionalTerrain(cells, SMOOTH.kernel, Grid((0.0, 0.0, SIDE_M, SIDE_M), 5.0, CRS))
    drawn = GROUNDS[name](world, SMOOTH.kernel, stream(5))
    assert np.sqrt(np.mean((cells.seen_in(drawn) - cells.height_m) ** 2)) < 0.5
    other = GROUNDS[name](world, SMOOTH.kernel, stream(6))
    assert np.std(drawn.elevation - other.elevation) > 0.02


def test_a_few_misses_do_not_contradict_a_promise_and_many_do():
    rmse_m = np.r_[np.full(3, 0.6), np.full(27, 0.3)]
    errors = SimulatedErrors(rmse_m, ("heavy tails",) * 30)
    assert not errors.contradict(0.4572, 0.9)
    assert errors.contradict(0.2, 0.9)
    assert errors.share(0.4572) == pytest.approx(0.9)
    assert errors.share(0.4572, "heavy tails") == pytest.approx(0.9)


def test_a_posterior_without_spread_is_the_default():
    assert KernelPosterior((SMOOTH,)).spread == 0.0

import numpy as np
import pytest

from planners.prediction.error_distribution import LimitPredictor
from planners.prediction.kernel_posterior import KernelPosterior, posterior_from_survey
from survey.reconstruction.gp.kernel_search import Cell
from tests.planners.guarantee.smooth_site import AREA, SMOOTH, lines, smooth_terrain


def test_the_chance_of_a_limit_is_that_of_drawn_errors(rng):
    # Errors drawn from the posterior covariance itself, which the moments stand for.
    predictor = LimitPredictor(AREA, limit_m=0.5, step_m=10.0)
    xy, nodes, kernel = lines(3), predictor.nodes, SMOOTH.kernel
    among = kernel.covariance(xy, xy) + SMOOTH.noise_m**2 * np.eye(len(xy))
    joint = np.vstack([xy, nodes])
    root = np.linalg.cholesky(kernel.covariance(joint, joint) + 1e-8 * np.eye(len(joint)))
    field = root @ rng.standard_normal((len(joint), 400))
    heights = field[: len(xy)] + SMOOTH.noise_m * rng.standard_normal((len(xy), 400))
    weights = np.linalg.solve(among, kernel.covariance(xy, nodes)).T
    rmse = np.sqrt(np.mean((weights @ heights - field[len(xy) :]) ** 2, axis=0))
    predicted = predictor.of(xy, KernelPosterior((SMOOTH,)))
    # 400 draws know a share to 0.025; the unknown constant and thinned samples add a little.
    assert predicted.probability == pytest.approx(np.mean(rmse <= 0.5), abs=0.1)
    assert predicted.rmse_m == pytest.approx(rmse.mean(), rel=0.1)


def test_more_swaths_make_the_limit_more_probable():
    predictor = LimitPredictor(AREA, limit_m=0.4572, step_m=10.0)
    chances = [predictor.of(lines(n), KernelPosterior((SMOOTH,))).probability for n in (1, 2, 4, 8)]
    assert chances == sorted(chances)
    assert chances[0] < 0.01
    assert chances[-1] > 0.99


def test_relief_finer_than_the_samples_is_an_error_of_the_map(rng):
    terrain, xy = smooth_terrain(), lines(6)
    sensor = terrain.at(xy) + 0.1 * rng.standard_normal(len(xy))
    bumps = 0.3 * rng.standard_normal(len(xy))
    predictor = LimitPredictor(AREA, limit_m=0.5, step_m=10.0)
    even, bumpy = (posterior_from_survey(xy, heights, noise_m=0.1) for heights in (sensor, sensor + bumps))
    assert predictor.of(xy, even).rmse_m < 0.15
    # The bumps themselves, known to some 20 %, and as much again for what they hide of the rest.
    assert 0.24 < predictor.of(xy, bumpy).rmse_m < 0.3 * np.sqrt(2.0)


def test_a_large_survey_is_predicted_from_patches_as_from_all_samples(monkeypatch):
    predictor = LimitPredictor(AREA, limit_m=0.4572, step_m=10.0)
    rough = KernelPosterior((SMOOTH._replace(cell=Cell.of("matern-3/2", 60.0, -12.0)),))
    together = predictor.of(lines(12), rough)
    monkeypatch.setattr("planners.prediction.error_distribution._MOST_AT_ONCE", 100)
    assert predictor.of(lines(12), rough).rmse_m == pytest.approx(together.rmse_m, rel=0.2)


def test_a_shared_error_is_an_error_of_the_map():
    alone, shared = (LimitPredictor(AREA, 0.3, 10.0, shared_m=one) for one in (0.0, 0.25))
    posterior = KernelPosterior((SMOOTH,))
    assert shared.of(lines(8), posterior).probability < alone.of(lines(8), posterior).probability
    assert shared.of(lines(8), posterior).rmse_m > 0.18

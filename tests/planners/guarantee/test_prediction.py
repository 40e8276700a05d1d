from dataclasses import replace

import numpy as np
import pytest

from planners.prediction.error_distribution import MapPrediction, MapPredictor
from planners.prediction.kernel_posterior import KernelPosterior, posterior_from_survey
from planners.prediction.prior_cells import PriorCells
from survey import Dem, Grid
from survey.reconstruction.gp.kernel_search import Cell
from tests.planners.guarantee.smooth_site import AREA, SMOOTH, lines, smooth_terrain


def predicted_of(xy, posterior, limit_m=0.5, shared_m=0.0):
    found = MapPredictor(AREA, step_m=10.0).distribution(xy, posterior).with_shared(shared_m)
    return MapPrediction(found.probability(limit_m), found.rmse_m)


def test_the_chance_of_a_limit_is_that_of_drawn_errors(rng):
    # Errors drawn from the posterior covariance itself, which the moments stand for.
    xy, nodes, kernel = lines(3), MapPredictor(AREA, step_m=10.0).nodes, SMOOTH.kernel
    among = kernel.covariance(xy, xy) + SMOOTH.noise_m**2 * np.eye(len(xy))
    joint = np.vstack([xy, nodes])
    root = np.linalg.cholesky(kernel.covariance(joint, joint) + 1e-8 * np.eye(len(joint)))
    field = root @ rng.standard_normal((len(joint), 400))
    heights = field[: len(xy)] + SMOOTH.noise_m * rng.standard_normal((len(xy), 400))
    weights = np.linalg.solve(among, kernel.covariance(xy, nodes)).T
    rmse = np.sqrt(np.mean((weights @ heights - field[len(xy) :]) ** 2, axis=0))
    predicted = predicted_of(xy, KernelPosterior((SMOOTH,)))
    # 400 draws know a share to 0.025; the unknown constant and thinned samples add a little.
    assert predicted.probability == pytest.approx(np.mean(rmse <= 0.5), abs=0.1)
    assert predicted.rmse_m == pytest.approx(rmse.mean(), rel=0.1)


def test_more_swaths_make_the_limit_more_probable():
    chances = [predicted_of(lines(n), KernelPosterior((SMOOTH,)), 0.4572).probability for n in (1, 2, 4, 8)]
    assert chances == sorted(chances)
    assert chances[0] < 0.01
    assert chances[-1] > 0.99


def test_relief_finer_than_the_samples_is_an_error_of_the_map(rng):
    terrain, xy = smooth_terrain(), lines(6)
    sensor = terrain.at(xy) + 0.1 * rng.standard_normal(len(xy))
    bumps = 0.3 * rng.standard_normal(len(xy))
    even, bumpy = (posterior_from_survey(xy, heights, noise_m=0.1) for heights in (sensor, sensor + bumps))
    assert predicted_of(xy, even).rmse_m < 0.15
    # The bumps themselves, known to some 20 %, and as much again for what they hide of the rest.
    assert 0.24 < predicted_of(xy, bumpy).rmse_m < 0.3 * np.sqrt(2.0)


def test_a_large_survey_is_predicted_group_by_group_as_at_once(monkeypatch):
    rough = KernelPosterior((SMOOTH._replace(cell=Cell.of("matern-3/2", 60.0, -12.0)),))
    together = predicted_of(lines(12), rough)
    monkeypatch.setattr("planners.prediction.error_distribution._MOST_AT_ONCE", 100)
    assert predicted_of(lines(12), rough).rmse_m == pytest.approx(together.rmse_m, rel=0.1)


def test_a_shared_error_is_an_error_of_the_map():
    posterior = KernelPosterior((SMOOTH,))
    alone, shared = (predicted_of(lines(8), posterior, 0.3, one) for one in (0.0, 0.25))
    assert shared.probability < alone.probability
    assert shared.rmse_m > 0.18


def cells_of(cell_m, sigma_m):
    grid = Grid((0.5 * cell_m, 0.5 * cell_m, 300.0 - 0.5 * cell_m, 300.0 - 0.5 * cell_m), cell_m, AREA.crs)
    return PriorCells.of(Dem.on(grid, np.zeros(grid.shape)), AREA, sigma_m)


def test_cells_of_a_prior_count_as_the_means_that_they_measure(rng):
    """The error is that of maps drawn from samples and cells, whose errors are independent, correlated and common."""
    predictor = MapPredictor(AREA, 10.0, cells=cells_of(50.0, 0.5))
    cells, xy, kernel = predictor.cells, lines(2), SMOOTH.kernel
    fine = np.stack(np.meshgrid(*[(np.arange(6) + 0.5) / 6.0 - 0.5] * 2), axis=-1).reshape(-1, 2)
    within = (cells.centre[:, None] + 50.0 * fine).reshape(-1, 2)
    every = np.vstack([xy, within, predictor.nodes])
    n, n_cells, n_fine = len(xy), len(cells), len(fine)
    k = kernel.covariance(every, every)
    to_data = np.zeros((n + n_cells, len(every)))
    to_data[np.arange(n), np.arange(n)] = 1.0
    for c in range(n_cells):
        to_data[n + c, n + c * n_fine : n + (c + 1) * n_fine] = 1.0 / n_fine
    noise = np.zeros((n + n_cells, n + n_cells))
    noise[:n, :n] = SMOOTH.noise_m**2 * np.eye(n)
    noise[n:, n:] = cells.covariance
    among, across = to_data @ k @ to_data.T + noise, to_data @ k[:, -len(predictor.nodes) :]
    inverse = np.linalg.inv(among)
    ones = inverse.sum(axis=0)
    gap = 1.0 - ones @ across
    expected = kernel.variance_m2 - np.einsum("ij,ik,kj->j", across, inverse, across) + gap**2 / ones.sum()
    found = predictor.variance(xy, KernelPosterior((SMOOTH,)), predictor.nodes)
    # Four nodes stand for a cell, and all directions between two for theirs.
    assert found == pytest.approx(expected, rel=0.03)
    assert found.mean() == pytest.approx(expected.mean(), rel=0.01)


def test_the_level_of_a_map_by_the_prior_alone_is_that_of_the_mean_error_of_its_cells():
    cells = cells_of(50.0, 0.5)
    weights = np.full(len(cells), 1.0 / len(cells))
    # Means of 36 cells: of the common level of 0.5 m, errors that neighbours share and independent ones.
    assert 0.5 < cells.level_m <= np.sqrt(weights @ cells.covariance @ weights)
    assert replace(cells, centre=cells.centre[:1]).level_m == pytest.approx(0.5 * np.sqrt(3.0))
    assert cells_of(5.0, 0.5).level_m == pytest.approx(cells.level_m, rel=0.05)
    # No error of a prior is too small to have a level: its square, 0 in double precision, is not needed.
    assert replace(cells, sigma_m=1e-300).level_m == pytest.approx(2e-300 * cells.level_m, rel=1e-12)
    assert replace(cells, sigma_m=0.0).level_m == 0.0
    assert cells_of(50.0, 0.0).level_m == 0.0


def test_a_prior_helps_between_far_lines_and_not_between_near_ones():
    posterior = KernelPosterior((SMOOTH,))
    without, with_prior = MapPredictor(AREA, 10.0), MapPredictor(AREA, 10.0, cells=cells_of(30.0, 0.3))
    ratios = [
        with_prior.distribution(lines(n), posterior).rmse_m / without.distribution(lines(n), posterior).rmse_m
        for n in (2, 15)
    ]
    assert ratios[0] < 0.3
    assert 0.9 < ratios[1] <= 1.0


def test_hundreds_of_cells_are_predicted_group_by_group_as_at_once(monkeypatch):
    posterior = KernelPosterior((SMOOTH._replace(cell=Cell.of("matern-3/2", 60.0, -12.0)),))
    predictor = MapPredictor(AREA, 10.0, cells=cells_of(20.0, 1.0))
    together = predictor.distribution(lines(3), posterior).rmse_m
    monkeypatch.setattr("planners.prediction.error_distribution._MOST_CELLS", 10)
    assert predictor.distribution(lines(3), posterior).rmse_m == pytest.approx(together, rel=0.1)

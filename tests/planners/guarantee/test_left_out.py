import numpy as np
import pytest

from planners.prediction.kernel_posterior import KernelPosterior, WeightedKernel, checked_by_lines
from survey.core.streams import stream
from survey.reconstruction.gp.kernel_search import Cell

CELL = Cell.of("matern-3/2", 60.0, -12.0)
ONE = WeightedKernel(CELL, 4.0, 0.1, 1.0)


def _survey(n_lines, seed=1):
    """Samples of ten places on each of some lines, drawn from the covariance."""
    east, north = np.meshgrid(np.arange(10) * 20.0, np.arange(n_lines) * 25.0)
    xy = np.column_stack([east.ravel(), north.ravel()])
    covariance = ONE.kernel.covariance(xy, xy) + ONE.noise_m**2 * np.eye(len(xy))
    heights = np.linalg.cholesky(covariance) @ stream(seed).standard_normal(len(xy))
    return xy, heights, np.repeat(np.arange(n_lines), 10)


def test_a_true_covariance_stays_as_it_is():
    factors = []
    for seed in range(12):
        checked = checked_by_lines(KernelPosterior((ONE,)), *_survey(10, seed))
        factors.append(np.log(checked.likeliest.variance_m2 / 4.0) / 2.0)
    assert np.mean(factors) == pytest.approx(0.0, abs=0.05)
    # What is left open is as wide as the estimates scatter.
    assert checked.open_spread == pytest.approx(np.std(factors), rel=0.6)


@pytest.mark.parametrize("factor", [0.7, 1.4])
def test_ground_that_is_rougher_between_the_lines_is_found(factor):
    wrong = ONE._replace(variance_m2=4.0 / factor**2)
    checked = checked_by_lines(KernelPosterior((wrong,)), *_survey(14))
    assert np.sqrt(checked.likeliest.variance_m2 / 4.0) == pytest.approx(1.0, abs=0.17)


def test_residuals_are_those_of_predictions_from_all_other_lines():
    xy, heights, line = _survey(3)
    out = line == 1
    covariance = ONE.kernel.covariance(xy, xy) + ONE.noise_m**2 * np.eye(len(xy))
    within, across = covariance[np.ix_(~out, ~out)], covariance[np.ix_(out, ~out)]
    ones = np.linalg.solve(within, np.ones(20))
    mean = ones @ heights[~out] / ones.sum()
    residual = heights[out] - mean - across @ np.linalg.solve(within, heights[~out] - mean)
    inverse = np.linalg.inv(covariance)
    total = inverse.sum(axis=1)
    inverse -= np.outer(total, total) / total.sum()
    found = np.linalg.solve(inverse[np.ix_(out, out)], (inverse @ heights)[out])
    np.testing.assert_allclose(found, residual, atol=1e-6)


def test_two_lines_leave_the_roughness_open():
    checked = checked_by_lines(KernelPosterior((ONE,), 0.1), *_survey(2))
    assert checked.kernels == (ONE,)
    assert checked.spread == 0.1
    assert checked.open_spread == 0.25

"""Posterior of the longest length scale: its likelihood, its quantiles, and how broad it is beside a single swath."""

import numpy as np
import pytest

from survey.core.arrays import FloatArray
from survey.reconstruction.gp.families import Sum
from survey.reconstruction.gp.kernels import Matern32, SquaredExponential
from survey.reconstruction.gp.marginal_likelihood import Hyperparameters, KernelFit
from survey.reconstruction.joint.kernel_choice import _VARIANCES, _log_likelihoods, lengths_of

SIGMA = 0.05
KERNEL = Sum(SquaredExponential(1.0, 40.0), Matern32(0.01, 3.0))
FOUND = Hyperparameters("two-scale-mixed", KERNEL, 0.02, 0.0)


def fit_to(xy: FloatArray, seed: int = 3) -> KernelFit:
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(KERNEL.covariance(xy, xy) + 1e-9 * np.eye(len(xy)))
    z = root @ rng.standard_normal(len(xy)) + SIGMA * rng.standard_normal(len(xy))
    return KernelFit.of(xy, z, np.full(len(xy), SIGMA**2), None)


def lengths_m(fit: KernelFit) -> FloatArray:
    return np.array([one.kernel.length_scales_m[1] for one in lengths_of(fit, FOUND)])


def test_the_likelihood_of_lengths_and_variances_is_that_of_the_fit() -> None:
    fit = fit_to(np.random.default_rng(1).uniform(0.0, 200.0, (60, 2)))
    longest, short = KERNEL.parts
    logs = _log_likelihoods(fit, longest, [short], FOUND.nugget_m, np.array([25.0, 60.0]))
    expected = [
        fit.log_likelihood(Sum(SquaredExponential(variance, length), short), FOUND.nugget_m)
        for length, variance in ((25.0, _VARIANCES[40]), (60.0, _VARIANCES[20]))
    ]
    assert logs[1, 20] - logs[0, 40] == pytest.approx(expected[1] - expected[0], abs=1e-6)


def test_lengths_about_the_true_one_are_returned_where_points_surround_the_site() -> None:
    fit = fit_to(np.random.default_rng(2).uniform(0.0, 250.0, (200, 2)))
    found = lengths_m(fit)
    assert np.all(np.diff(found) > 0.0)
    assert found[0] < 1.25 * 40.0
    assert found[-1] > 40.0 / 1.25
    assert found[-1] / found[0] < 1.6


def test_a_length_that_is_determined_is_returned_alone() -> None:
    fit = fit_to(np.random.default_rng(2).uniform(0.0, 900.0, (320, 2)))
    assert lengths_of(fit, FOUND) == [FOUND]


def test_a_single_swath_leaves_length_and_variance_open() -> None:
    rng = np.random.default_rng(4)
    fit = fit_to(np.column_stack([rng.uniform(0.0, 80.0, 200), rng.uniform(-8.0, 8.0, 200)]))
    found = lengths_of(fit, FOUND)
    assert lengths_m(fit)[2] / lengths_m(fit)[0] > 1.6
    variances = [one.kernel.parts[0].variance_m2 for one in found]
    assert variances == sorted(variances)
    assert [one.kernel.parts[1] for one in found] == [KERNEL.parts[1]] * 3

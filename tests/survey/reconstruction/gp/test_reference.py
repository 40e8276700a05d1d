"""Every engine gives the posterior of the reference, which is written as the paper's equations."""

from collections.abc import Callable

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from survey.core.arrays import FloatArray
from survey.reconstruction.gp.engines.fourier_gp import FourierGaussianProcess
from survey.reconstruction.gp.engines.local_gp import LocalGaussianProcess
from survey.reconstruction.gp.engines.regression import DenseGaussianProcess, Process
from survey.reconstruction.gp.engines.tiled_gp import TiledGaussianProcess
from survey.reconstruction.gp.kernels import SquaredExponential
from survey.reconstruction.gp.reference import (
    condition,
    elevation_variance,
    log_marginal_likelihood,
    marginal,
    squared_exponential,
)

LENGTH_M, ALPHA_M2 = 20.0, 9.0
BOUNDS = (0.0, 0.0, 100.0, 100.0)
COVARIANCE = squared_exponential(ALPHA_M2, LENGTH_M**2)
Points = tuple[FloatArray, FloatArray, FloatArray]


def zero(places_m: FloatArray) -> FloatArray:
    return np.zeros(len(places_m))


@pytest.fixture
def points() -> Points:
    rng = np.random.default_rng(2)
    xy = rng.uniform(0.0, 100.0, (60, 2))
    return xy, 3.0 * np.sin(xy[:, 0] / 15.0) + 0.1 * rng.standard_normal(60), rng.uniform(0.1, 0.5, 60)


@pytest.fixture
def places() -> FloatArray:
    return np.random.default_rng(3).uniform(10.0, 90.0, (40, 2))


Fit = Callable[[Points], Process]
KERNEL = SquaredExponential(ALPHA_M2, LENGTH_M)


@pytest.mark.parametrize(
    ("fit", "tolerance_m"),
    [
        # The dense engine solves the same equations; the others state their error as a setting or a bound.
        (lambda points: DenseGaussianProcess.fit(*points, KERNEL), 1e-9),
        (lambda points: FourierGaussianProcess.fit(*points, KERNEL, bounds=BOUNDS, tolerance_m=1e-4), 1e-3),
        (lambda points: TiledGaussianProcess.fit(*points, KERNEL, bounds=BOUNDS, memory_mb=12.0), 5e-3),
        (lambda points: LocalGaussianProcess.fit(*points, KERNEL, bounds=BOUNDS), 1e-2),
    ],
    ids=["dense", "fourier", "tiled", "local"],
)
def test_an_engine_gives_the_posterior_of_the_reference(
    fit: Fit, tolerance_m: float, points: Points, places: FloatArray
) -> None:
    mean_m, covariance_m2 = condition(COVARIANCE, zero, points, places)
    engine_mean_m, engine_variance_m2 = fit(points).predict(places)
    np.testing.assert_allclose(engine_mean_m, mean_m, atol=tolerance_m)
    np.testing.assert_allclose(np.sqrt(engine_variance_m2), np.sqrt(np.diag(covariance_m2)), atol=tolerance_m)


def test_the_reference_equals_scikit_learn(points: Points, places: FloatArray) -> None:
    xy, z, sigma = points
    peer = GaussianProcessRegressor(ConstantKernel(ALPHA_M2) * RBF(LENGTH_M), alpha=sigma**2, optimizer=None)
    mean_m, covariance_m2 = peer.fit(xy, z).predict(places, return_cov=True)
    ours_m, ours_m2 = condition(COVARIANCE, zero, points, places)
    np.testing.assert_allclose(ours_m, mean_m, atol=1e-8)
    np.testing.assert_allclose(ours_m2, covariance_m2, atol=1e-8)
    likelihood = log_marginal_likelihood(COVARIANCE, zero, points)
    assert likelihood == pytest.approx(peer.log_marginal_likelihood_value_, abs=1e-8)


def test_a_mean_function_takes_the_place_of_satellite_elevations_far_from_the_points(points: Points) -> None:
    far_m = np.array([[5000.0, 5000.0]])
    mean_m, covariance_m2 = condition(
        COVARIANCE, lambda places_m: 100.0 + 0.1 * places_m[:, 0], points, far_m
    )
    assert mean_m[0] == pytest.approx(600.0)
    assert covariance_m2[0, 0] == pytest.approx(ALPHA_M2)


def test_landmarks_enter_by_their_marginal_variance_of_elevation() -> None:
    covariance_m2 = np.array([[[4.0, 0.0, 1.0], [0.0, 4.0, 0.5], [1.0, 0.5, 0.25]]])
    variance_m2 = elevation_variance(covariance_m2)
    assert variance_m2.tolist() == [0.25]
    _, kept_m2 = marginal(np.zeros(3), covariance_m2[0], slice(2, 3))
    assert kept_m2.tolist() == [[0.25]]

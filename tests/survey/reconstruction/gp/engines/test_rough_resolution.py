"""Rough covariances: a box and waves of their own, and the spread that the nearest points leave."""

import numpy as np

from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.engine_choice import fit_process
from survey.reconstruction.gp.engines.fourier_basis import resolve_for_points
from survey.reconstruction.gp.engines.fourier_gp import nearest_variance_bound
from survey.reconstruction.gp.engines.regression import DenseGaussianProcess, NoisyValues
from survey.reconstruction.gp.families import Sum
from survey.reconstruction.gp.kernels import Matern32, Matern52, SquaredExponential

SITE = (0.0, 0.0, 300.0, 300.0)


def _swaths() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    xy = np.column_stack([75.0 * rng.integers(0, 5, 900) + rng.normal(0, 8, 900), rng.uniform(0, 300, 900)])
    xy = np.clip(xy, 0.0, 300.0)
    return xy, np.zeros(900), np.full(900, 0.1)


def test_a_smooth_kernel_keeps_the_exact_resolution() -> None:
    xy, _, sigma = _swaths()
    resolution = resolve_for_points(
        SquaredExponential(10.0, 40.0), SITE, xy, sigma**2, tolerance_m=1e-3, memory_mb=300.0
    )
    assert resolution is not None
    assert resolution.is_met


def test_a_rough_map_has_the_spread_of_the_dense_one() -> None:
    kernel = Sum(Matern32(60.0, 150.0), Matern32(0.3, 8.0))
    xy, _, sigma = _swaths()
    rng = np.random.default_rng(1)
    root = np.linalg.cholesky(kernel.covariance(xy, xy) + 0.01 * np.eye(900))
    z = root @ rng.standard_normal(900)
    config = GaussianProcessConfig(memory_mb=40.0)
    fast, _ = fit_process("gp", kernel, xy, z, sigma, bounds=SITE, trend="constant", config=config)
    dense = DenseGaussianProcess.fit(xy, z, sigma, kernel, trend="constant")
    places = rng.uniform(0.0, 300.0, (400, 2))
    mean, variance = fast.predict(places)
    exact_mean, exact_variance = dense.predict(places)
    ratio = np.sqrt(fast.surface_variance(variance, places) / exact_variance)
    # The box of three quarters of the site costs a few per cent; twelve neighbours carry nearly all information.
    assert 0.97 < np.median(ratio) < 1.03
    assert np.quantile(ratio, 0.01) > 0.85
    assert np.quantile(ratio, 0.99) < 1.15
    assert np.sqrt(np.mean((mean - exact_mean) ** 2 / exact_variance)) < 0.3


def test_the_bound_is_the_posterior_variance_given_the_nearest_points():
    rng = np.random.default_rng(3)
    xy = rng.uniform(0.0, 100.0, (12, 2))
    data = NoisyValues.of(xy, np.zeros(12), np.linspace(0.1, 0.5, 12))
    kernel = Matern52(4.0, 30.0, anisotropy=1.5, angle_deg=20.0)
    places = rng.uniform(0.0, 100.0, (7, 2))
    across = kernel.covariance(places, xy)
    solved = np.linalg.solve(kernel.covariance(xy, xy) + np.diag(data.noise_m2), across.T)
    exact = kernel.variance_m2 - np.einsum("ij,ji->i", across, solved)
    np.testing.assert_allclose(nearest_variance_bound(kernel, data, places), exact, rtol=1e-9)


def test_a_point_given_twice_almost_without_noise_tells_nothing_more():
    xy = np.array([[0.0, 0.0], [0.0, 0.0], [10.0, 0.0]])
    kernel = Matern52(4.0, 30.0)
    twice, once = (
        NoisyValues.of(each, np.zeros(len(each)), np.full(len(each), 1e-7)) for each in (xy, xy[1:])
    )
    places = np.array([[5.0, 1.0], [0.0, 3.0]])
    bounds = [nearest_variance_bound(kernel, data, places) for data in (twice, once)]
    np.testing.assert_allclose(*bounds, rtol=1e-9)


def test_the_bound_at_a_place_does_not_depend_on_the_places_beside_it():
    rng = np.random.default_rng(5)
    xy = rng.uniform(0.0, 100.0, (40, 2))
    data = NoisyValues.of(xy, np.zeros(40), np.full(40, 0.1))
    kernel = Matern52(4.0, 30.0, anisotropy=1.5, angle_deg=20.0)
    places = rng.uniform(0.0, 100.0, (2500, 2))
    together = nearest_variance_bound(kernel, data, places)
    alone = np.concatenate(
        [nearest_variance_bound(kernel, data, places[k : k + 1]) for k in range(0, 2500, 50)]
    )
    np.testing.assert_array_equal(together[::50], alone)
    assert nearest_variance_bound(kernel, data, places[:0]).shape == (0,)

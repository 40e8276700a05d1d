"""The covariance functions: their closed forms, their spectra, their gradients."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import j0

from survey.core.errors import ConfigError
from survey.reconstruction.gp.families import Sum
from survey.reconstruction.gp.kernels import Kernel, Matern32, Matern52, RationalQuadratic, SquaredExponential

ISOTROPIC: list[Kernel] = [
    SquaredExponential(10.0, 17.75),
    Matern32(4.0, 25.0),
    Matern52(2.5, 12.0),
    RationalQuadratic(3.0, 15.0, shape=2.5),
    Sum(SquaredExponential(11.6, 39.9), Matern32(0.18, 13.0)),
]
ANISOTROPIC: list[Kernel] = [
    SquaredExponential(10.0, 17.75, anisotropy=2.5, angle_deg=30.0),
    Matern32(4.0, 25.0, anisotropy=0.6, angle_deg=-70.0),
    RationalQuadratic(3.0, 15.0, anisotropy=1.7, angle_deg=115.0, shape=1.8),
    Sum(SquaredExponential(11.6, 39.9, anisotropy=3.0), Matern52(0.18, 13.0, anisotropy=1.5, angle_deg=45.0)),
]


def name(kernel: Kernel) -> str:
    return type(kernel).__name__


def test_squared_exponential_is_the_paper_s_equation_1() -> None:
    kernel = SquaredExponential(10.0, np.sqrt(315.0))
    lag = np.array([[3.0, 4.0], [20.0, 0.0]])
    expected = 10.0 * np.exp(-np.array([25.0, 400.0]) / (2 * 315.0))
    np.testing.assert_allclose(kernel.covariance_of_lag(lag), expected, rtol=1e-14)


@pytest.mark.parametrize("kernel", ISOTROPIC + ANISOTROPIC, ids=name)
def test_covariance_is_symmetric_positive_and_equals_the_variance_at_zero(kernel: Kernel) -> None:
    xy = np.random.default_rng(1).uniform(0, 100, (30, 2))
    covariance = kernel.covariance(xy, xy)
    np.testing.assert_allclose(covariance, covariance.T, rtol=1e-12)
    np.testing.assert_allclose(np.diag(covariance), kernel.variance_m2, rtol=1e-12)
    # rounding of a 30 x 30 eigenvalue problem
    assert np.linalg.eigvalsh(covariance).min() > -1e-12 * kernel.variance_m2 * 30


@pytest.mark.parametrize("kernel", ISOTROPIC, ids=name)
@pytest.mark.parametrize("omega", [0.02, 0.08, 0.2])
def test_spectral_density_is_the_hankel_transform_of_the_covariance(kernel: Kernel, omega: float) -> None:
    def integrand(r: float) -> float:
        return 2 * np.pi * r * float(j0(omega * r)) * float(kernel.covariance_of_lag(np.array([r, 0.0])))

    # the rational quadratic decays slowly: the integral is cut where its tail is below the tolerance
    transform = sum(quad(integrand, a, a + 100, limit=200)[0] for a in range(0, 6000, 100))
    density = float(kernel.spectral_density(np.array([omega, 0.0])))
    scale = float(kernel.spectral_density(np.array([0.0, 0.0])))
    assert transform == pytest.approx(density, abs=2e-5 * scale)


@pytest.mark.parametrize("kernel", ISOTROPIC + ANISOTROPIC, ids=name)
def test_sum_of_spectral_lines_gives_the_covariance_back(kernel: Kernel) -> None:
    length, n = 1500.0, 401
    axis = 2 * np.pi / length * (np.arange(n) - n // 2)
    omega = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    lines = kernel.spectral_density(omega) / length**2
    for lag in np.array([[0.0, 10.0], [25.0, 5.0], [-12.0, 20.0]]):
        series = float(np.sum(lines * np.cos(omega @ lag)))
        # the box's images of the heavy-tailed kernel and Matérn's tail beyond the band, a few parts in 1000
        expected = float(kernel.covariance_of_lag(lag))
        assert series == pytest.approx(expected, abs=5e-3 * kernel.variance_m2)


@pytest.mark.parametrize("kernel", ISOTROPIC + ANISOTROPIC, ids=name)
def test_gradient_of_the_log_spectrum_matches_finite_differences(kernel: Kernel) -> None:
    omega = np.random.default_rng(2).uniform(-0.15, 0.15, (20, 2))
    theta = kernel.log_parameters
    gradient = kernel.log_spectral_gradient(omega)
    assert gradient.shape == (len(theta), 20) == (len(kernel.parameter_names), 20)
    for k in range(len(theta)):
        step = np.zeros_like(theta)
        step[k] = 1e-6
        above = np.log(kernel.with_log_parameters(theta + step).spectral_density(omega))
        below = np.log(kernel.with_log_parameters(theta - step).spectral_density(omega))
        # rounding of a difference of logarithms over 2e-6
        np.testing.assert_allclose(gradient[k], (above - below) / 2e-6, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("kernel", ISOTROPIC + ANISOTROPIC, ids=name)
def test_parameters_survive_the_round_trip(kernel: Kernel) -> None:
    again = kernel.with_log_parameters(kernel.log_parameters)
    lag = np.array([[7.0, -3.0]])
    np.testing.assert_allclose(again.covariance_of_lag(lag), kernel.covariance_of_lag(lag), rtol=1e-12)


@pytest.mark.parametrize("kernel", ISOTROPIC + ANISOTROPIC, ids=name)
def test_beyond_the_decay_distance_the_covariance_is_small_in_every_direction(kernel: Kernel) -> None:
    reach = kernel.decay_m(1e-3)
    angles = np.linspace(0, np.pi, 24)
    lag = reach * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    n_parts = len(kernel.parts) if isinstance(kernel, Sum) else 1
    assert kernel.covariance_of_lag(lag).max() <= 1.001e-3 * n_parts * kernel.variance_m2


def test_the_long_axis_points_along_the_angle() -> None:
    kernel = SquaredExponential(1.0, 30.0, anisotropy=3.0, angle_deg=90.0)
    north, east = np.array([0.0, 30.0]), np.array([10.0, 0.0])
    assert kernel.covariance_of_lag(north) == pytest.approx(np.exp(-0.5))
    assert kernel.covariance_of_lag(east) == pytest.approx(np.exp(-0.5))
    assert kernel.length_scales_m == pytest.approx((10.0, 30.0))


def test_impossible_parameters_are_refused() -> None:
    with pytest.raises(ConfigError, match="variance_m2 is -1"):
        SquaredExponential(-1.0, 10.0)
    with pytest.raises(ConfigError, match="length_scale_m is 0"):
        Matern32(1.0, 0.0)
    with pytest.raises(ConfigError, match="shape is 1"):
        RationalQuadratic(1.0, 10.0, shape=1.0)
    with pytest.raises(ConfigError, match="no kernels"):
        Sum()


@pytest.mark.parametrize("kernel", ANISOTROPIC, ids=name)
def test_a_kernel_that_is_fitted_with_a_stretch_has_its_parameters_at_a_stretch_of_1(kernel: Kernel) -> None:
    theta = np.where(["anisotropy" in one for one in kernel.parameter_names], 0.0, kernel.log_parameters)
    there = kernel.with_log_parameters(theta)
    assert there.parameter_names == kernel.parameter_names
    np.testing.assert_allclose(there.log_parameters, theta, atol=1e-12)

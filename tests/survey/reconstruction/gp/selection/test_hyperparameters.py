"""The likelihood and its gradient, and the hyperparameters found by it."""

import numpy as np
import pytest

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.reconstruction.gp.covariance.kernels import Kernel, Matern32, Matern52, SquaredExponential, Sum
from survey.reconstruction.gp.engines.evidence import MarginalLikelihood
from survey.reconstruction.gp.engines.noisy_values import NoisyValues
from survey.reconstruction.gp.engines.polynomial_trend import PolynomialTrend, TrendName
from survey.reconstruction.gp.engines.resolution import affordable_basis
from survey.reconstruction.gp.selection.hyperparameters import KernelFit, Stage, choose_kernel, fit_kernel

BOUNDS = (0.0, 0.0, 100.0, 100.0)

Points = tuple[FloatArray, FloatArray, FloatArray]


def drawn(kernel: Kernel, n: int, seed: int, *, sigma_m: float = 0.1) -> Points:
    """Points from exactly this prior."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 100, (n, 2))
    factor = np.linalg.cholesky(kernel.covariance(xy, xy) + 1e-8 * np.eye(n))
    sigma = np.full(n, sigma_m)
    return xy, factor @ rng.standard_normal(n) + sigma * rng.standard_normal(n), sigma


@pytest.mark.parametrize("trend", ["none", "plane"])
@pytest.mark.parametrize("tolerance_m", [1e-3, 1.0])
@pytest.mark.parametrize(
    "kernel",
    [
        SquaredExponential(4.0, 12.0),
        SquaredExponential(4.0, 15.0, anisotropy=2.0, angle_deg=30.0),
        Sum(SquaredExponential(4.0, 30.0), Matern52(0.2, 30.0)),
        Matern32(4.0, 30.0),
    ],
    ids=lambda kernel: type(kernel).__name__,
)
def test_gradient_matches_finite_differences(kernel: Kernel, tolerance_m: float, trend: TrendName) -> None:
    data = NoisyValues.of(*drawn(SquaredExponential(3.0, 14.0), 80, 5))
    basis = affordable_basis(kernel, BOUNDS, 0.1, tolerance_m, 500)
    surface = PolynomialTrend(trend, basis.box)

    def value(theta: FloatArray, extra: float = 0.0) -> float:
        return MarginalLikelihood.of(kernel.with_log_parameters(theta), basis, data, surface, extra).value

    theta = kernel.log_parameters
    evidence = MarginalLikelihood.of(kernel, basis, data, surface)
    differences = [(value(theta + e) - value(theta - e)) / 2e-5 for e in 1e-5 * np.eye(len(theta))]
    scale = np.abs(differences).max()
    # rounding of a log determinant over a step of 2e-5
    np.testing.assert_allclose(evidence.kernel_gradient, differences, atol=1e-4 * scale)
    of_noise = (value(theta, 1e-6) - value(theta, -1e-6)) / 2e-6
    assert evidence.noise_gradient.sum() == pytest.approx(of_noise, rel=1e-3)


def test_the_objective_s_gradient_covers_nugget_and_noise_scale() -> None:
    data = NoisyValues.of(*drawn(SquaredExponential(3.0, 14.0), 60, 6))
    kernel = SquaredExponential(2.0, 12.0)
    fit = KernelFit(data, BOUNDS, "constant", 5.0, with_nugget=True, with_noise_scale=True)
    theta = np.append(kernel.log_parameters, [np.log(0.01), 0.3])
    stage = Stage(1e-2, 10.0, 4.0)
    _, gradient = fit.objective(theta, kernel, stage)
    for k in (2, 3):
        step = np.zeros(4)
        step[k] = 1e-5
        above, below = (fit.objective(theta + sign * step, kernel, stage)[0] for sign in (1, -1))
        assert gradient[k] == pytest.approx((above - below) / 2e-5, rel=1e-4)


def test_finds_the_parameters_that_the_points_were_drawn_with() -> None:
    fitted = fit_kernel(
        *drawn(SquaredExponential(4.0, 12.0), 250, 7), SquaredExponential(1.0, 30.0), bounds=BOUNDS
    )
    # about 25 independent patches fix the variance to a quarter, and the length scale much better
    assert fitted.kernel.variance_m2 == pytest.approx(4.0, rel=0.5)
    assert fitted.kernel.length_scales_m[0] == pytest.approx(12.0, rel=0.1)


def test_finds_direction_and_ratio_of_the_anisotropy() -> None:
    points = drawn(SquaredExponential(4.0, 20.0, anisotropy=2.5, angle_deg=40.0), 200, 8)
    start = SquaredExponential(2.0, 20.0, anisotropy=1.3, angle_deg=10.0)
    kernel = fit_kernel(*points, start, bounds=BOUNDS).kernel
    assert isinstance(kernel, SquaredExponential)
    assert kernel.anisotropy == pytest.approx(2.5, rel=0.2)
    assert kernel.angle_deg == pytest.approx(40.0, abs=8.0)


def test_finds_understated_noise_and_a_nugget() -> None:
    xy, values, sigma = drawn(SquaredExponential(4.0, 15.0), 250, 9, sigma_m=0.3)
    scaled = fit_kernel(xy, values, sigma / 2, SquaredExponential(1.0, 15.0), with_noise_scale=True)
    assert scaled.noise_scale == pytest.approx(2.0, rel=0.15)
    nugget = fit_kernel(xy, values, sigma / 30, SquaredExponential(1.0, 15.0), with_nugget=True)
    assert np.sqrt(nugget.nugget_m2) == pytest.approx(0.3, rel=0.15)
    np.testing.assert_allclose(nugget.sigma_m(sigma / 30), 0.3, rtol=0.15)


def test_length_scales_stay_above_their_bound() -> None:
    rng = np.random.default_rng(10)
    xy = rng.uniform(0, 100, (60, 2))
    fitted = fit_kernel(
        xy, rng.standard_normal(60), np.full(60, 0.05), SquaredExponential(1.0, 20.0), shortest_length_m=6.0
    )
    assert fitted.kernel.length_scales_m[0] >= 6.0 * (1 - 1e-9)


def test_the_likelier_family_comes_first() -> None:
    smooth = choose_kernel(*drawn(SquaredExponential(4.0, 15.0), 150, 11), bounds=BOUNDS)
    assert isinstance(smooth[0].kernel, SquaredExponential)
    penalties = [fitted.penalized for fitted in smooth]
    assert penalties == sorted(penalties, reverse=True)
    rough = choose_kernel(*drawn(Matern32(4.0, 40.0), 150, 12, sigma_m=0.02), bounds=BOUNDS)
    assert isinstance(rough[0].kernel, Matern32 | Matern52)


def test_two_points_cannot_tell_a_length_scale() -> None:
    with pytest.raises(InputError, match="2 points cannot tell"):
        fit_kernel(np.eye(2), np.ones(2), np.ones(2), SquaredExponential(1.0, 1.0))

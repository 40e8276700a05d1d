"""Kernels with a landform scale, isotropic and anisotropic."""

import numpy as np
import pytest
from scipy.optimize import check_grad

from survey.core.arrays import FloatArray
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.families import Sum, parts_of
from survey.reconstruction.gp.kernels import Kernel, Matern32, SquaredExponential
from survey.reconstruction.gp.marginal_likelihood import KernelFit, with_landforms

SIGMA = 0.05
FAMILIES = ("two-scale-mixed",)


def drawn(kernel: Kernel, n: int, seed: int = 1) -> tuple[FloatArray, FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0.0, 300.0, (n, 2))
    root = np.linalg.cholesky(kernel.covariance(xy, xy) + 1e-9 * np.eye(n))
    return xy, root @ rng.standard_normal(n) + SIGMA * rng.standard_normal(n), np.full(n, SIGMA**2)


def test_the_gradient_of_an_anisotropic_kernel_is_that_of_its_likelihood() -> None:
    start = Sum(SquaredExponential(3.0, 60.0, 4.0, 35.0), Matern32(0.3, 12.0, 2.0, -20.0))
    fit = KernelFit.of(*drawn(start, 40), None)
    theta = np.append(start.log_parameters, np.log(0.01))
    error = check_grad(
        lambda at: fit._negative(at, start)[0], lambda at: fit._negative(at, start)[1], theta, epsilon=1e-6
    )
    assert error < 1e-3 * np.linalg.norm(fit._negative(theta, start)[1])


def test_the_gradient_has_an_entry_for_each_parameter_at_a_stretch_of_1() -> None:
    start = Sum(SquaredExponential(3.0, 60.0, 4.0, 35.0), Matern32(0.3, 12.0, 2.0, -20.0))
    theta = np.append(start.log_parameters, np.log(0.01))
    theta[[2, 6]] = 0.0
    assert KernelFit.of(*drawn(start, 40), None)._negative(theta, start)[1].shape == theta.shape


def test_ridges_are_found_with_their_direction() -> None:
    found = with_landforms(
        *drawn(SquaredExponential(4.0, 200.0, 8.0, 30.0), 200), GaussianProcessConfig(), candidates=FAMILIES
    )
    first = found[0].kernel
    assert isinstance(first, Sum)
    ridge = first.parts[0]
    assert isinstance(ridge, SquaredExponential)
    stretch, angle = ridge.anisotropy, ridge.angle_deg
    if stretch < 1.0:
        stretch, angle = 1.0 / stretch, angle + 90.0
    assert stretch > 3.0
    assert abs((angle - 30.0 + 90.0) % 180.0 - 90.0) < 10.0


@pytest.mark.parametrize("seed", [1, 2])
def test_the_limits_of_a_length_hold_for_the_longer_direction_of_a_stretched_kernel(seed: int) -> None:
    rng = np.random.default_rng(seed)
    along = np.tile(np.linspace(0.0, 480.0, 50), 4) + rng.normal(0.0, 3.0, 200)
    xy = np.column_stack([along, np.repeat([60.0, 180.0, 300.0, 420.0], 50) + rng.normal(0.0, 5.0, 200)])
    ridges = SquaredExponential(9.0, 240.0, 10.0, float(rng.uniform(0.0, 180.0))).covariance(xy, xy)
    z = rng.multivariate_normal(np.zeros(200), ridges + 1e-6 * np.eye(200), method="cholesky")
    z += SIGMA * rng.standard_normal(200)
    from_middle = xy - xy.mean(axis=0)
    found = with_landforms(
        xy,
        z,
        np.full(200, SIGMA**2),
        GaussianProcessConfig(),
        lambda part: from_middle[part] @ from_middle[part].T,
        candidates=FAMILIES,
    )
    extent = float(np.ptp(xy, axis=0).max())
    assert parts_of(found[0].kernel)[0].length_scales_m[0] == pytest.approx(24.0, abs=5.0)
    for one in found:
        landforms, *others = parts_of(one.kernel)
        assert landforms.length_scales_m[1] <= 1.5 * extent * 1.001
        assert all(part.length_scales_m[1] <= 0.5 * extent * 1.001 for part in others)


def test_isotropic_ground_has_no_strong_direction() -> None:
    found = with_landforms(
        *drawn(SquaredExponential(4.0, 50.0), 150), GaussianProcessConfig(), candidates=FAMILIES
    )
    assert len(found) == 2
    assert found[0].kernel.length_scales_m[1] < 150.0


def test_the_longest_scale_is_a_share_of_the_site() -> None:
    xy, z, noise = drawn(Matern32(1.0, 4.0), 150)
    found = with_landforms(xy, z, noise, GaussianProcessConfig(), candidates=FAMILIES)
    for one in found:
        assert isinstance(one.kernel, Sum)
        assert one.kernel.parts[0].length_scales_m[1] >= 0.08 * 0.9 * 300.0


def test_smooth_ground_has_fewer_effective_points_than_points() -> None:
    xy, z, noise = drawn(SquaredExponential(4.0, 100.0), 150)
    (found,) = with_landforms(
        xy, z, noise, GaussianProcessConfig(family="squared-exponential"), candidates=FAMILIES
    )
    assert 1.0 < found.n_points < 30.0
    rough = with_landforms(
        xy,
        np.random.default_rng(1).normal(size=150),
        noise,
        GaussianProcessConfig(family="squared-exponential"),
        candidates=FAMILIES,
    )[0]
    assert rough.n_points > 60.0


def test_the_result_does_not_depend_on_the_run() -> None:
    data = drawn(SquaredExponential(4.0, 60.0, 3.0, 10.0), 100)
    one, two = (with_landforms(*data, GaussianProcessConfig(), candidates=FAMILIES)[0] for _ in range(2))
    np.testing.assert_array_equal(one.kernel.log_parameters, two.kernel.log_parameters)
    assert one.score == pytest.approx(two.score, abs=0.0)


def test_kernels_of_points_along_one_line_are_isotropic() -> None:
    xy, z, noise = drawn(SquaredExponential(4.0, 200.0, 8.0, 30.0), 200)
    along = np.abs(xy[:, 1] - 150.0) < 30.0
    found = with_landforms(xy[along], z[along], noise[along], GaussianProcessConfig(), candidates=FAMILIES)
    assert [part.anisotropy for one in found for part in one.kernel.parts] == [1.0, 1.0]

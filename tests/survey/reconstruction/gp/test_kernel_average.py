"""Kernels with weights: gradient of their posterior, direction of the relief, moments of the average."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from survey.core import FloatArray
from survey.reconstruction.gp.averaged_process import AveragedProcess
from survey.reconstruction.gp.engines.regression import DenseGaussianProcess
from survey.reconstruction.gp.families import parts_of
from survey.reconstruction.gp.kernel_average import (
    MEMBERS,
    Member,
    _Posterior,
    averaged_kernels,
    lightened,
    weights_of,
)
from survey.reconstruction.gp.kernels import Exponential, Kernel, Matern32, Stationary, Whittle

SIGMA_M = 0.05


def drawn(kernel: Kernel, seed: int, n: int = 300) -> tuple[FloatArray, FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0.0, 200.0, (n, 2))
    root = np.linalg.cholesky(kernel.covariance(xy, xy) + 1e-9 * np.eye(n))
    return xy, root @ rng.standard_normal(n) + SIGMA_M * rng.standard_normal(n), np.full(n, SIGMA_M**2)


@pytest.mark.parametrize("member", MEMBERS, ids=lambda one: "-".join(kind.family for kind in one.parts))
@pytest.mark.parametrize("has_plane", [False, True])
def test_the_gradient_is_that_of_the_posterior(member: Member, has_plane: bool) -> None:
    xy, values, noise = drawn(Matern32(4.0, 40.0), 1, 50)
    few = _Posterior.of(xy, values + 0.1 * xy[:, 0], noise, has_plane=has_plane, nugget_m=None)
    mean, _ = few._prior(member)
    theta = mean + 0.2 * np.random.default_rng(2).standard_normal(len(mean))
    by_steps = approx_fprime(theta, lambda at: few._negative(at, member)[0], 1e-6)
    np.testing.assert_allclose(few._negative(theta, member)[1], by_steps, rtol=2e-4, atol=2e-3)


def test_the_likelihood_is_that_of_the_engine() -> None:
    xy, values, noise = drawn(Whittle(4.0, 40.0), 3, 60)
    few = _Posterior.of(xy, values, noise, has_plane=False, nugget_m=0.1)
    member = Member((Whittle,), True)
    theta = np.array([np.log(3.0), np.log(50.0), 0.3, -0.2, 0.0])
    from survey.reconstruction.gp.kernel_average import _kernel

    engine = DenseGaussianProcess.fit(
        xy, values, np.sqrt(noise + 0.1**2), _kernel(theta, member), trend="constant"
    )
    # The engine's log marginal likelihood integrates the constant out, too.
    assert -few._negative(theta, member)[0] == pytest.approx(engine.log_marginal_likelihood, abs=1e-6)


def test_the_direction_of_ridges_is_found() -> None:
    ridges = Matern32(4.0, 60.0, anisotropy=4.0, angle_deg=30.0)
    found = averaged_kernels(*drawn(ridges, 4))
    longest = parts_of(found.kernel)[0]
    assert isinstance(longest, Stationary)
    assert longest.anisotropy == pytest.approx(4.0, rel=0.3)
    assert longest.angle_deg == pytest.approx(30.0, abs=6.0)
    assert all(one.kernel.parameters().get("anisotropy", 4.0) != 1.0 for one in found.average[:2])


def test_a_single_line_gives_isotropic_kernels_alone() -> None:
    x = np.linspace(0.0, 200.0, 80)
    xy, values = np.column_stack([x, np.zeros_like(x)]), np.sin(x / 20.0)
    found = averaged_kernels(xy, values, np.full(80, 0.01))
    assert {one.kernel.length_scales_m[0] for one in found.average} == {
        one.kernel.length_scales_m[1] for one in found.average
    }


def test_weights_sum_to_one_and_little_ones_are_left_out() -> None:
    weights = weights_of(np.array([0.0, -10.0, -200.0]))
    assert weights.sum() == pytest.approx(1.0)
    assert weights[0] / weights[1] == pytest.approx(np.exp(0.5))
    assert weights[2] == 0.0
    found = averaged_kernels(*drawn(Matern32(4.0, 40.0), 5))
    assert sum(one.weight for one in lightened(list(found.average), 2)) == pytest.approx(1.0)
    assert found.nugget_m**2 == pytest.approx(sum(one.weight * one.nugget_m**2 for one in found.average))


def test_equal_points_give_equal_kernels() -> None:
    data = drawn(Exponential(4.0, 40.0), 6)
    assert averaged_kernels(*data) == averaged_kernels(*data)


def test_the_average_has_the_moments_of_a_mixture() -> None:
    xy, values, noise = drawn(Matern32(4.0, 40.0), 7, 60)
    parts = [
        DenseGaussianProcess.fit(xy, values, np.sqrt(noise + n), kernel, trend="constant")
        for kernel, n in ((Matern32(4.0, 40.0), 0.0), (Exponential(4.0, 20.0), 0.01))
    ]
    weights = np.array([0.7, 0.3])
    average = AveragedProcess(tuple(parts), weights, np.array([0.0, 0.01]), (None, None))
    places = np.random.default_rng(8).uniform(0.0, 200.0, (20, 2))
    mean, variance = average.predict(places)
    means, variances = (
        np.array(rows) for rows in zip(*(part.predict(places) for part in parts), strict=True)
    )
    np.testing.assert_allclose(mean, weights @ means)
    np.testing.assert_allclose(variance, weights @ (variances + means**2) - mean**2, atol=1e-9)
    np.testing.assert_allclose(np.diag(average.joint_covariance(places)), variance, rtol=1e-8)
    x, y = np.linspace(0.0, 200.0, 4), np.linspace(0.0, 200.0, 3)
    on_axes = average.predict_on_axes(x, y)
    of_nodes = average.predict(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    np.testing.assert_allclose(on_axes[0].ravel(), of_nodes[0])
    np.testing.assert_allclose(on_axes[1].ravel() ** 2, of_nodes[1], rtol=1e-9)
    assert average.weighted_sum(places, np.ones(20))[1] == pytest.approx(
        np.sqrt(average.joint_covariance(places).sum()), rel=1e-9
    )


def test_an_update_is_the_average_given_all_points() -> None:
    xy, values, noise = drawn(Matern32(4.0, 40.0), 9, 60)
    kernels, nuggets_m2 = (Matern32(4.0, 40.0), Exponential(4.0, 20.0)), np.array([0.0, 0.01])

    def average(n: int) -> AveragedProcess:
        parts = [
            DenseGaussianProcess.fit(xy[:n], values[:n], np.sqrt(noise[:n] + m2), kernel)
            for kernel, m2 in zip(kernels, nuggets_m2, strict=True)
        ]
        return AveragedProcess(tuple(parts), np.array([0.6, 0.4]), nuggets_m2, (None, None))

    sigma_m = np.sqrt(noise[50:] + 0.4 * 0.01)
    places = np.random.default_rng(10).uniform(0.0, 200.0, (9, 2))
    updated = average(50).update(xy[50:], values[50:], sigma_m)
    for one, other in zip(updated.predict(places), average(60).predict(places), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-10)


def test_patches_share_the_site_and_hold_what_differs() -> None:
    rng = np.random.default_rng(11)
    xy = rng.uniform(0.0, 200.0, (600, 2))
    rough = np.where(xy[:, 0] > 100.0, 2.0, 0.1)
    root = np.linalg.cholesky(Matern32(1.0, 15.0).covariance(xy, xy) + 1e-9 * np.eye(600))
    values = rough * (root @ rng.standard_normal(600)) + SIGMA_M * rng.standard_normal(600)
    noise = np.full(600, SIGMA_M**2)
    found = averaged_kernels(xy, values, noise, has_patches=True)
    local = [one for one in found.average if one.patch is not None]
    assert len(local) == 8
    shares = np.sum([one.patch.share(xy) for one in local if one.patch is not None], axis=0)
    np.testing.assert_allclose(shares, 2.0)
    variance = {one.patch.number: one.kernel.variance_m2 for one in local[:4] if one.patch is not None}
    assert min(variance[1], variance[3]) > 1.5 * max(variance[0], variance[2])
    parts = tuple(
        DenseGaussianProcess.fit(xy, values, np.sqrt(noise + one.nugget_m**2), one.kernel, trend="constant")
        for one in local[:4]
    )
    weights, nuggets = np.full(4, 1.0), np.array([one.nugget_m**2 for one in local[:4]])
    average = AveragedProcess(parts, weights, nuggets, tuple(one.patch for one in local[:4]))
    places = rng.uniform(0.0, 200.0, (30, 2))
    mean, variance_m2 = average.predict(places)
    covariance = average.joint_covariance(places)
    np.testing.assert_allclose(np.diag(covariance), variance_m2, rtol=1e-8)
    assert np.linalg.eigvalsh(covariance).min() > -1e-9
    total = average.weighted_sum(places, np.ones(30))
    assert total[0] == pytest.approx(mean.sum())
    assert total[1] == pytest.approx(np.sqrt(covariance.sum()), rel=1e-6)
    step = np.array([0.2, 0.0])
    rise = (average.predict(places + step)[0] - average.predict(places - step)[0]) / 0.4
    np.testing.assert_allclose(average.gradient(places)[:, 0], rise, atol=0.02)
    x = np.linspace(10.0, 190.0, 5)
    drawn = average.sample_on_axes(x, x, 3000, np.random.default_rng(12))
    np.testing.assert_allclose(drawn.std(axis=0), average.predict_on_axes(x, x)[1], rtol=0.15)


def test_few_points_have_no_patches() -> None:
    found = averaged_kernels(*drawn(Matern32(4.0, 40.0), 13, 80), has_patches=True)
    assert all(one.patch is None for one in found.average)

"""The Fourier engine: the closed form, the dense factorization, and everything that comes out of one inverse."""

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from survey.core.arrays import FloatArray
from survey.core.errors import CapacityError, InputError
from survey.reconstruction.gp.engines.fourier_gp import FourierGaussianProcess
from survey.reconstruction.gp.engines.regression import TrendName
from survey.reconstruction.gp.families import Sum
from survey.reconstruction.gp.fit import steepness_on_axes
from survey.reconstruction.gp.kernels import Kernel, Matern32, Matern52, RationalQuadratic, SquaredExponential

BOUNDS = (0.0, 0.0, 100.0, 100.0)
AXIS = np.linspace(0.0, 100.0, 26)
NODES = np.stack(np.meshgrid(AXIS, AXIS), axis=-1).reshape(-1, 2)
KERNEL = SquaredExponential(4.0, 12.0)
SMOOTH: list[Kernel] = [
    KERNEL,
    SquaredExponential(4.0, 20.0, anisotropy=2.0, angle_deg=30.0),
    Sum(SquaredExponential(4.0, 30.0), SquaredExponential(0.2, 12.0)),
]

Points = tuple[FloatArray, FloatArray, FloatArray]


def name(kernel: Kernel) -> str:
    return type(kernel).__name__


def steepness(gp: FourierGaussianProcess, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    return steepness_on_axes(gp, x, y, np.zeros((len(x) * len(y), 2)))


@pytest.fixture(scope="module")
def points() -> Points:
    rng = np.random.default_rng(0)
    xy = rng.uniform(0, 100, (120, 2))
    sigma = rng.uniform(0.05, 0.3, 120)
    return xy, 2 * np.sin(xy[:, 0] / 12) + 0.03 * xy[:, 1] + sigma * rng.standard_normal(120), sigma


def exact(
    kernel: Kernel, points: Points, places: FloatArray, trend: TrendName = "none"
) -> tuple[FloatArray, FloatArray, float]:
    """Mean, variance and log marginal likelihood by the equations as they stand."""
    xy, y, sigma = points
    columns = {"none": 0, "constant": 1, "plane": 3}[trend]
    P, P_star = (np.column_stack([np.ones(len(p)), (p - 50) / 50])[:, :columns] for p in (xy, places))
    V = kernel.covariance(xy, xy) + np.diag(sigma**2)
    cross = kernel.covariance(places, xy)
    information = P.T @ np.linalg.solve(V, P)
    beta = np.linalg.solve(information, P.T @ np.linalg.solve(V, y))
    weighted = np.linalg.solve(V, y - P @ beta)
    gap = P_star - cross @ np.linalg.solve(V, P)
    mean = cross @ weighted + P_star @ beta
    variance = kernel.variance_m2 - np.sum(cross * np.linalg.solve(V, cross.T).T, axis=1)
    variance = variance + np.sum(gap * np.linalg.solve(information, gap.T).T, axis=1)
    likelihood = -0.5 * ((y - P @ beta) @ weighted + np.linalg.slogdet(V)[1])
    return mean, variance, float(likelihood - 0.5 * (len(y) - columns) * np.log(2 * np.pi))


def test_one_point_pulls_the_mean_by_the_ratio_of_variances() -> None:
    gp = FourierGaussianProcess.fit(
        np.array([[50.0, 50.0]]), np.array([3.0]), np.array([1.0]), KERNEL, bounds=BOUNDS
    )
    mean, variance = gp.predict(np.array([[50.0, 50.0], [50.0, 62.0]]))
    share = 4.0 / (4.0 + 1.0)
    # the tolerance of the engine, 1 mm for the mean and 0.1 mm for the standard deviation
    np.testing.assert_allclose(mean, [3 * share, 3 * share * np.exp(-0.5)], atol=1e-3)
    np.testing.assert_allclose(np.sqrt(variance), np.sqrt([4 * (1 - share), 4 - 4 * share / np.e]), atol=1e-4)


def test_three_points_agree_with_the_closed_form() -> None:
    xy = np.array([[20.0, 20.0], [30.0, 20.0], [60.0, 80.0]])
    data = xy, np.array([1.0, 2.0, -1.0]), np.array([0.1, 0.5, 0.2])
    gp = FourierGaussianProcess.fit(*data, KERNEL, bounds=BOUNDS)
    mean, std = gp.predict_on_axes(AXIS, AXIS)
    expected, variance, likelihood = exact(KERNEL, data, NODES)
    np.testing.assert_allclose(mean.ravel(), expected, atol=1e-3)
    np.testing.assert_allclose(std.ravel(), np.sqrt(variance), atol=1e-4)
    assert gp.log_marginal_likelihood == pytest.approx(likelihood, abs=1e-3)


def test_agrees_with_scikit_learn(points: Points) -> None:
    xy, y, sigma = points
    peer = GaussianProcessRegressor(ConstantKernel(4.0) * RBF(12.0), alpha=sigma**2, optimizer=None).fit(
        xy, y
    )
    expected, expected_std = peer.predict(NODES, return_std=True)
    gp = FourierGaussianProcess.fit(*points, KERNEL, bounds=BOUNDS)
    mean, std = gp.predict_on_axes(AXIS, AXIS)
    np.testing.assert_allclose(mean.ravel(), expected, atol=1e-3)
    np.testing.assert_allclose(std.ravel(), expected_std, atol=1e-4)
    assert gp.log_marginal_likelihood == pytest.approx(float(peer.log_marginal_likelihood_value_), abs=0.01)


@pytest.mark.parametrize("trend", ["none", "constant", "plane"])
@pytest.mark.parametrize("kernel", SMOOTH, ids=name)
def test_agrees_with_the_dense_equations(points: Points, kernel: Kernel, trend: TrendName) -> None:
    gp = FourierGaussianProcess.fit(*points, kernel, bounds=BOUNDS, trend=trend)
    assert gp.resolution.is_met
    expected, variance, _ = exact(kernel, points, NODES, trend)
    mean, std = gp.predict_on_axes(AXIS, AXIS)
    np.testing.assert_allclose(mean.ravel(), expected, atol=1e-3)
    np.testing.assert_allclose(std.ravel(), np.sqrt(variance), atol=1e-4)
    at_points = gp.predict(NODES)
    # two ways to sum one series: rounding
    np.testing.assert_allclose(at_points[0], mean.ravel(), atol=1e-9)
    np.testing.assert_allclose(np.sqrt(at_points[1]), std.ravel(), atol=1e-9)


def test_a_tighter_tolerance_gives_a_smaller_error(points: Points) -> None:
    expected, variance, _ = exact(KERNEL, points, NODES)
    errors = []
    for tolerance in (1e-1, 1e-2, 1e-3, 1e-4):
        gp = FourierGaussianProcess.fit(*points, KERNEL, bounds=BOUNDS, tolerance_m=tolerance)
        mean, std = gp.predict_on_axes(AXIS, AXIS)
        error = np.abs(mean.ravel() - expected).max(), np.abs(std.ravel() - np.sqrt(variance)).max()
        assert error[0] <= tolerance
        assert error[1] <= 0.1 * tolerance
        errors.append(error)
    assert errors == sorted(errors, reverse=True)


@pytest.mark.parametrize("kernel", [Matern52(4.0, 25.0), Matern32(4.0, 25.0)], ids=name)
def test_rough_kernels_keep_the_mean_and_overstate_the_deviation_beside_points(
    points: Points, kernel: Kernel
) -> None:
    gp = FourierGaussianProcess.fit(*points, kernel, bounds=BOUNDS, memory_mb=20.0)
    assert not gp.resolution.is_met
    expected, variance, _ = exact(kernel, points, NODES)
    mean, std = gp.predict_on_axes(AXIS, AXIS)
    # the waves of the mean reach 16 times further than those of the covariance
    np.testing.assert_allclose(mean.ravel(), expected, atol=1e-3)
    # the discarded relief counts as noise of no extent, once at the points and once at the node: beside a point
    # it is counted twice where it should not count at all; in the gaps it is right
    assert np.abs(std.ravel() ** 2 - variance).max() < 2.5 * gp.resolution.tail_m2
    assert np.median(std.ravel() / np.sqrt(variance)) == pytest.approx(1.0, abs=0.02)


def test_a_heavy_tailed_kernel_agrees_to_a_few_millimetres(points: Points) -> None:
    kernel = RationalQuadratic(4.0, 12.0, shape=3.0)
    gp = FourierGaussianProcess.fit(*points, kernel, bounds=BOUNDS)
    expected, variance, _ = exact(kernel, points, NODES)
    mean, std = gp.predict_on_axes(AXIS, AXIS)
    # images of the site that the box's margin does not shut out
    np.testing.assert_allclose(mean.ravel(), expected, atol=5e-3)
    np.testing.assert_allclose(std.ravel(), np.sqrt(variance), atol=5e-3)


def test_far_from_every_point_the_prior_returns() -> None:
    gp = FourierGaussianProcess.fit(
        np.array([[5.0, 5.0]]), np.array([4.0]), np.array([0.1]), KERNEL, bounds=(0, 0, 200, 200)
    )
    mean, variance = gp.predict(np.array([[190.0, 190.0]]))
    assert mean[0] == pytest.approx(0.0, abs=1e-3)
    assert np.sqrt(variance[0]) == pytest.approx(2.0, abs=1e-4)


def test_a_point_more_never_raises_the_variance(points: Points) -> None:
    gp = FourierGaussianProcess.fit(*points, KERNEL, bounds=BOUNDS)
    _, before = gp.predict_on_axes(AXIS, AXIS)
    more = gp.update(np.array([[33.0, 71.0]]), np.array([0.3]), np.array([0.2]))
    _, after = more.predict_on_axes(AXIS, AXIS)
    assert (after - before).max() < 1e-9  # rounding
    assert (before - after).max() > 0.05


@pytest.mark.parametrize("trend", ["none", "plane"])
def test_updating_equals_refitting(points: Points, trend: TrendName) -> None:
    whole = FourierGaussianProcess.fit(*points, KERNEL, bounds=BOUNDS, trend=trend)
    first, second, third = (
        tuple(column[part] for column in points) for part in (slice(0, 80), slice(80, 100), slice(100, 120))
    )
    part = FourierGaussianProcess.fit(*first, KERNEL, trend=trend, resolution=whole.resolution)
    updated = part.update(*second).update(*third)
    for one, other in zip(
        whole.predict_on_axes(AXIS, AXIS), updated.predict_on_axes(AXIS, AXIS), strict=True
    ):
        np.testing.assert_allclose(other, one, atol=1e-6)
    assert updated.log_marginal_likelihood == pytest.approx(whole.log_marginal_likelihood, abs=1e-6)
    for one, other in zip(steepness(whole, AXIS, AXIS), steepness(updated, AXIS, AXIS), strict=True):
        np.testing.assert_allclose(other, one, atol=1e-6)
    with pytest.raises(InputError, match="outside the site"):
        whole.update(np.array([[500.0, 0.0]]), np.zeros(1), np.ones(1))


def test_other_values_at_the_same_points_need_no_new_factor(points: Points) -> None:
    xy, y, sigma = points
    one = FourierGaussianProcess.fit(xy, y, sigma, KERNEL, bounds=BOUNDS)
    other = FourierGaussianProcess.fit(xy, y**2, sigma, KERNEL, bounds=BOUNDS)
    np.testing.assert_allclose(one.for_values(y**2).predict(xy)[0], other.predict(xy)[0], atol=1e-9)


@pytest.mark.parametrize("trend", ["none", "plane"])
def test_gradient_is_the_derivative_of_the_mean(points: Points, trend: TrendName) -> None:
    gp = FourierGaussianProcess.fit(*points, KERNEL, bounds=BOUNDS, trend=trend)
    places = np.array([[20.0, 30.0], [71.0, 55.0]])
    step = 1e-3 * np.eye(2)
    differences = [(gp.predict(places + e)[0] - gp.predict(places - e)[0]) / 2e-3 for e in step]
    # second-order error of a central difference over 1 mm
    np.testing.assert_allclose(gp.gradient(places), np.stack(differences, axis=-1), atol=1e-6)
    slope, _ = steepness(gp, np.array([20.0]), np.array([30.0]))
    assert slope[0, 0] == pytest.approx(float(np.hypot(*gp.gradient(places)[0])), abs=1e-9)


def test_slope_deviation_is_that_of_a_difference_of_neighbouring_heights(points: Points) -> None:
    gp = FourierGaussianProcess.fit(*points, KERNEL, bounds=BOUNDS)
    x, y = np.array([42.0]), np.array([37.0])
    slope, std = steepness(gp, x, y)
    direction = gp.gradient(np.array([[42.0, 37.0]]))[0] / slope[0, 0]
    pair = np.array([42.0, 37.0]) + 0.05 * np.array([direction, -direction])
    _, difference_std = gp.weighted_sum(pair, np.array([10.0, -10.0]))
    # third-order error of a difference over 0.1 m
    assert std[0, 0] == pytest.approx(difference_std, rel=1e-3)


def test_samples_have_the_moments_of_the_posterior(points: Points) -> None:
    gp = FourierGaussianProcess.fit(*points, KERNEL, bounds=BOUNDS, trend="constant", tolerance_m=1e-2)
    axis = np.linspace(5.0, 95.0, 7)
    n = 600
    samples = gp.sample_on_axes(axis, axis, n, np.random.default_rng(3))
    mean, std = gp.predict_on_axes(axis, axis)
    # four standard errors of the mean and of the standard deviation of n draws
    assert np.abs((samples.mean(axis=0) - mean) / std).max() < 4 / np.sqrt(n)
    assert np.abs(samples.std(axis=0) / std - 1).max() < 4 / np.sqrt(2 * n)
    again = gp.sample_on_axes(axis, axis, 1, np.random.default_rng(3))
    np.testing.assert_array_equal(again[0], samples[0])


@pytest.mark.parametrize("trend", ["none", "plane"])
def test_volume_and_its_deviation_agree_with_brute_force(points: Points, trend: TrendName) -> None:
    gp = FourierGaussianProcess.fit(*points, KERNEL, bounds=BOUNDS, trend=trend)
    inside = NODES[(NODES[:, 0] > 20) & (NODES[:, 0] < 60) & (NODES[:, 1] > 30) & (NODES[:, 1] < 50)]
    volume, std = gp.weighted_sum(inside, np.full(len(inside), 16.0))
    xy, _, sigma = points
    P, P_star = (
        np.column_stack([np.ones(len(p)), p]) if trend == "plane" else np.zeros((len(p), 0))
        for p in (xy, inside)
    )
    V = KERNEL.covariance(xy, xy) + np.diag(sigma**2)
    cross = KERNEL.covariance(inside, xy)
    gap = P_star - cross @ np.linalg.solve(V, P)
    covariance = KERNEL.covariance(inside, inside) - cross @ np.linalg.solve(V, cross.T)
    covariance = covariance + gap @ np.linalg.solve(P.T @ np.linalg.solve(V, P), gap.T)
    area = 16.0 * len(inside)
    # 0.1 mm over the polygon
    assert std == pytest.approx(16.0 * np.sqrt(covariance.sum()), abs=1e-4 * area)
    assert volume == pytest.approx(16.0 * gp.predict(inside)[0].sum(), rel=1e-9)


@pytest.mark.parametrize("trend", ["none", "plane"])
def test_leave_one_out_equals_leaving_one_out(points: Points, trend: TrendName) -> None:
    xy, y, sigma = points
    gp = FourierGaussianProcess.fit(*points, KERNEL, bounds=BOUNDS, trend=trend)
    mean, variance = gp.leave_one_out()
    for k in (0, 57, 119):
        rest = np.delete(np.arange(120), k)
        expected, without_noise, _ = exact(KERNEL, (xy[rest], y[rest], sigma[rest]), xy[k : k + 1], trend)
        assert mean[k] == pytest.approx(expected[0], abs=1e-3)
        assert np.sqrt(variance[k]) == pytest.approx(np.sqrt(without_noise[0] + sigma[k] ** 2), abs=1e-4)


def test_sites_may_be_oblong_and_far_from_the_origin(points: Points) -> None:
    xy, y, sigma = points
    moved = xy * [1.0, 0.4] + [552_000.0, 6_700_000.0]
    gp = FourierGaussianProcess.fit(moved, y, sigma, KERNEL)
    expected, variance, _ = exact(KERNEL, (xy * [1.0, 0.4], y, sigma), xy[:20] * [1.0, 0.4])
    mean, predicted = gp.predict(moved[:20])
    np.testing.assert_allclose(mean, expected, atol=1e-3)
    np.testing.assert_allclose(np.sqrt(predicted), np.sqrt(variance), atol=1e-4)


def test_repeated_points_average() -> None:
    xy = np.array([[50.0, 50.0]] * 4)
    many = FourierGaussianProcess.fit(
        xy, np.array([1.0, 2.0, 3.0, 4.0]), np.full(4, 0.4), KERNEL, bounds=BOUNDS
    )
    one = FourierGaussianProcess.fit(xy[:1], np.array([2.5]), np.array([0.2]), KERNEL, bounds=BOUNDS)
    for a, b in zip(many.predict(xy[:1]), one.predict(xy[:1]), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-4)


def test_too_many_waves_are_refused_before_anything_is_computed(points: Points) -> None:
    with pytest.raises(CapacityError, match=r"needs \d+ modes .* map it in tiles"):
        FourierGaussianProcess.fit(*points, SquaredExponential(4.0, 1.0), bounds=(0, 0, 2000, 2000))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda xy, y, s: (xy, y, -s), "standard deviation of point 0"),
        (lambda xy, y, s: (xy, y, 0 * s), "where a number above 0 was expected"),
        (lambda xy, y, s: (xy, y * np.nan, s), "NaN"),
        (lambda xy, y, s: (xy[:5], y, s), "shape"),
        (lambda xy, y, s: (xy[:0], y[:0], s[:0]), "no points"),
    ],
)
def test_bad_points_are_refused_in_one_sentence(points: Points, change, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=message):
        FourierGaussianProcess.fit(*change(*points), KERNEL, bounds=BOUNDS)


def test_places_outside_the_site_are_refused(points: Points) -> None:
    gp = FourierGaussianProcess.fit(*points, KERNEL, bounds=BOUNDS)
    with pytest.raises(InputError, match=r"1 places, the first at \(500.0, 0.0\)"):
        gp.predict(np.array([[50.0, 50.0], [500.0, 0.0]]))

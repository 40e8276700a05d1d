"""The dense process is the textbook's, to rounding."""

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern

from survey.core.arrays import FloatArray
from survey.core.errors import CapacityError, InputError
from survey.reconstruction.gp.engines.regression import DenseGaussianProcess
from survey.reconstruction.gp.families import Sum
from survey.reconstruction.gp.kernels import Kernel, Matern32, Matern52, SquaredExponential

KERNEL = SquaredExponential(9.0, 20.0)


@pytest.fixture
def points() -> tuple[FloatArray, FloatArray, FloatArray]:
    rng = np.random.default_rng(2)
    xy = rng.uniform(0.0, 100.0, (40, 2))
    return xy, 3.0 * np.sin(xy[:, 0] / 15.0) + 0.1 * rng.standard_normal(40), rng.uniform(0.1, 0.5, 40)


def test_three_points_have_the_closed_form() -> None:
    xy = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]])
    z, sigma = np.array([1.0, -2.0, 0.5]), np.array([0.1, 0.2, 0.3])
    place = np.array([[3.0, 4.0]])

    def k(a: FloatArray, b: FloatArray) -> FloatArray:
        squared = ((a[:, None] - b[None]) ** 2).sum(axis=2)
        result: FloatArray = 9.0 * np.exp(-0.5 * squared / 20.0**2)
        return result

    inverse = np.linalg.inv(k(xy, xy) + np.diag(sigma**2))
    mean, variance = DenseGaussianProcess.fit(xy, z, sigma, KERNEL).predict(place)
    # The inverse of a 3 × 3 matrix of condition 1e3 keeps 12 digits.
    np.testing.assert_allclose(mean, k(place, xy) @ inverse @ z, rtol=1e-10)
    np.testing.assert_allclose(variance, 9.0 - (k(place, xy) @ inverse @ k(xy, place))[0], rtol=1e-10)


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        (KERNEL, ConstantKernel(9.0) * RBF(20.0)),
        (Matern32(4.0, 30.0), ConstantKernel(4.0) * Matern(30.0, nu=1.5)),
        (Matern52(4.0, 30.0), ConstantKernel(4.0) * Matern(30.0, nu=2.5)),
        (
            Sum(SquaredExponential(9.0, 40.0), Matern32(1.0, 8.0)),
            ConstantKernel(9.0) * RBF(40.0) + ConstantKernel(1.0) * Matern(8.0, nu=1.5),
        ),
    ],
)
def test_equals_scikit_learn_with_noise_of_each_point(
    points: tuple[FloatArray, FloatArray, FloatArray], ours: Kernel, theirs: object
) -> None:
    xy, z, sigma = points
    peer = GaussianProcessRegressor(theirs, alpha=sigma**2, optimizer=None).fit(xy, z)
    places = np.random.default_rng(3).uniform(-20.0, 120.0, (50, 2))
    mean, std = peer.predict(places, return_std=True)
    gp = DenseGaussianProcess.fit(xy, z, sigma, ours)
    ours_mean, ours_variance = gp.predict(places)
    np.testing.assert_allclose(ours_mean, mean, atol=1e-8)
    np.testing.assert_allclose(np.sqrt(ours_variance), std, atol=1e-8)
    assert gp.log_marginal_likelihood == pytest.approx(peer.log_marginal_likelihood_value_, abs=1e-8)


def test_far_away_it_returns_the_prior(points: tuple[FloatArray, FloatArray, FloatArray]) -> None:
    mean, variance = DenseGaussianProcess.fit(*points, KERNEL).predict(np.array([[5000.0, 5000.0]]))
    assert mean[0] == 0.0
    assert variance[0] == 9.0


def test_an_update_equals_a_refit(points: tuple[FloatArray, FloatArray, FloatArray]) -> None:
    first, rest = ([part[:30] for part in points], [part[30:] for part in points])
    places = np.random.default_rng(4).uniform(0.0, 100.0, (20, 2))
    grown = DenseGaussianProcess.fit(*first, KERNEL, trend="constant").update(*rest)
    whole = DenseGaussianProcess.fit(*points, KERNEL, trend="constant")
    for one, two in zip(grown.predict(places), whole.predict(places), strict=True):
        # Rounding of two orders of elimination.
        np.testing.assert_allclose(one, two, atol=1e-9)


@pytest.mark.parametrize("trend", ["none", "constant", "plane"])
def test_leave_one_out_equals_leaving_each_out(
    points: tuple[FloatArray, FloatArray, FloatArray], trend: str
) -> None:
    xy, z, sigma = points
    mean, variance = DenseGaussianProcess.fit(xy, z, sigma, KERNEL, trend=trend).leave_one_out()
    for k in (0, 7, 39):
        others = np.arange(40) != k
        gp = DenseGaussianProcess.fit(xy[others], z[others], sigma[others], KERNEL, trend=trend)
        expected, spread = gp.predict(xy[k : k + 1])
        assert mean[k] == pytest.approx(expected[0], abs=1e-8)
        assert variance[k] == pytest.approx(spread[0] + sigma[k] ** 2, abs=1e-8)


def test_a_plane_is_found_under_the_terrain() -> None:
    rng = np.random.default_rng(5)
    xy = rng.uniform(0.0, 100.0, (60, 2))
    gp = DenseGaussianProcess.fit(
        xy, 7.0 + 0.3 * xy[:, 0] - 0.2 * xy[:, 1], np.full(60, 0.01), KERNEL, trend="plane"
    )
    places = np.array([[500.0, 300.0]])
    # Far away only the plane is left; it is exact but for the points' errors of a centimetre.
    assert gp.predict(places)[0][0] == pytest.approx(7.0 + 150.0 - 60.0, abs=0.05)


def test_slope_and_its_variance_are_those_of_differences(
    points: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    gp = DenseGaussianProcess.fit(*points, KERNEL)
    place, arm = np.array([[40.0, 60.0]]), np.array([0.05, 0.0])
    ends = np.vstack([place + arm, place - arm])
    mean, _ = gp.predict(ends)
    assert gp.gradient(place)[0, 0] == pytest.approx((mean[0] - mean[1]) / 0.1, rel=1e-5)
    joint = gp.covariance(ends, ends)
    difference = (joint[0, 0] + joint[1, 1] - 2 * joint[0, 1]) / 0.1**2
    # Both are differences: over 0.1 m and 0.4 m of a 20 m length scale, so 1e-4 apart.
    assert gp.derivative_variance(place, np.array([1.0, 0.0]))[0] == pytest.approx(difference, rel=1e-3)


def test_a_sum_has_the_variance_of_its_joint_distribution(
    points: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    gp = DenseGaussianProcess.fit(*points, KERNEL, trend="constant")
    places, weights = np.random.default_rng(6).uniform(0, 100, (30, 2)), np.linspace(0.5, 2.0, 30)
    total, std = gp.weighted_sum(places, weights)
    assert total == pytest.approx(float(weights @ gp.predict(places)[0]))
    assert std**2 == pytest.approx(float(weights @ gp.covariance(places, places) @ weights), rel=1e-8)


def test_samples_have_the_posterior_mean_and_spread(
    points: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    gp = DenseGaussianProcess.fit(*points, KERNEL)
    places = np.array([[50.0, 50.0], [130.0, 130.0]])
    drawn = gp.sample(places, 4000, np.random.default_rng(7))
    mean, variance = gp.predict(places)
    # Four standard errors of 4,000 draws.
    np.testing.assert_allclose(drawn.mean(axis=0), mean, atol=4 * np.sqrt(variance.max() / 4000))
    np.testing.assert_allclose(drawn.var(axis=0), variance, rtol=4 * np.sqrt(2 / 4000))


def test_ten_million_points_are_refused_before_any_work() -> None:
    with pytest.raises(CapacityError, match="1600000000 MB"):
        DenseGaussianProcess.fit(np.zeros((10_000_000, 2)), np.zeros(10_000_000), np.ones(10_000_000), KERNEL)


def test_repeated_points_without_noise_to_speak_of_are_refused() -> None:
    with pytest.raises(InputError, match="positive definite"):
        DenseGaussianProcess.fit(np.zeros((3, 2)), np.zeros(3), np.full(3, 1e-12), KERNEL)

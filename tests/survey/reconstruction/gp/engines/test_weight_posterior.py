"""Posterior of the Fourier weights, against dense linear algebra on a few waves."""

import numpy as np
import pytest

from survey.reconstruction.gp.engines.fourier_basis import FourierBasis, FourierBox
from survey.reconstruction.gp.engines.fourier_weights import MeanSystem, WeightPosterior, inner

BOX = FourierBox(np.array([50.0, 30.0]), np.array([140.0, 100.0]))
# A half plane: (0, 0) first, then q above 0 at p = 0, then all q.
LATTICE = np.array([(p, q) for p in range(4) for q in range(-3, 4) if p > 0 or q >= 0])
BASIS = FourierBasis.of(BOX, LATTICE)


@pytest.fixture
def amplitudes(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(0.2, 2.0, len(LATTICE))


@pytest.fixture
def points(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform((0.0, 0.0), (100.0, 60.0), (40, 2))


@pytest.fixture
def noise_m2(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(0.05, 0.5, 40)


def waves(xy: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
    """Return the cosines and sines of the waves at places, times their amplitudes."""
    phase = (xy - BOX.centre_m) * (2 * np.pi / BOX.period_m) @ LATTICE.T
    return np.hstack([np.cos(phase) * amplitudes, np.sin(phase[:, 1:]) * amplitudes[1:]])


def posterior(xy: np.ndarray, noise_m2: np.ndarray, amplitudes: np.ndarray) -> WeightPosterior:
    half_p, half_q = BASIS.half
    gram = BOX.transform(xy, 1.0 / noise_m2, (2 * half_p, 2 * half_q))
    return WeightPosterior.given(BASIS, amplitudes, gram)


def dense_covariance(xy: np.ndarray, noise_m2: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
    features = waves(xy, amplitudes)
    return np.linalg.inv(np.eye(BASIS.n_modes) + features.T @ (features / noise_m2[:, None]))


def test_features_are_the_waves(points: np.ndarray, noise_m2: np.ndarray, amplitudes: np.ndarray) -> None:
    features = posterior(points, noise_m2, amplitudes).features(points)
    np.testing.assert_allclose(features, waves(points, amplitudes), atol=1e-12)


def test_the_covariance_is_the_inverse_of_prior_and_data(
    points: np.ndarray, noise_m2: np.ndarray, amplitudes: np.ndarray
) -> None:
    found = posterior(points, noise_m2, amplitudes)
    expected = dense_covariance(points, noise_m2, amplitudes)
    np.testing.assert_allclose(np.tril(found.covariance), np.tril(expected), atol=1e-9)
    np.testing.assert_allclose(found.diagonal, np.diag(expected), atol=1e-9)
    assert found.log_determinant == pytest.approx(-np.linalg.slogdet(expected)[1], rel=1e-9)
    vector = np.arange(BASIS.n_modes, dtype=float)
    np.testing.assert_allclose(found.times(vector), expected @ vector, atol=1e-7)


def test_the_map_of_the_variance_is_that_of_the_weights(
    points: np.ndarray, noise_m2: np.ndarray, amplitudes: np.ndarray
) -> None:
    found = posterior(points, noise_m2, amplitudes)
    x, y = np.linspace(0.0, 100.0, 7), np.linspace(0.0, 60.0, 5)
    nodes = np.column_stack([axis.ravel() for axis in np.meshgrid(x, y)])
    features = waves(nodes, amplitudes)
    covariance = dense_covariance(points, noise_m2, amplitudes)
    expected = np.einsum("nm,mk,nk->n", features, covariance, features).reshape(5, 7)
    on_axes = BOX.evaluate_on_axes(x, y, found.variance_coefficients())
    np.testing.assert_allclose(on_axes, expected, rtol=1e-8)


def test_later_points_count_as_if_they_had_been_there(
    points: np.ndarray, noise_m2: np.ndarray, amplitudes: np.ndarray
) -> None:
    early = posterior(points[:30], noise_m2[:30], amplitudes)
    updated, complete = early.updated(points[30:], noise_m2[30:]), posterior(points, noise_m2, amplitudes)
    assert updated.log_determinant == pytest.approx(complete.log_determinant, rel=1e-9)
    np.testing.assert_allclose(updated.diagonal, complete.diagonal, atol=1e-9)
    x, y = np.linspace(0.0, 100.0, 7), np.linspace(0.0, 60.0, 5)
    maps = [BOX.evaluate_on_axes(x, y, one.variance_coefficients()) for one in (updated, complete)]
    np.testing.assert_allclose(*maps, rtol=1e-8)


@pytest.mark.parametrize(("size", "error"), [(1e-12, 1e-6), (1.0, np.inf)])
def test_an_energy_below_zero_is_rounding_or_no_convergence(
    points: np.ndarray, noise_m2: np.ndarray, amplitudes: np.ndarray, size: float, error: float
) -> None:
    half_p, half_q = BASIS.half
    gram = BOX.transform(points, 1.0 / noise_m2, (2 * half_p, 2 * half_q))
    system = MeanSystem.of(BASIS, amplitudes**2, gram)
    side = system.right_hand_side(BOX.transform(points, 1.0 / noise_m2, BASIS.half))
    start = np.zeros_like(side)
    negative = size / inner(side, side)
    found = system.solve(side, lambda residual: -negative * residual, 1e-5, start)[1]
    assert found == pytest.approx(error)

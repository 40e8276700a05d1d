"""Exact Gaussian-process regression by one dense Cholesky factorization: the oracle, and the engine for few points."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize

from survey.arrays import FloatArray
from survey.errors import CapacityError, InputError
from survey.reconstruction.kernels import Kernel

_BLOCK = 2000


@dataclass(frozen=True)
class DenseGaussianProcess:
    r"""Posterior of a zero-mean Gaussian process, by the equations as they stand (Eqs. 4–6, 9).

    .. math::  \mu_* = K_{*X} (K_{XX} + D)^{-1} r, \qquad
               \Sigma_* = K_{**} - K_{*X} (K_{XX} + D)^{-1} K_{X*}

    Parameters
    ----------
    kernel : Kernel
        Any covariance function.
    memory_mb : float
        What the matrix of covariances may take.

    Notes
    -----
    Memory grows with N², work with N³ (and N² per place asked for): meant for some
    thousands of points, and as the standard by which faster engines are judged.

    Examples
    --------
    >>> from survey.reconstruction.kernels import SquaredExponential
    >>> xy = np.array([[0.0, 0.0]])
    >>> gp = DenseGaussianProcess(SquaredExponential(4.0, 10.0)).fit(xy, np.array([1.0]), np.array([4.0]))
    >>> [part.tolist() for part in gp.predict(xy)]
    [[0.5], [2.0]]
    """

    kernel: Kernel
    memory_mb: float = 2000.0
    _xy: FloatArray = field(default_factory=lambda: np.zeros((0, 2)), repr=False)
    _noise: FloatArray = field(default_factory=lambda: np.zeros(0), repr=False)
    _residual: FloatArray = field(default_factory=lambda: np.zeros(0), repr=False)
    _factor: FloatArray = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    _weights: FloatArray = field(default_factory=lambda: np.zeros(0), repr=False)

    def fit(self, xy: FloatArray, residual: FloatArray, noise_variance: FloatArray) -> Self:
        """Condition on residuals (N,) at the places (N, 2), with a noise variance for each (N,).

        Raises
        ------
        CapacityError
            When the N × N matrix would not fit the memory.
        InputError
            When the matrix is not positive definite in double precision.
        """
        needed = 2 * 8e-6 * len(xy) ** 2
        if needed > self.memory_mb:
            raise CapacityError(
                f"{len(xy)} points need {needed:.0f} MB as a dense matrix, more than the {self.memory_mb:.0f} MB "
                "allowed; take method gp, fewer points or more memory."
            )
        covariance = self.kernel.covariance(xy, xy)
        covariance[np.diag_indices(len(xy))] += noise_variance
        try:
            factor = cho_factor(covariance, lower=True, overwrite_a=True, check_finite=False)[0]
        except np.linalg.LinAlgError as error:
            raise InputError(
                "the covariance of the points is not positive definite in double precision; their errors are "
                "stated too small beside the prior variance, or points repeat: enlarge the errors."
            ) from error
        weights = cho_solve((factor, True), residual, check_finite=False)
        return type(self)(self.kernel, self.memory_mb, xy, noise_variance, residual, factor, weights)

    def update(self, xy: FloatArray, residual: FloatArray, noise_variance: FloatArray) -> Self:
        """Condition on more points: the factor grows by the new rows only."""
        cross = self.kernel.covariance(self._xy, xy)
        lower = solve_triangular(self._factor, cross, lower=True, check_finite=False)
        corner = self.kernel.covariance(xy, xy) + np.diag(noise_variance) - lower.T @ lower
        n, k = len(self._xy), len(xy)
        factor = np.zeros((n + k, n + k))
        factor[:n, :n] = np.tril(self._factor)
        factor[n:, :n] = lower.T
        factor[n:, n:] = np.linalg.cholesky(corner)
        everything = np.concatenate([self._residual, residual])
        weights = cho_solve((factor, True), everything, check_finite=False)
        noise = np.concatenate([self._noise, noise_variance])
        places = np.vstack([self._xy, xy])
        return type(self)(self.kernel, self.memory_mb, places, noise, everything, factor, weights)

    @property
    def log_marginal_likelihood(self) -> float:
        """Logarithm of the probability density of the residuals (Eq. 9)."""
        log_determinant = 2.0 * np.log(np.diag(self._factor)).sum()
        n = len(self._residual)
        return float(-0.5 * (self._residual @ self._weights + log_determinant + n * np.log(2.0 * np.pi)))

    def for_residual(self, residual: FloatArray) -> Self:
        """Return the process conditioned on other residuals (N,) at the same places: the factor is kept."""
        weights = cho_solve((self._factor, True), residual, check_finite=False)
        return replace(self, _residual=residual, _weights=weights)

    def predict(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean (M,) and variance (M,) of the surface at the places (M, 2)."""
        mean, variance = np.empty(len(xy)), np.empty(len(xy))
        for start in range(0, len(xy), _BLOCK):
            block = slice(start, start + _BLOCK)
            cross = self.kernel.covariance(self._xy, xy[block])
            mean[block] = self._weights @ cross
            half = solve_triangular(self._factor, cross, lower=True, overwrite_b=True, check_finite=False)
            variance[block] = self.kernel.variance_m2 - np.einsum("ij,ij->j", half, half)
        return mean, np.maximum(variance, 0.0)

    def mean(self, xy: FloatArray) -> FloatArray:
        """Return the mean (M,) at the places (M, 2), without the cost of a variance."""
        blocks = [xy[start : start + _BLOCK] for start in range(0, len(xy), _BLOCK)]
        return np.concatenate(
            [self._weights @ self.kernel.covariance(self._xy, block) for block in blocks] or [np.zeros(0)]
        )

    def covariance(self, xy_a: FloatArray, xy_b: FloatArray) -> FloatArray:
        """Return the posterior covariance (A, B) between the surface at two sets of places."""
        half_a, half_b = (
            solve_triangular(self._factor, self.kernel.covariance(self._xy, xy), lower=True)
            for xy in (xy_a, xy_b)
        )
        covariance: FloatArray = self.kernel.covariance(xy_a, xy_b) - half_a.T @ half_b
        return covariance

    def sample(self, xy: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw n joint surfaces at the places, (n, M); needs M × M memory."""
        needed = 2 * 8e-6 * len(xy) ** 2
        if needed > self.memory_mb:
            raise CapacityError(
                f"joint samples at {len(xy)} places need {needed:.0f} MB with the dense engine, more than the "
                f"{self.memory_mb:.0f} MB allowed; take method gp or fewer places."
            )
        covariance = self.covariance(xy, xy)
        values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        surfaces: FloatArray = self.mean(xy) + rng.standard_normal((n, len(xy))) @ root.T
        return surfaces


def likeliest_dense(
    kernel: Kernel,
    xy: FloatArray,
    residual: FloatArray,
    noise_variance: FloatArray,
    *,
    bounds_m: tuple[float, float],
    memory_mb: float = 2000.0,
) -> tuple[Kernel, float]:
    """Return the kernel of the same family with the greatest likelihood, and that likelihood's logarithm.

    Length scales stay within `bounds_m` through the search; every parameter moves on a
    logarithmic scale, by a factor of at most 1000 from the start.
    """
    start = kernel.log_parameters
    limits = [
        _limits(name, value, bounds_m) for name, value in zip(kernel.parameter_names, start, strict=True)
    ]

    def negative(theta: FloatArray) -> float:
        try:
            gp = DenseGaussianProcess(kernel.with_log_parameters(theta), memory_mb)
            return -gp.fit(xy, residual, noise_variance).log_marginal_likelihood
        except CapacityError:
            raise
        except InputError:
            return 1e25

    found = minimize(negative, np.clip(start, *np.array(limits).T), method="L-BFGS-B", bounds=limits)
    return kernel.with_log_parameters(found.x), -float(found.fun)


def _limits(name: str, value: float, bounds_m: tuple[float, float]) -> tuple[float, float]:
    if "length_scale_m" in name:
        return float(np.log(bounds_m[0])), float(np.log(bounds_m[1]))
    return value - np.log(1e3), value + np.log(1e3)

"""Exact Gaussian-process regression by one dense Cholesky factorization."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from scipy.linalg import cho_solve, lapack, solve_triangular

from survey.core.arrays import FloatArray
from survey.core.errors import CapacityError, InputError
from survey.reconstruction.gp.covariance.kernels import Kernel
from survey.reconstruction.gp.engines.base import Process
from survey.reconstruction.gp.engines.fourier_basis import FourierBox
from survey.reconstruction.gp.engines.noisy_values import NoisyValues
from survey.reconstruction.gp.engines.polynomial_trend import PolynomialTrend, TrendName

MEMORY_MB = 2000.0

_BLOCK = 1000


@dataclass(frozen=True)
class DenseGaussianProcess(Process):
    r"""Posterior of a Gaussian process by the equations as they stand (Eqs. 4–6, 9).

    .. math::  m(x) = k(x, X) V^{-1} y, \qquad v(x) = k(x, x) - k(x, X) V^{-1} k(X, x), \qquad V = K + N

    with the noise variances N of the points.  A trend of unlimited prior variance is
    integrated out (Rasmussen and Williams 2006, Eqs. 2.41–2.42).  Made by `fit`.

    Notes
    -----
    Memory grows with N², work with N³ (and N² per place asked for): meant for some
    thousands of points, and as the standard by which faster engines are judged.

    Examples
    --------
    >>> from survey.reconstruction.gp.covariance.kernels import SquaredExponential
    >>> origin = np.zeros((1, 2))
    >>> gp = DenseGaussianProcess.fit(origin, np.ones(1), np.array([2.0]), SquaredExponential(4.0, 10.0))
    >>> [part.tolist() for part in gp.predict(origin)]
    [[0.5], [2.0]]
    """

    kernel: Kernel
    trend: PolynomialTrend
    data: NoisyValues
    factor: FloatArray
    memory_mb: float = MEMORY_MB

    @classmethod
    def fit(
        cls,
        xy: FloatArray,
        values: FloatArray,
        sigma_m: FloatArray,
        kernel: Kernel,
        *,
        trend: TrendName = "none",
        memory_mb: float = MEMORY_MB,
    ) -> Self:
        """Condition on values (N,) at the places (N, 2) [m], with a standard deviation for each (N,).

        Raises
        ------
        CapacityError
            When the N × N matrix would not fit the memory.
        InputError
            When the matrix is not positive definite in double precision.
        """
        data = NoisyValues.of(xy, values, sigma_m)
        _refuse_beyond(memory_mb, len(data), f"{len(data)} points need", "method gp or fewer points")
        surface = PolynomialTrend(trend, FourierBox.around(data.extent(None), 1.0))
        covariance = kernel.covariance(data.xy, data.xy)
        covariance[np.diag_indices(len(data))] += data.noise_m2
        return cls(kernel, surface, data, _factorized(covariance), memory_mb)

    def update(self, xy: FloatArray, values: FloatArray, sigma_m: FloatArray) -> Self:
        """Return the process conditioned on more points; the factor grows by the new rows only."""
        added = NoisyValues.of(xy, values, sigma_m)
        lower = self._half(added.xy)
        corner = self.kernel.covariance(added.xy, added.xy) + np.diag(added.noise_m2) - lower.T @ lower
        n = len(self.data)
        factor = np.zeros((n + len(added), n + len(added)), order="F")
        factor[:n, :n] = self.factor
        factor[n:, :n] = lower.T
        factor[n:, n:] = _factorized(corner)
        return replace(self, data=self.data + added, factor=factor)

    def for_values(self, values: FloatArray) -> Self:
        """Return the process of other values (N,) at the same points; its factor is reused."""
        data = NoisyValues.of(self.data.xy, values, np.sqrt(self.data.noise_m2))
        return replace(self, data=data)

    @cached_property
    def trend_covariance(self) -> FloatArray:
        """Covariance (T, T) of the trend's coefficients."""
        columns = self.trend.columns(self.data.xy)
        information: FloatArray = columns.T @ self._solved(columns)
        try:
            covariance: FloatArray = np.asarray(np.linalg.inv(information), dtype=np.float64)
        except np.linalg.LinAlgError as error:
            raise InputError(
                "the points do not determine the mean surface, because they lie on one line or spot; take a constant."
            ) from error
        return covariance

    @cached_property
    def trend_coefficients(self) -> FloatArray:
        """Generalised least-squares coefficients (T,) of the trend."""
        columns = self.trend.columns(self.data.xy)
        coefficients: FloatArray = self.trend_covariance @ (columns.T @ self._solved(self.data.values))
        return coefficients

    @property
    def log_marginal_likelihood(self) -> float:
        """Logarithm of the density of the values (Eq. 9), the trend integrated out."""
        columns = self.trend.columns(self.data.xy)
        residual = self.data.values - columns @ self.trend_coefficients
        n_free = len(residual) - self.trend.n_columns
        log_determinant = 2.0 * float(np.log(np.diag(self.factor)).sum())
        log_determinant -= float(np.linalg.slogdet(self.trend_covariance)[1])
        return float(
            -0.5 * (residual @ self._solved(residual) + log_determinant + n_free * np.log(2 * np.pi))
        )

    def predict(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return posterior mean [m] and variance [m²] of the terrain at places (M, 2) [m]."""
        mean, variance = np.empty(len(xy)), np.empty(len(xy))
        weights, coefficients, covariance = self._weights()
        whitened = self._whitened_trend()
        for start in range(0, len(xy), _BLOCK):
            block = slice(start, start + _BLOCK)
            half = self._half(xy[block])
            columns = self.trend.columns(xy[block])
            gap = columns - half.T @ whitened
            mean[block] = half.T @ weights + columns @ coefficients
            variance[block] = self.kernel.variance_m2 - np.einsum("ij,ij->j", half, half)
            variance[block] += np.einsum("ij,jk,ik->i", gap, covariance, gap)
        return mean, np.maximum(variance, 0.0)

    def predict_on_axes(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return posterior mean and standard deviation (H, W) [m] on the nodes of two axes [m]."""
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        mean, variance = self.predict(nodes)
        shape = (len(y), len(x))
        return mean.reshape(shape), np.sqrt(variance).reshape(shape)

    def leave_one_out(self) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (N,) that the others predict for each value, its noise included.

        Rasmussen and Williams (2006), Eqs. 5.10–5.12, the trend integrated out.
        """
        columns = self.trend.columns(self.data.xy)
        precision = self._solved(np.eye(len(self.data)))
        solved = self._solved(columns)
        precision -= solved @ self.trend_covariance @ solved.T
        variance = 1.0 / np.diag(precision)
        return self.data.values - (precision @ self.data.values) * variance, variance

    def covariance(self, xy_a: FloatArray, xy_b: FloatArray) -> FloatArray:
        """Return the posterior covariance (A, B) [m²] between two sets of places."""
        half_a, half_b = self._half(xy_a), self._half(xy_b)
        whitened = self._whitened_trend()
        gap_a, gap_b = (
            self.trend.columns(xy) - half.T @ whitened for xy, half in ((xy_a, half_a), (xy_b, half_b))
        )
        covariance: FloatArray = self.kernel.covariance(xy_a, xy_b) - half_a.T @ half_b
        return covariance + gap_a @ self._weights()[2] @ gap_b.T

    def joint_covariance(self, xy: FloatArray) -> FloatArray:
        """Return the posterior covariance (M, M) [m²] of the surface at places (M, 2)."""
        return self.covariance(xy, xy)

    def weighted_sum(self, xy: FloatArray, weights: FloatArray) -> tuple[float, float]:
        """Return mean and standard deviation of ``Σ w_i f(x_i)``; places are taken in blocks of a thousand."""
        blocks = [slice(k, k + _BLOCK) for k in range(0, len(xy), _BLOCK)]
        half = np.sum([self._half(xy[block]) @ weights[block] for block in blocks], axis=0)
        gap = weights @ self.trend.columns(xy) - half @ self._whitened_trend()
        prior = sum(
            float(weights[a] @ self.kernel.covariance(xy[a], xy[b]) @ weights[b])
            for a in blocks
            for b in blocks
        )
        variance = prior - float(half @ half) + float(gap @ self.trend_covariance @ gap)
        return float(weights @ self.predict(xy)[0]), float(np.sqrt(max(variance, 0.0)))

    def derivative_variance(self, xy: FloatArray, direction: FloatArray) -> FloatArray:
        """Return the variance (M,) of the derivative along a vector (2,), by central differences."""
        step = 1e-2 * self.kernel.length_scales_m[0]
        lag = 2.0 * step * direction
        ends = xy + step * direction, xy - step * direction
        # var(f₊ − f₋) = 2 k(0) − 2 k(lag) less what the points explain of the difference
        prior = 2.0 * (self.kernel.variance_m2 - float(self.kernel.covariance_of_lag(lag)))
        half = self._half(ends[0]) - self._half(ends[1])
        gap = self.trend.columns(ends[0]) - self.trend.columns(ends[1]) - half.T @ self._whitened_trend()
        variance = prior - np.einsum("ij,ij->j", half, half)
        variance += np.einsum("ij,jk,ik->i", gap, self.trend_covariance, gap)
        return np.asarray(np.maximum(variance, 0.0) / (4.0 * step**2), dtype=np.float64)

    def derivative_variance_on_axes(self, x: FloatArray, y: FloatArray, direction: FloatArray) -> FloatArray:
        """Return the variance (H * W,) of the derivative along a vector (2,) on the nodes of two axes."""
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        return self.derivative_variance(nodes, direction)

    def sample_on_axes(self, x: FloatArray, y: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw n joint surfaces (n, H, W) [m] on the nodes of two axes."""
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        return self.sample(nodes, n, rng).reshape(n, len(y), len(x))

    def gradient(self, xy: FloatArray) -> FloatArray:
        """Return the slope (M, 2) of the posterior mean [m/m], by central differences of a thousandth of a length scale."""
        step = 1e-3 * self.kernel.length_scales_m[0]
        slopes = [
            (self.predict(xy + shift)[0] - self.predict(xy - shift)[0]) / (2.0 * step)
            for shift in step * np.eye(2)
        ]
        return np.stack(slopes, axis=-1)

    def sample(self, xy: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw n joint surfaces (n, M) [m] at the places; needs an M × M matrix."""
        _refuse_beyond(
            self.memory_mb, len(xy), f"joint samples at {len(xy)} places need", "method gp or fewer places"
        )
        values, vectors = np.linalg.eigh(self.covariance(xy, xy))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        surfaces: FloatArray = self.predict(xy)[0] + rng.standard_normal((n, len(xy))) @ root.T
        return surfaces

    def _half(self, xy: FloatArray) -> FloatArray:
        """Return L⁻¹ k(X, x), whose squares are what the points explain."""
        half: FloatArray = solve_triangular(
            self.factor,
            self.kernel.covariance(self.data.xy, xy),
            lower=True,
            overwrite_b=True,
            check_finite=False,
        )
        return half

    def _whitened_trend(self) -> FloatArray:
        whitened: FloatArray = solve_triangular(
            self.factor, self.trend.columns(self.data.xy), lower=True, check_finite=False
        )
        return whitened

    def _weights(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the whitened residual of the trend, the trend's coefficients and their covariance."""
        covariance, coefficients = self.trend_covariance, self.trend_coefficients
        residual = self.data.values - self.trend.columns(self.data.xy) @ coefficients
        whitened: FloatArray = solve_triangular(self.factor, residual, lower=True, check_finite=False)
        return whitened, coefficients, covariance

    def _solved(self, columns: FloatArray) -> FloatArray:
        solved: FloatArray = cho_solve((self.factor, True), columns, check_finite=False)
        return solved


def _refuse_beyond(memory_mb: float, n: int, what: str, way_out: str) -> None:
    needed = 2 * 8e-6 * n**2
    if needed > memory_mb:
        raise CapacityError(
            f"{what} {needed:.0f} MB as a dense matrix, more than the {memory_mb:.0f} MB allowed; take {way_out}."
        )


def _factorized(matrix: FloatArray) -> FloatArray:
    """Lower Cholesky factor in column order, so that LAPACK copies nothing."""
    factor, failed = lapack.dpotrf(np.asfortranarray(matrix), lower=1, overwrite_a=1, clean=1)
    if failed:
        raise InputError(
            "the covariance of the points is not positive definite in double precision; their errors are stated "
            "too small beside the prior variance: raise them, or remove repeated points."
        )
    result: FloatArray = factor
    return result

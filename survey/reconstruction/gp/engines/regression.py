"""Gaussian-process regression: data, trend, interface of the engines, and the exact engine by one dense Cholesky factorization.

`NoisyValues` are values with noise variances at places. `PolynomialTrend` is a mean surface with free coefficients: none, a
constant or a plane. `Process` is the interface of all engines. `DenseGaussianProcess` is the exact posterior, to which the
other engines are compared; it takes memory by the square and time by the cube of the number of points.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Literal, Self

import numpy as np
from scipy.linalg import cho_solve, lapack, solve_triangular

from survey.core import CapacityError, FloatArray, InputError, checked
from survey.reconstruction.gp.engines.fourier_basis import FourierBox
from survey.reconstruction.gp.kernels import Kernel


@dataclass(frozen=True)
class NoisyValues:
    """Places (N, 2) [m], data columns (N, K) there, of which the first are the values, and noise variances (N,)."""

    xy: FloatArray
    columns: FloatArray
    noise_m2: FloatArray

    @classmethod
    def of(cls, xy: FloatArray, values: FloatArray, sigma_m: FloatArray) -> Self:
        """Check values (N,) and their standard deviations (N,) [m]."""
        xy, values, noise = checked_points(xy, values, sigma_m)
        return cls(xy, values[:, None], noise)

    @property
    def values(self) -> FloatArray:
        """The values (N,)."""
        return self.columns[:, 0]

    def __len__(self) -> int:
        return len(self.xy)

    def __add__(self, other: "NoisyValues") -> "NoisyValues":
        return NoisyValues(
            np.concatenate([self.xy, other.xy]),
            np.concatenate([self.columns, other.columns]),
            np.concatenate([self.noise_m2, other.noise_m2]),
        )

    def with_columns(self, columns: FloatArray) -> Self:
        """Put more columns (N, T) beside the values."""
        return replace(self, columns=np.concatenate([self.columns, columns], axis=1))

    def without_values(self) -> Self:
        """Keep places and noise alone."""
        return replace(self, columns=self.columns[:, :0])

    def extent(self, bounds: tuple[float, float, float, float] | None) -> tuple[float, float, float, float]:
        """Return the smallest rectangle (xmin, ymin, xmax, ymax) that holds the bounds, if any, and the points."""
        low, high = self.xy.min(axis=0), self.xy.max(axis=0)
        if bounds is not None:
            low, high = np.minimum(low, bounds[:2]), np.maximum(high, bounds[2:])
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def checked_points(
    xy: FloatArray, values: FloatArray, sigma_m: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return places, values and noise variances [m²], or refuse them in one sentence."""
    xy = checked(xy, (None, 2), "places of the points")
    values = checked(values, (len(xy),), "values of the points")
    sigma = checked(sigma_m, (len(xy),), "standard deviations of the points")
    if len(xy) == 0:
        raise InputError("no points were given; at least one was expected.")
    if (sigma <= 0).any():
        first = int(np.flatnonzero(sigma <= 0)[0])
        raise InputError(
            f"the standard deviation of point {first} is {sigma[first]:g} m where a number above 0 was "
            "expected; give the point's real accuracy."
        )
    return xy, values, sigma**2


TrendName = Literal["none", "constant", "plane"]


@dataclass(frozen=True)
class PolynomialTrend:
    """Columns of a mean surface on one box: 1, and the two coordinates from -1 to 1 across the box.

    The coefficients have an unlimited prior variance and are integrated out (universal kriging; Rasmussen and
    Williams 2006, section 2.7), so that their uncertainty is in the map.
    """

    name: TrendName
    box: FourierBox

    @property
    def n_columns(self) -> int:
        """Number of coefficients."""
        return {"none": 0, "constant": 1, "plane": 3}[self.name]

    def columns(self, xy: FloatArray) -> FloatArray:
        """Return the values (..., T) at places (..., 2) [m]."""
        scaled = 2 * (xy - self.box.centre_m) / self.box.period_m
        ones = np.ones((*xy.shape[:-1], 1))
        return np.concatenate([ones, scaled], axis=-1)[..., : self.n_columns]

    @property
    def gradient(self) -> FloatArray:
        """Derivatives (2, T) of the columns along x and y [1/m]."""
        slopes = np.concatenate([np.zeros((2, 1)), np.diag(2 / self.box.period_m)], axis=1)
        return slopes[:, : self.n_columns]


# ruff: noqa: ARG002 (defaults do not use what engines that override them do)


_N_TIMED_ROWS = 40


class Process(ABC):
    """A zero-mean Gaussian process, conditioned on noisy values.

    Engines that divide the site have no joint samples, sums and slopes; they refuse them.
    """

    kernel: Kernel
    data: NoisyValues
    divides_site: ClassVar[bool] = False
    """Whether parts of the site are conditioned one by one, which takes time for every pass."""
    solves_each_node: ClassVar[bool] = False
    """Whether every node of a map costs a solve with all points or cells."""

    @property
    @abstractmethod
    def log_marginal_likelihood(self) -> float:
        """Logarithm of the density of the values; 0 where an engine has none."""

    @abstractmethod
    def predict(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (M,) at places (M, 2)."""

    @abstractmethod
    def predict_on_axes(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (H, W) on the nodes of two axes."""

    @abstractmethod
    def gradient(self, xy: FloatArray) -> FloatArray:
        """Return the slope of the mean (M, 2)."""

    @abstractmethod
    def leave_one_out(self) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (N,) that the other values predict for each value, its noise included."""

    @abstractmethod
    def update(self, xy: FloatArray, values: FloatArray, sigma_m: FloatArray) -> Self:
        """Return the process that is conditioned on more values."""

    def surface_variance(self, variance: FloatArray, xy: FloatArray) -> FloatArray:
        """Return the variance (M,) [m²] of the surface, given that of the process; smaller where a bound is known."""
        return variance

    def record(self) -> dict[str, Any]:
        """Return name and resolution of the engine for the record."""
        return {"name": type(self).__name__}

    def facts(self) -> dict[str, Any]:
        """Return what was estimated beside the surface, for the record."""
        return {}

    def expected_s(self, x: FloatArray, y: FloatArray) -> float:
        """Return the expected time to judge the points and to map the nodes of two axes [s], from that of some rows."""
        some = y[:: max(len(y) // _N_TIMED_ROWS, 1)]
        began = time.perf_counter()
        self.predict_on_axes(x, some)
        prepared = time.perf_counter()
        self.predict_on_axes(x, some)
        rows_s = time.perf_counter() - prepared
        return max(prepared - began - rows_s, 0.0) + rows_s * len(y) / len(some)

    def sample_on_axes(self, x: FloatArray, y: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw n joint surfaces (n, H, W) [m] on the nodes of two axes."""
        raise self._refusal("samples")

    def weighted_sum(self, xy: FloatArray, weights: FloatArray) -> tuple[float, float]:
        """Return mean and standard deviation of the weighted sum of heights at places (M, 2)."""
        raise self._refusal("sums")

    def covariance_with(self, xy: FloatArray, n_each: int = 1) -> Callable[[FloatArray], FloatArray]:
        """Return the function from places (A, 2) to their posterior covariance (A, B) [m²] with others.

        The others are the means over `n_each` consecutive places of (n B, 2). Relief of no extent is not in it.
        """
        raise self._refusal("covariance")

    def joint_covariance(self, xy: FloatArray) -> FloatArray:
        """Return the posterior covariance (M, M) [m²] of the surface at places (M, 2)."""
        raise self._refusal("covariance")

    def derivative_variance_on_axes(self, x: FloatArray, y: FloatArray, direction: FloatArray) -> FloatArray:
        """Return the variance (H * W,) of the derivative along a vector (2,), without that of a trend."""
        raise self._refusal("slopes")

    def _refusal(self, what: str) -> InputError:
        return InputError(f"a map in tiles has no joint {what}; take a smaller site, or allow more memory.")


def means_of(rows: FloatArray, n_each: int) -> FloatArray:
    """Return the means (R, B) over consecutive columns of rows (R, n B)."""
    return rows if n_each == 1 else rows.reshape(len(rows), -1, n_each).mean(axis=2)


MEMORY_MB = 2000.0

# Places at once, which bounds the memory of their covariance with all points.
_BLOCK = 1000


@dataclass(frozen=True)
class DenseGaussianProcess(Process):
    r"""Posterior of a Gaussian process by the equations as they stand (Eqs. 4–6, 9).

    .. math::  m(x) = k(x, X) V^{-1} y, \qquad v(x) = k(x, x) - k(x, X) V^{-1} k(X, x), \qquad V = K + N

    with the noise variances N of the points.  A trend of unlimited prior variance is
    integrated out (Rasmussen and Williams 2006, Eqs. 2.41–2.42).  Made by `fit`.

    Memory grows with N², work with N³ (and N² per place asked for): meant for some
    thousands of points, and as the standard by which faster engines are judged.

    >>> from survey.reconstruction.gp.kernels import SquaredExponential
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
    solves_each_node: ClassVar = True

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
        """Condition on values (N,) at the places (N, 2) [m], with a standard deviation for each (N,)."""
        data = NoisyValues.of(xy, values, sigma_m)
        _refuse_beyond(memory_mb, len(data), f"{len(data)} points need", "method gp or fewer points")
        surface = PolynomialTrend(trend, FourierBox.around(data.extent(None), 1.0))
        covariance = kernel.covariance(data.xy, data.xy)
        covariance[np.diag_indices(len(data))] += data.noise_m2
        return cls(kernel, surface, data, factorized(covariance), memory_mb)

    def update(self, xy: FloatArray, values: FloatArray, sigma_m: FloatArray) -> Self:
        """Return the process conditioned on more points; the factor grows by the new rows only."""
        added = NoisyValues.of(xy, values, sigma_m)
        lower = self._half(added.xy)
        corner = self.kernel.covariance(added.xy, added.xy) + np.diag(added.noise_m2) - lower.T @ lower
        n = len(self.data)
        factor = np.zeros((n + len(added), n + len(added)), order="F")
        factor[:n, :n] = self.factor
        factor[n:, :n] = lower.T
        factor[n:, n:] = factorized(corner)
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
        return self.covariance_with(xy_b)(xy_a)

    def covariance_with(self, xy: FloatArray, n_each: int = 1) -> Callable[[FloatArray], FloatArray]:
        """Return the function from places (A, 2) to their posterior covariance (A, B) [m²] with others."""
        whitened, of_trend = self._whitened_trend(), self._weights()[2]
        half = means_of(self._half(xy), n_each)
        gap = of_trend @ (means_of(self.trend.columns(xy).T, n_each) - whitened.T @ half)

        def covariance(places: FloatArray) -> FloatArray:
            here = self._half(places)
            prior = means_of(self.kernel.covariance(places, xy), n_each)
            total: FloatArray = prior - here.T @ half
            return total + (self.trend.columns(places) - here.T @ whitened) @ gap

        return covariance

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


def dense_mb(n: int) -> float:
    """Return the memory of a dense covariance of n places and of its factor [MB]."""
    return 2 * 8e-6 * n**2


def _refuse_beyond(memory_mb: float, n: int, what: str, way_out: str) -> None:
    needed = dense_mb(n)
    if needed > memory_mb:
        raise CapacityError(
            f"{what} {needed:.0f} MB as a dense matrix, more than the {memory_mb:.0f} MB allowed; take {way_out}."
        )


def factorized(matrix: FloatArray) -> FloatArray:
    """Return the lower Cholesky factor in column order, so that LAPACK copies nothing; refuse what is not positive definite."""
    factor, failed = lapack.dpotrf(np.asfortranarray(matrix), lower=1, overwrite_a=1, clean=1)
    if failed:
        raise InputError(
            "the covariance of the points is not positive definite in double precision; their errors are stated "
            "too small beside the prior variance: raise them, or remove repeated points."
        )
    result: FloatArray = factor
    return result

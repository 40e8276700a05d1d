"""Gaussian-process regression of the terrain in the weights of Fourier waves.

The time is that of one dense factorization of a few thousand weights, whatever the number of points and of grid
nodes: the points enter through one non-uniform transform, the maps leave through two matrix products.

`MarginalLikelihood` gives the likelihood of the points and leave-one-out predictions, `FourierProducts` joint samples, sums
and slopes. `nearest_variance_bound` is an upper bound on the posterior variance by the nearest points.
`FourierGaussianProcess` is the engine.
"""

from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from survey.core import Bounds, CapacityError, FloatArray, InputError, IntArray, checked
from survey.reconstruction.gp.engines.fourier_basis import (
    MAX_ITERATIONS,
    TOLERABLE,
    ComplexArray,
    FourierBasis,
    Resolution,
    amplitudes,
    line_variances,
    resolve,
    sharpest_std_m,
)
from survey.reconstruction.gp.engines.fourier_weights import (
    MeanSystem,
    PointSums,
    WeightPosterior,
    inner,
    put_real_weights,
)
from survey.reconstruction.gp.engines.regression import (
    NoisyValues,
    PolynomialTrend,
    Process,
    TrendName,
    means_of,
)
from survey.reconstruction.gp.kernels import Kernel


@dataclass(frozen=True)
class MarginalLikelihood:
    r"""Log marginal likelihood of the points, the trend's coefficients integrated out.

    .. math::  \log p = -\tfrac12 \left( y^T \Pi y + \log |K + N| + \log |P^T (K + N)^{-1} P|
               + (n - t) \log 2 \pi \right)

    with Π the inverse of ``K + N`` less its part on the trend P (glacier paper, section II.D; Rasmussen and
    Williams 2006, Eqs. 2.30 and 2.45).  The noise N holds that of the points and the variance of the discarded
    waves.
    """

    kernel: Kernel
    data: NoisyValues
    trend: PolynomialTrend
    noise_m2: FloatArray
    posterior: WeightPosterior

    @property
    def _basis(self) -> FourierBasis:
        return self.posterior.basis

    @cached_property
    def _columns(self) -> FloatArray:
        """Values and trend columns (N, 1 + T)."""
        return self.data.with_columns(self.trend.columns(self.data.xy)).columns

    @cached_property
    def _sides(self) -> FloatArray:
        """Data sides ``D Φᵀ N⁻¹ [y P]`` (m, 1 + T)."""
        box, half = self._basis.box, self._basis.half
        transforms = [box.transform(self.data.xy, column / self.noise_m2, half) for column in self._columns.T]
        scale = self._basis.doubled(self.posterior.amplitudes)
        return np.stack([scale * self._basis.weights_of(transform) for transform in transforms], axis=-1)

    @cached_property
    def _solutions(self) -> FloatArray:
        """Whitened weights (m, 1 + T) of each column."""
        return np.stack([self.posterior.times(side) for side in self._sides.T], axis=-1)

    @cached_property
    def _products(self) -> FloatArray:
        """Products ``[y P]ᵀ [K + N]⁻¹ [y P]``."""
        cross = self._columns.T @ (self._columns / self.noise_m2[:, None])
        products: FloatArray = cross - self._sides.T @ self._solutions
        return products

    @cached_property
    def trend_coefficients(self) -> FloatArray:
        """Generalized least-squares coefficients (T,) of the trend."""
        solved = np.linalg.solve(self._products[1:, 1:], self._products[1:, 0])
        return np.asarray(solved, dtype=np.float64)

    @cached_property
    def _residual_map(self) -> FloatArray:
        """Coefficients (1 + T,) that take the trend off the values."""
        return np.concatenate([[1.0], -self.trend_coefficients])

    def value_with(self, misfit: float) -> float:
        """Log marginal likelihood with a misfit ``yᵀ Π y`` found elsewhere with more waves."""
        n_free = len(self.data) - self.trend.n_columns
        determinants = np.log(self.noise_m2).sum() + self.posterior.log_determinant
        determinants += np.linalg.slogdet(self._products[1:, 1:])[1]
        return float(-0.5 * (misfit + determinants + n_free * np.log(2 * np.pi)))

    # -- point by point ---------------------------------------------------------------------------

    @cached_property
    def weighted_residuals(self) -> FloatArray:
        """``Π y`` (N,): what the mean leaves of each value, over its noise variance."""
        residuals: FloatArray = (self._remainders @ self._residual_map) / self.noise_m2
        return residuals

    @cached_property
    def _remainders(self) -> FloatArray:
        """What the process leaves of each column (N, 1 + T)."""
        scale = self._basis.doubled(self.posterior.amplitudes)
        fields = [self._basis.coefficients_of(scale * z) for z in self._solutions.T]
        explained = [self._basis.box.evaluate(self.data.xy, field) for field in fields]
        return self._columns - np.stack(explained, axis=-1)

    @cached_property
    def precision_diagonal(self) -> FloatArray:
        """Diagonal (N,) of Π."""
        variance = self._basis.box.evaluate(self.data.xy, self.posterior.variance_coefficients())
        if self.trend.n_columns:
            gaps = self._remainders[:, 1:]
            variance += np.sum(gaps * np.linalg.solve(self._products[1:, 1:], gaps.T).T, axis=1)
        share = np.maximum(1 - variance / self.noise_m2, np.finfo(float).eps)
        diagonal: FloatArray = share / self.noise_m2
        return diagonal

    def leave_one_out(self) -> tuple[FloatArray, FloatArray]:
        """Return the mean [m] and variance [m²] (N,) that the other points predict for each value, its noise included.

        Exact, without refitting (Rasmussen and Williams 2006, Eqs. 5.10 to 5.12).
        """
        variance = 1 / self.precision_diagonal
        mean: FloatArray = self.data.values - self.weighted_residuals * variance
        return mean, variance


class FourierProducts(Process):
    """Samples, sums and slopes of a process in the weights of Fourier waves."""

    resolution: Resolution
    trend: PolynomialTrend
    posterior: WeightPosterior
    system: MeanSystem

    @property
    @abstractmethod
    def trend_fields(self) -> list[ComplexArray]:
        """Coefficients of what the process makes of each trend column."""

    @property
    @abstractmethod
    def trend_precision(self) -> FloatArray:
        """Information matrix (T, T) of the trend's coefficients."""

    def sample_on_axes(self, x: FloatArray, y: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Return joint samples (n, H, W) [m] of the terrain on the nodes of the axes x and y [m].

        Each is a draw from the prior, moved to the data by the answer to what it misses (Matheron's rule):
        ``f = f₀ + m(y - f₀(X) - ε)``.  It costs one solution for the mean, not a factorization.

        Waves beyond those of the mean are not in the samples.
        """
        box, resolution = self.resolution.box, self.resolution
        noise = np.sqrt(self.data.noise_m2 + resolution.mean_tail_m2)
        samples = np.empty((n, len(y), len(x)))
        for k in range(n):
            weights = rng.standard_normal(resolution.mean_basis.n_modes)
            spectrum = np.zeros(self.system.amplitudes.shape, dtype=complex)
            prior = self.system.coefficients(
                put_real_weights(spectrum, resolution.mean_basis.lattice, weights)
            )
            drawn = box.evaluate(self.data.xy, prior) + noise * rng.standard_normal(len(self.data))
            missed = self.for_values(self.data.values - drawn)
            samples[k] = box.evaluate_on_axes(x, y, prior) + missed.mean_on_axes(x, y)
        return samples

    def weighted_sum(self, xy: FloatArray, weights: FloatArray) -> tuple[float, float]:
        """Return the mean and standard deviation of ``Σ w_i f(x_i)``, such as the volume over a polygon.

        `xy` (M, 2): quadrature nodes inside the polygon [m]. `weights` (M,): area that each node stands for
        [m²]. Returns `mean, std`: volume between the terrain and its prior mean, and its standard deviation
        [m³].

        The errors of neighbouring nodes are correlated, and that is in it; relief of the discarded waves averages
        out over any area wider than a length scale, and is not.
        """
        xy = checked(xy, (None, 2), "quadrature nodes")
        weights = checked(weights, (len(xy),), "quadrature weights")
        if len(xy) == 0:
            raise InputError("no quadrature node lies in the polygon; take a finer spacing than its width.")
        basis = self.resolution.covariance_basis
        mean, _ = self.predict(xy)
        transform = basis.box.transform(xy, weights, basis.half)
        features = basis.doubled(self.posterior.amplitudes) * basis.weights_of(transform)
        variance = float(features @ self.posterior.times(features))
        if self.trend.n_columns:
            explained = np.stack([basis.box.evaluate(xy, field) for field in self.trend_fields], axis=-1)
            gap = weights @ (self.trend.columns(xy) - explained)
            variance += float(gap @ np.linalg.solve(self.trend_precision, gap))
        return float(weights @ mean), float(np.sqrt(max(variance, 0.0)))

    def covariance_with(self, xy: FloatArray, n_each: int = 1) -> Callable[[FloatArray], FloatArray]:
        """Return the function from places (A, 2) to their posterior covariance (A, B) [m²] with others.

        Relief of the discarded waves is not in it.
        """
        seen = self.posterior.times_each(means_of(self.posterior.features(xy).T, n_each).T)
        if not self.trend.n_columns:
            return lambda places: self.posterior.features(places) @ seen
        gap = np.linalg.solve(self.trend_precision, means_of(self._trend_gap(xy).T, n_each))
        return lambda places: self.posterior.features(places) @ seen + self._trend_gap(places) @ gap

    def _trend_gap(self, xy: FloatArray) -> FloatArray:
        """Return the part (M, T) of the trend's columns that the process does not explain."""
        explained = [self.resolution.box.evaluate(xy, field) for field in self.trend_fields]
        return self.trend.columns(xy) - np.stack(explained, axis=-1)

    def joint_covariance(self, xy: FloatArray) -> FloatArray:
        """Return the posterior covariance (M, M) [m²] of the surface at places (M, 2), for few places.

        Relief of the discarded waves counts as independent from place to place.
        """
        covariance = self.covariance_with(xy)(xy)
        covariance[np.diag_indices(len(xy))] += self.resolution.tail_m2
        return covariance

    def derivative_variance_on_axes(self, x: FloatArray, y: FloatArray, direction: FloatArray) -> FloatArray:
        """Return the variance (H * W,) of the derivative along a vector (2,), without that of a trend."""
        coefficients = self.posterior.variance_coefficients(direction)
        return self.resolution.box.evaluate_on_axes(x, y, coefficients).ravel()

    @abstractmethod
    def for_values(self, values: FloatArray) -> "FourierProducts":
        """Return the process of other values (N,) at the same points."""

    @abstractmethod
    def mean_on_axes(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the posterior mean (H, W) [m] on the nodes of two axes."""


_N_NEAREST = 12
# Places at once, whose 66 lags between neighbours stay in the processor's cache.
_BLOCK = 1000
# Share of a point's variance that its neighbours may leave, below which rounding decides: it tells nothing more.
_LEAST_LEFT = 1e-12


def nearest_variance_bound(kernel: Kernel, data: NoisyValues, xy: FloatArray) -> FloatArray:
    r"""Return the posterior variance (M,) [m²] at places (M, 2) given their twelve nearest points only.

    .. math::  v = k(0) - k_n^T (K_n + N_n)^{-1} k_n

    More points never make a Gaussian process less sure, so that this is never less than
    the variance given all points. A fast engine that counts the waves it leaves out as
    noise gives another such bound: too high beside points, where this one is tight, and
    right between swaths, where this one is too high. The smaller of the two is the better.

    `xy` (M, 2): places [m].

    The mean is taken as known.

    >>> from survey.reconstruction.gp.kernels import SquaredExponential
    >>> one = NoisyValues.of(np.zeros((1, 2)), np.zeros(1), np.array([2.0]))
    >>> nearest_variance_bound(SquaredExponential(4.0, 10.0), one, np.zeros((1, 2)))
    array([2.])
    """
    tree, bound = cKDTree(data.xy), np.empty(len(xy))
    for block in _blocks(xy):
        bound[block] = _of_block(kernel, data, tree, xy[block])
    return bound


def _blocks(xy: FloatArray) -> Iterator[IntArray]:
    """Yield the places (M, 2) by number in blocks of neighbours, which have most of their nearest points in common."""
    n_blocks = -(-len(xy) // _BLOCK)
    if n_blocks:
        extent_m = np.maximum(np.ptp(xy, axis=0), 1e-9)
        side_m = np.maximum(np.sqrt(extent_m.prod() / n_blocks), extent_m / n_blocks)
        column, row = ((xy - xy.min(axis=0)) // side_m).astype(np.int64).T
        yield from np.split(np.lexsort((row, column)), np.arange(1, n_blocks) * _BLOCK)


def _of_block(kernel: Kernel, data: NoisyValues, tree: cKDTree, xy: FloatArray) -> FloatArray:
    n = min(_N_NEAREST, len(data))
    index = np.asarray(tree.query(xy, k=n)[1]).reshape(len(xy), n)
    near = data.xy[index]
    row, column = np.tril_indices(n, -1)
    used, place = np.unique(index, return_inverse=True)
    if len(used) ** 2 < len(row) * len(xy):
        among, place = (
            kernel.covariance_of_lag(data.xy[used, None] - data.xy[used]),
            place.reshape(index.shape),
        )
        between = among[place[:, row], place[:, column]]
    else:
        between = kernel.covariance_of_lag(near[:, row] - near[:, column])
    here = kernel.covariance_of_lag(near - xy[:, None, :])
    explained = _explained(between, kernel.variance_m2 + data.noise_m2[index], here)
    variance: FloatArray = np.maximum(kernel.variance_m2 - explained, 0.0)
    return variance


@njit(cache=True)
def _explained(between: FloatArray, own: FloatArray, here: FloatArray) -> FloatArray:
    """Return the variance (M,) that n values explain at each place, by a Cholesky factor for each.

    `between` (M, n (n - 1) / 2): covariances of the values, the lower triangle by rows. `own`, `here` (M, n): their
    variances, and their covariances with the place.
    """
    n_places, n = here.shape
    explained = np.zeros(n_places)
    factor, half = np.empty((n, n)), np.empty(n)
    for k in range(n_places):
        pair = 0
        for i in range(n):
            left, gain = own[k, i], here[k, i]
            for j in range(i):
                entry = between[k, pair]
                pair += 1
                for m in range(j):
                    entry -= factor[i, m] * factor[j, m]
                factor[i, j] = entry / factor[j, j]
                left -= factor[i, j] ** 2
                gain -= factor[i, j] * half[j]
            factor[i, i] = np.sqrt(left) if left > _LEAST_LEFT * own[k, i] else np.inf
            half[i] = gain / factor[i, i]
            explained[k] += half[i] ** 2
    return explained


MEMORY_MB = 300.0
"""Memory that one covariance may take unless said otherwise: 6,100 modes."""

# Share of the tolerance of the mean that is left to the iterative solver.
_SOLVER_SHARE = 1e-3


@dataclass(frozen=True)
class FourierGaussianProcess(FourierProducts):
    r"""Posterior of a Gaussian process given noisy points, which predicts anywhere on the site.

    Made by `fit`.  The posterior at x, given values y at X with the noise variances N (glacier paper, Eqs. 4
    and 5, and Rasmussen and Williams 2006, Eqs. 2.25 and 2.26), is

    .. math::  m(x) = k(x, X) [K + N]^{-1} y, \qquad
               v(x) = k(x, x) - k(x, X) [K + N]^{-1} k(X, x)

    in the waves of `FourierBasis`, where ``K + N`` becomes the much smaller ``I + D B D``.

    Accuracy.  With a squared exponential the mean is that of the exact process within the tolerance asked for,
    and the standard deviation within a tenth of it.  Spectra that decay slowly (Matérn, short rational
    quadratics) have no such cut: the relief of the discarded waves then is in the predicted variance as noise of
    no extent, which is right far from points and too cautious beside them; `resolution.is_met` says so.

    Cannot do: noise that is correlated between points, places outside the box, non-stationary terrain.

    >>> from survey.reconstruction.gp.kernels import SquaredExponential
    >>> rng = np.random.default_rng(0)
    >>> xy = rng.uniform(0, 100, (50, 2))
    >>> kernel, values = SquaredExponential(1.0, 20.0), np.sin(xy[:, 0] / 20)
    >>> gp = FourierGaussianProcess.fit(xy, values, np.full(50, 0.01), kernel)
    >>> mean, variance = gp.predict(np.array([[50.0, 50.0]]))
    >>> bool(abs(mean[0] - np.sin(2.5)) < 0.01), bool(variance[0] < 0.05)
    (True, True)
    """

    kernel: Kernel
    resolution: Resolution
    trend: PolynomialTrend
    data: NoisyValues
    posterior: WeightPosterior
    system: MeanSystem
    sums: PointSums
    solutions: tuple[ComplexArray, ...]
    mean_error: float
    """Error of the mean at the end of the iterations [posterior standard deviations]."""

    @classmethod
    def fit(
        cls,
        xy: FloatArray,
        values: FloatArray,
        sigma_m: FloatArray,
        kernel: Kernel,
        *,
        bounds: Bounds | None = None,
        trend: TrendName = "none",
        tolerance_m: float = 1e-3,
        memory_mb: float = MEMORY_MB,
        resolution: Resolution | None = None,
    ) -> Self:
        """Condition the process on points.

        `xy` (N, 2): easting and northing of the points [m]. `values` (N,): heights above the prior mean [m].
        `sigma_m` (N,): standard deviations of the values [m], above 0; errors are independent. `bounds`
        (xmin, ymin, xmax, ymax): extent of later predictions [m]; grown to hold the points.  The points'
        extent if left out. `tolerance_m`: largest error of the mean that the waves may add [m]; a tenth of it
        for the standard deviation. `memory_mb`: memory that the covariance may take [MB]. `resolution`: box and
        waves, chosen by tolerance and memory if left out.
        """
        return cls.solve(
            xy,
            values,
            sigma_m,
            kernel,
            bounds=bounds,
            trend=trend,
            tolerance_m=tolerance_m,
            memory_mb=memory_mb,
            resolution=resolution,
        ).converged()

    @classmethod
    def solve(
        cls,
        xy: FloatArray,
        values: FloatArray,
        sigma_m: FloatArray,
        kernel: Kernel,
        *,
        bounds: Bounds | None = None,
        trend: TrendName = "none",
        tolerance_m: float = 1e-3,
        memory_mb: float = MEMORY_MB,
        resolution: Resolution | None = None,
    ) -> Self:
        """Condition the process on points as `fit` does, whether the mean converges or not; see `has_converged`."""
        data = NoisyValues.of(xy, values, sigma_m)
        if resolution is None:
            sharpest = sharpest_std_m(kernel, data.xy, data.noise_m2)
            site = data.extent(bounds)
            resolution = resolve(kernel, site, sharpest, tolerance_m=tolerance_m, memory_mb=memory_mb)
        basis = resolution.covariance_basis
        gram = PointSums.of(basis, data.without_values(), resolution.tail_m2).gram
        posterior = WeightPosterior.given(basis, amplitudes(kernel, basis), gram)
        surface = PolynomialTrend(trend, resolution.box)
        sums = _sums(data, surface, resolution)
        system = MeanSystem.of(
            resolution.mean_basis, line_variances(kernel, resolution.mean_basis), sums.gram
        )
        weights = system.solve_all(sums, posterior, _accuracy(kernel, resolution))
        return cls(kernel, resolution, surface, data, posterior, system, sums, *weights)

    @property
    def solves_each_node(self) -> bool:  # type: ignore[override]  # of the waves, not of the class
        """Whether every node of a map costs the bound by its nearest points, because waves are left out."""
        return not self.resolution.is_met

    @property
    def has_converged(self) -> bool:
        """Whether the mean converged within the largest number of iterations."""
        return self.mean_error <= TOLERABLE

    def converged(self) -> Self:
        """Return the process, or refuse one whose mean did not converge."""
        if not self.has_converged:
            raise CapacityError(
                f"the map's mean did not settle within {MAX_ITERATIONS} iterations (it may be off by "
                f"{self.mean_error:.2g} standard deviations): the length scale is too long or the noise too small for so "
                "many waves; map a smaller area, or state larger errors."
            )
        return self

    def update(self, xy: FloatArray, values: FloatArray, sigma_m: FloatArray) -> Self:
        """Return the process conditioned on more points, with the waves of this one.

        Costs two products of the covariance with as many vectors as there are new points (Woodbury), and
        equals a refit with the same waves to rounding.  For many points, or denser ones than before, fit again.
        """
        added = NoisyValues.of(xy, values, sigma_m)
        self.refuse_outside(added.xy)
        resolution = self.resolution
        posterior = self.posterior.updated(added.xy, added.noise_m2 + resolution.tail_m2)
        sums = self.sums + _sums(added, self.trend, resolution)
        lines = line_variances(self.kernel, resolution.mean_basis)
        system = MeanSystem.of(resolution.mean_basis, lines, sums.gram)
        weights = system.solve_all(sums, posterior, _accuracy(self.kernel, resolution), self.solutions)
        return replace(
            self,
            data=self.data + added,
            posterior=posterior,
            system=system,
            sums=sums,
            solutions=weights.columns,
            mean_error=weights.error,
        ).converged()

    def for_values(self, values: FloatArray) -> Self:
        """Return the process of other values (N,) at the same points; its covariance is reused."""
        data = NoisyValues.of(self.data.xy, values, np.sqrt(self.data.noise_m2))
        sums = _sums(data, self.trend, self.resolution)
        weights = self.system.solve_all(sums, self.posterior, _accuracy(self.kernel, self.resolution))
        changed = replace(self, data=data, sums=sums, solutions=weights.columns, mean_error=weights.error)
        return changed.converged()

    # -- the two fields ---------------------------------------------------------------------------

    @cached_property
    def trend_precision(self) -> FloatArray:
        """Information matrix (T, T) of the trend's coefficients, ``Pᵀ [K + N]⁻¹ P``."""
        return self._generalized_products[1:, 1:]

    @cached_property
    def trend_coefficients(self) -> FloatArray:
        """Generalized least-squares coefficients (T,) of the trend [m, at the box's centre and per half box]."""
        if not self.trend.n_columns:
            return np.zeros(0)
        explained: FloatArray = self._generalized_products[1:, 0]
        return np.asarray(np.linalg.solve(self.trend_precision, explained), dtype=np.float64)

    @cached_property
    def _generalized_products(self) -> FloatArray:
        """Products ``[y P]ᵀ [K + N]⁻¹ [y P]``."""
        sides = [self.system.right_hand_side(moment) for moment in self.sums.moments]
        explained = [[inner(a, z) for z in self.solutions] for a in sides]
        products: FloatArray = self.sums.cross - np.array(explained)
        return products

    @cached_property
    def mean_coefficients(self) -> ComplexArray:
        """Fourier coefficients of the mean without its trend [m]."""
        weights = self.solutions[0].copy()
        for coefficient, solution in zip(self.trend_coefficients, self.solutions[1:], strict=True):
            weights -= coefficient * solution
        return self.system.coefficients(weights)

    @cached_property
    def variance_coefficients(self) -> ComplexArray:
        """Fourier coefficients of the variance without its trend [m²]."""
        return self.posterior.variance_coefficients()

    @cached_property
    def trend_fields(self) -> list[ComplexArray]:
        """Coefficients of what the process makes of each trend column."""
        return [self.system.coefficients(solution) for solution in self.solutions[1:]]

    def trend_variance(self, remainders: FloatArray) -> FloatArray:
        """Return the variance from the trend's coefficients, given the unexplained part (..., T) of its columns."""
        solved = np.linalg.solve(self.trend_precision, remainders.reshape(-1, remainders.shape[-1]).T).T
        variance: FloatArray = np.sum(remainders * solved.reshape(remainders.shape), axis=-1)
        return variance

    @cached_property
    def evidence(self) -> MarginalLikelihood:
        """Likelihood with its gradient, and leave-one-out predictions, with the waves of the covariance."""
        noise = self.data.noise_m2 + self.resolution.tail_m2
        return MarginalLikelihood(self.kernel, self.data, self.trend, noise, self.posterior)

    @property
    def log_marginal_likelihood(self) -> float:
        """Log marginal likelihood of the values, their misfit with all waves of the mean."""
        products = self._generalized_products
        coefficients = np.concatenate([[1.0], -self.trend_coefficients])
        return self.evidence.value_with(float(coefficients @ products @ coefficients))

    # -- questions --------------------------------------------------------------------------------

    def predict(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the posterior mean [m] and variance [m²] of the terrain at places (M, 2) on the site [m]."""
        xy = checked(xy, (None, 2), "places to predict")
        self.refuse_outside(xy)
        box = self.resolution.box
        columns = self.trend.columns(xy)
        mean = box.evaluate(xy, self.mean_coefficients) + columns @ self.trend_coefficients
        variance = box.evaluate(xy, self.variance_coefficients) + self.resolution.tail_m2
        if self.trend.n_columns:
            explained = np.stack([box.evaluate(xy, field) for field in self.trend_fields], axis=-1)
            variance += self.trend_variance(columns - explained)
        return mean, np.maximum(variance, 0.0)

    def predict_on_axes(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the posterior mean and standard deviation (H, W) [m] on the nodes of the axes x (W,) and y (H,) [m]."""
        mean = self.mean_on_axes(x, y)
        box = self.resolution.box
        variance = box.evaluate_on_axes(x, y, self.variance_coefficients)
        variance += self.resolution.tail_m2
        if self.trend.n_columns:
            explained = [box.evaluate_on_axes(x, y, field) for field in self.trend_fields]
            columns = self.trend.columns(np.stack(np.meshgrid(x, y), axis=-1))
            variance += self.trend_variance(columns - np.stack(explained, axis=-1))
        return mean, np.sqrt(np.maximum(variance, 0.0, out=variance), out=variance)

    def mean_on_axes(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the posterior mean (H, W) [m] on the nodes of the axes x (W,) and y (H,) [m]."""
        self.refuse_outside(np.array([[x.min(), y.min()], [x.max(), y.max()]]))
        mean = self.resolution.box.evaluate_on_axes(x, y, self.mean_coefficients)
        if self.trend.n_columns:
            nodes = np.stack(np.meshgrid(x, y), axis=-1)
            mean += self.trend.columns(nodes) @ self.trend_coefficients
        return mean

    def gradient(self, xy: FloatArray) -> FloatArray:
        """Return the slope (M, 2) of the posterior mean at places: its derivatives along x and y [m/m]."""
        xy = checked(xy, (None, 2), "places to predict")
        self.refuse_outside(xy)
        box = self.resolution.box
        trend = self.trend.gradient @ self.trend_coefficients
        fields = [box.derivative(self.mean_coefficients, axis) for axis in (0, 1)]
        gradient: FloatArray = np.stack([box.evaluate(xy, field) for field in fields], axis=-1) + trend
        return gradient

    def leave_one_out(self) -> tuple[FloatArray, FloatArray]:
        """Return mean [m] and variance [m²] (N,) that the other values predict for each value, its noise included."""
        return self.evidence.leave_one_out()

    def surface_variance(self, variance: FloatArray, xy: FloatArray) -> FloatArray:
        """Return the variance (M,) [m²]; where waves are left out, no more than given the nearest points."""
        if self.resolution.is_met:
            return variance
        return np.minimum(variance, nearest_variance_bound(self.kernel, self.data, xy))

    def record(self) -> dict[str, Any]:
        """Return name and resolution of the engine for the record."""
        resolution = self.resolution
        return {
            **super().record(),
            "n_modes": resolution.n_modes,
            "tail_m": float(np.sqrt(resolution.tail_m2)),
            "tolerance_m": resolution.tolerance_m,
            "tolerance_is_met": bool(resolution.is_met),
        }

    def refuse_outside(self, xy: FloatArray) -> None:
        """Raise `InputError` for places (M, 2) outside the site and its points."""
        low, high = np.array(self.resolution.bounds[:2]), np.array(self.resolution.bounds[2:])
        outside = ((xy < low - 1e-6) | (xy > high + 1e-6)).any(axis=1)
        if outside.any():
            x, y = xy[np.flatnonzero(outside)[0]]
            raise InputError(
                f"{int(outside.sum())} places, the first at ({x:.1f}, {y:.1f}), lie outside the site "
                f"{tuple(float(round(b, 1)) for b in self.resolution.bounds)}; fit with bounds that hold them."
            )


def _sums(data: NoisyValues, trend: PolynomialTrend, resolution: Resolution) -> PointSums:
    """Sum over the points for the waves of the mean, with the trend's columns beside the values."""
    columns = data.with_columns(trend.columns(data.xy))
    return PointSums.of(resolution.mean_basis, columns, resolution.mean_tail_m2)


def _accuracy(kernel: Kernel, resolution: Resolution) -> float:
    """Return the energy at which the iterative solver stops."""
    return _SOLVER_SHARE * resolution.tolerance_m / float(np.sqrt(kernel.variance_m2))

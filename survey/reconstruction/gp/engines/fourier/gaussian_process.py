"""Gaussian process regression of the terrain in the weights of Fourier waves.

The time is that of one dense factorization of a few thousand weights, whatever the number of points and of grid
nodes: the points enter through one non-uniform transform, the maps leave through two matrix products.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from survey.core.arrays import Bounds, FloatArray, checked
from survey.core.errors import InputError
from survey.reconstruction.gp.covariance.stationary import Kernel
from survey.reconstruction.gp.engines.fourier.evidence import MarginalLikelihood
from survey.reconstruction.gp.engines.fourier.fourier_products import FourierProducts
from survey.reconstruction.gp.engines.fourier.mean_solver import MeanSystem, PointSums, inner
from survey.reconstruction.gp.engines.fourier.resolution import (
    Resolution,
    amplitudes,
    line_variances,
    resolve,
    sharpest_std_m,
)
from survey.reconstruction.gp.engines.fourier.weight_posterior import WeightPosterior
from survey.reconstruction.gp.engines.fourier_basis import ComplexArray
from survey.reconstruction.gp.engines.noisy_values import NoisyValues
from survey.reconstruction.gp.engines.polynomial_trend import PolynomialTrend, TrendName
from survey.reconstruction.gp.engines.variance_bound import variance_from_nearest

MEMORY_MB = 300.0
"""Memory that one covariance may take unless said otherwise: 6,100 modes."""

# Share of the tolerance of the mean that is left to the iterative solver.
_SOLVER_SHARE = 1e-3


@dataclass(frozen=True)
class FourierGaussianProcess(FourierProducts):
    r"""Posterior of a Gaussian process given noisy points, ready to be asked anywhere on the site.

    Made by `fit`.  The posterior at x, given values y at X with the noise variances N (glacier paper, Eqs. 4
    and 5, and Rasmussen and Williams 2006, Eqs. 2.25 and 2.26), is

    .. math::  m(x) = k(x, X) [K + N]^{-1} y, \qquad
               v(x) = k(x, x) - k(x, X) [K + N]^{-1} k(X, x)

    in the waves of `FourierBasis`, where ``K + N`` becomes the much smaller ``I + D B D``.

    Notes
    -----
    Accuracy.  With a squared exponential the mean is that of the exact process within the tolerance asked for,
    and the standard deviation within a tenth of it.  Spectra that decay slowly (Matérn, short rational
    quadratics) have no such cut: the relief of the discarded waves then is in the predicted variance as noise of
    no extent, which is right far from points and too cautious beside them; `resolution.is_met` says so.

    Cannot do: noise that is correlated between points, places outside the box, non-stationary terrain.

    Examples
    --------
    >>> from survey.reconstruction.gp.covariance.kernels import SquaredExponential
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

        Parameters
        ----------
        xy : (N, 2) ndarray
            Easting and northing of the points [m].
        values : (N,) ndarray
            Heights above the prior mean [m].
        sigma_m : (N,) ndarray
            Standard deviations of the values [m], above 0; errors are independent.
        kernel : Kernel
            Prior covariance.
        bounds : (xmin, ymin, xmax, ymax), optional
            Where the process will be asked [m]; grown to hold the points.  The points' extent if left out.
        trend : {"none", "constant", "plane"}
            Mean with coefficients of unlimited prior variance, integrated out (universal kriging).
        tolerance_m : float
            Largest error of the mean that the waves may add [m]; a tenth of it for the standard deviation.
        memory_mb : float
            Memory that the covariance may take [MB].
        resolution : Resolution, optional
            Box and waves, if they are to be those of another process.

        Raises
        ------
        InputError
            If arrays do not fit together, hold NaN, or a standard deviation is not above 0.
        CapacityError
            If more waves are needed than fit into `memory_mb`.
        """
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
        solutions = system.solve_all(sums, posterior, _accuracy(kernel, resolution))
        return cls(kernel, resolution, surface, data, posterior, system, sums, solutions)

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
        solutions = system.solve_all(sums, posterior, _accuracy(self.kernel, resolution), self.solutions)
        return replace(
            self,
            data=self.data + added,
            posterior=posterior,
            system=system,
            sums=sums,
            solutions=solutions,
        )

    def for_values(self, values: FloatArray) -> Self:
        """Return the process of other values (N,) at the same points; its covariance is reused."""
        data = NoisyValues.of(self.data.xy, values, np.sqrt(self.data.noise_m2))
        sums = _sums(data, self.trend, self.resolution)
        solutions = self.system.solve_all(sums, self.posterior, _accuracy(self.kernel, self.resolution))
        return replace(self, data=data, sums=sums, solutions=solutions)

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
        """Return the posterior mean [m] and variance [m²] of the terrain at places (M, 2) on the site [m].

        Raises
        ------
        InputError
            If a place lies outside the site and its points.
        """
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
        return np.minimum(variance, variance_from_nearest(self.kernel, self.data, xy))

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

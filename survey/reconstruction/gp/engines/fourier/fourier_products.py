"""Joint samples, sums and slopes of a map from one Fourier factorization."""

from abc import abstractmethod

import numpy as np

from survey.core.arrays import FloatArray, checked
from survey.core.errors import InputError
from survey.reconstruction.gp.engines.base import Process
from survey.reconstruction.gp.engines.fourier.mean_solver import MeanSystem, put_real_weights
from survey.reconstruction.gp.engines.fourier.resolution import Resolution
from survey.reconstruction.gp.engines.fourier.weight_posterior import WeightPosterior
from survey.reconstruction.gp.engines.fourier_basis import ComplexArray
from survey.reconstruction.gp.engines.polynomial_trend import PolynomialTrend


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

        Notes
        -----
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

        Parameters
        ----------
        xy : (M, 2) ndarray
            Quadrature nodes inside the polygon [m].
        weights : (M,) ndarray
            Area that each node stands for [m²].

        Returns
        -------
        mean, std : float
            Volume between the terrain and its prior mean, and its standard deviation [m³].

        Notes
        -----
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

    def joint_covariance(self, xy: FloatArray) -> FloatArray:
        """Return the posterior covariance (M, M) [m²] of the surface at places (M, 2), for few places.

        Relief of the discarded waves counts as independent from place to place.
        """
        features = self.posterior.features(xy)
        covariance: FloatArray = features @ self.posterior.times_each(features)
        if self.trend.n_columns:
            explained = [self.resolution.box.evaluate(xy, field) for field in self.trend_fields]
            gap = self.trend.columns(xy) - np.stack(explained, axis=-1)
            covariance += gap @ np.linalg.solve(self.trend_precision, gap.T)
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

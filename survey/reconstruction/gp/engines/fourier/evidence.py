"""Marginal likelihood of the points under a kernel, and leave-one-out predictions."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from survey.core.arrays import FloatArray
from survey.reconstruction.gp.covariance.stationary import Kernel
from survey.reconstruction.gp.engines.fourier.weight_posterior import WeightPosterior
from survey.reconstruction.gp.engines.fourier_basis import FourierBasis
from survey.reconstruction.gp.engines.noisy_values import NoisyValues
from survey.reconstruction.gp.engines.polynomial_trend import PolynomialTrend


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

"""How well a survey will know the terrain, before it is driven: the variance needs no heights."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from survey.core.arrays import Bounds, FloatArray
from survey.reconstruction.gp.covariance.stationary import Kernel
from survey.reconstruction.gp.engines.fourier_basis import ComplexArray
from survey.reconstruction.gp.engines.mean_solver import PointSums
from survey.reconstruction.gp.engines.noisy_values import NoisyValues
from survey.reconstruction.gp.engines.resolution import Resolution, amplitudes, resolve
from survey.reconstruction.gp.engines.weight_posterior import WeightPosterior


@dataclass(frozen=True)
class VarianceForecast:
    """Posterior variance that points at given places would leave.

    The points enter as a sum over them, so that a swath is added by adding its `information`, computed once,
    and many sets of swaths are compared at one factorization each.

    Parameters
    ----------
    kernel : Kernel
        Prior covariance.
    resolution : Resolution
        Box and waves.
    gram : (4 P + 1, 4 Q + 1) ndarray of complex
        Information of the points so far.

    Examples
    --------
    >>> from survey.reconstruction.gp.covariance.kernels import SquaredExponential
    >>> nothing = VarianceForecast.of(SquaredExponential(4.0, 20.0), (0, 0, 100, 100), sigma_m=0.5)
    >>> swath = np.column_stack([np.arange(0.0, 100.0, 5.0), np.full(20, 50.0)])
    >>> driven = nothing.with_information(nothing.information(swath, np.full(20, 0.5)))
    >>> x = np.array([50.0])
    >>> print(np.round([nothing.std_on_axes(x, x)[0, 0], driven.std_on_axes(x, x)[0, 0]], 1))
    [2.  0.3]
    """

    kernel: Kernel
    resolution: Resolution
    gram: ComplexArray

    @classmethod
    def of(
        cls,
        kernel: Kernel,
        bounds: Bounds,
        *,
        sigma_m: float,
        tolerance_m: float = 0.1,
        memory_mb: float = 72.0,
    ) -> Self:
        """Forecast of no points yet, on a site (xmin, ymin, xmax, ymax) [m].

        Parameters
        ----------
        sigma_m : float
            Smallest standard deviation that the map will reach [m], as an order of magnitude.
        tolerance_m : float
            As for the Gaussian process; plans need less than maps.

        Raises
        ------
        CapacityError
            If more waves are needed than fit into `memory_mb`.
        """
        resolution = resolve(kernel, bounds, sigma_m, tolerance_m=tolerance_m, memory_mb=memory_mb)
        half_p, half_q = resolution.covariance_basis.half
        return cls(kernel, resolution, np.zeros((4 * half_p + 1, 4 * half_q + 1), dtype=complex))

    def information(self, xy: FloatArray, sigma_m: FloatArray) -> ComplexArray:
        """Information of points at places (N, 2) [m] with standard deviations (N,) [m]; it adds up."""
        data = NoisyValues.of(xy, np.zeros(len(xy)), sigma_m).without_values()
        return PointSums.of(self.resolution.covariance_basis, data, self.resolution.tail_m2).gram

    def with_information(self, information: ComplexArray) -> Self:
        """Return the forecast with more points."""
        return replace(self, gram=self.gram + information)

    @cached_property
    def posterior(self) -> WeightPosterior:
        """Covariance of the weights after the points."""
        basis = self.resolution.covariance_basis
        return WeightPosterior.given(basis, amplitudes(self.kernel, basis), self.gram)

    def std_on_axes(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Predicted standard deviation (H, W) [m] on the nodes of the axes x and y [m]."""
        coefficients = self.posterior.variance_coefficients()
        variance = self.resolution.box.evaluate_on_axes(x, y, coefficients) + self.resolution.tail_m2
        return np.sqrt(np.maximum(variance, 0.0))

    def std(self, xy: FloatArray) -> FloatArray:
        """Predicted standard deviation (M,) [m] at places (M, 2) [m]."""
        coefficients = self.posterior.variance_coefficients()
        variance = self.resolution.box.evaluate(xy, coefficients) + self.resolution.tail_m2
        return np.sqrt(np.maximum(variance, 0.0))

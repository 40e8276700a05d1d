# ruff: noqa: ARG002 (defaults do not use what engines that override them do)
"""Interface of the Gaussian-process engines: dense, Fourier, Fourier in tiles, and local neighbourhoods."""

import time
from abc import ABC, abstractmethod
from typing import Any, ClassVar, Self

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.reconstruction.gp.covariance.kernels import Kernel
from survey.reconstruction.gp.engines.noisy_values import NoisyValues

_N_TIMED_ROWS = 40


class Process(ABC):
    """A zero-mean Gaussian process, conditioned on noisy values.

    Engines that divide the site have no joint samples, sums and slopes; they refuse them.
    """

    kernel: Kernel
    data: NoisyValues
    divides_site: ClassVar[bool] = False
    """Whether parts of the site are conditioned one by one, which takes time for every pass."""

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

    def joint_covariance(self, xy: FloatArray) -> FloatArray:
        """Return the posterior covariance (M, M) [m²] of the surface at places (M, 2)."""
        raise self._refusal("covariance")

    def derivative_variance_on_axes(self, x: FloatArray, y: FloatArray, direction: FloatArray) -> FloatArray:
        """Return the variance (H * W,) of the derivative along a vector (2,), without that of a trend."""
        raise self._refusal("slopes")

    def _refusal(self, what: str) -> InputError:
        return InputError(f"a map in tiles has no joint {what}; take a smaller site, or allow more memory.")

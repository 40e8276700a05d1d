"""A conditioned zero-mean process, whichever engine carries it: dense, Fourier, or Fourier in tiles."""

from typing import Any, Literal, Protocol, Self

from survey.core.arrays import Bounds, FloatArray
from survey.core.errors import CapacityError
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.covariance.kernels import Kernel
from survey.reconstruction.gp.engines.dense_gp import DenseGaussianProcess
from survey.reconstruction.gp.engines.noisy_values import NoisyValues
from survey.reconstruction.gp.engines.polynomial_trend import TrendName

# Up to this many points the dense factorization is the cheaper one.
_N_DENSE = 400


class Process(Protocol):
    """What every engine can be asked."""

    @property
    def kernel(self) -> Kernel:
        """The covariance function."""

    @property
    def data(self) -> NoisyValues:
        """What the process was conditioned on."""

    @property
    def log_marginal_likelihood(self) -> float:
        """Logarithm of the density of the values."""

    def predict(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (M,) at places (M, 2)."""

    def predict_on_axes(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (H, W) on the nodes of two axes."""

    def gradient(self, xy: FloatArray) -> FloatArray:
        """Return the slope of the mean (M, 2)."""

    def update(self, xy: FloatArray, values: FloatArray, sigma_m: FloatArray) -> Self:
        """Return the process that knows more points."""


def conditioned(
    engine: Literal["gp", "dense"],
    kernel: Kernel,
    xy: FloatArray,
    values: FloatArray,
    sigma_m: FloatArray,
    *,
    bounds: Bounds | None,
    trend: TrendName,
    config: GaussianProcessConfig,
) -> Process:
    """Condition on points with the engine that was asked for, or the one that fits the size of the task."""
    if engine == "dense" or len(xy) <= _N_DENSE:
        return DenseGaussianProcess.fit(xy, values, sigma_m, kernel, trend=trend)
    # Here, because compiling support costs half a second that other methods need not pay.
    from survey.reconstruction.gp.engines.gaussian_process import FourierGaussianProcess
    from survey.reconstruction.gp.engines.rough_resolution import resolution_for
    from survey.reconstruction.gp.engines.tiles import TiledGaussianProcess

    site = NoisyValues.of(xy, values, sigma_m).extent(bounds)
    limits = {"tolerance_m": config.tolerance_m, "memory_mb": config.memory_mb}
    try:
        resolution = resolution_for(kernel, site, xy, sigma_m**2, **limits)
    except CapacityError:
        return TiledGaussianProcess.fit(xy, values, sigma_m, kernel, bounds=bounds, trend=trend, **limits)
    return FourierGaussianProcess.fit(
        xy, values, sigma_m, kernel, bounds=bounds, trend=trend, resolution=resolution
    )


def leave_one_out(process: Process) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance (N,) that the other points predict for each, whichever engine it is."""
    carrier: Any = getattr(process, "evidence", process)
    mean, variance = carrier.leave_one_out()
    return mean, variance

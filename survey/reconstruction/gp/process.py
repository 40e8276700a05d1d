"""Choice of the Gaussian-process engine for the size of a task."""

from typing import Literal

from survey.core.arrays import Bounds, FloatArray, Progress
from survey.core.errors import CapacityError
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.covariance.kernels import Kernel
from survey.reconstruction.gp.engines.base import Process
from survey.reconstruction.gp.engines.dense_gp import DenseGaussianProcess
from survey.reconstruction.gp.engines.noisy_values import NoisyValues
from survey.reconstruction.gp.engines.polynomial_trend import TrendName

EngineName = Literal["gp", "dense"]
"""The fast engine, which depends on the size of the task, or the dense one."""
# Up to this many points the dense factorization is the cheaper one.
_N_DENSE = 400


def conditioned(
    engine: EngineName,
    kernel: Kernel,
    xy: FloatArray,
    values: FloatArray,
    sigma_m: FloatArray,
    *,
    bounds: Bounds | None,
    trend: TrendName,
    config: GaussianProcessConfig,
    progress: Progress | None = None,
) -> Process:
    """Condition on points with the dense engine, or with the one that fits the size of the task.

    The site is divided into tiles where the waves of all of it do not fit into memory, and into
    neighbourhoods where the mean of so many waves does not settle.
    """
    if engine == "dense" or len(xy) <= _N_DENSE:
        return DenseGaussianProcess.fit(xy, values, sigma_m, kernel, trend=trend)
    site = NoisyValues.of(xy, values, sigma_m).extent(bounds)
    whole = _in_waves(kernel, xy, values, sigma_m, site, bounds=bounds, trend=trend, config=config)
    if whole is not None:
        return whole
    tiles = _in_tiles(
        kernel, xy, values, sigma_m, bounds=bounds, trend=trend, config=config, progress=progress
    )
    if tiles is not None:
        return tiles
    from survey.reconstruction.gp.engines.local_gp import LocalGaussianProcess

    return LocalGaussianProcess.fit(
        xy, values, sigma_m, kernel, bounds=bounds, trend=trend, progress=progress
    )


def _in_waves(
    kernel: Kernel,
    xy: FloatArray,
    values: FloatArray,
    sigma_m: FloatArray,
    site: Bounds,
    *,
    bounds: Bounds | None,
    trend: TrendName,
    config: GaussianProcessConfig,
) -> Process | None:
    """Condition the whole site in Fourier waves; None where they do not fit, or their mean does not settle."""
    # Here, because compiling support costs half a second that other methods need not pay.
    from survey.reconstruction.gp.engines.fourier.gaussian_process import FourierGaussianProcess
    from survey.reconstruction.gp.engines.fourier.rough_resolution import resolution_for

    limits = {"tolerance_m": config.tolerance_m, "memory_mb": config.memory_mb}
    try:
        resolution = resolution_for(kernel, site, xy, sigma_m**2, **limits)
        return FourierGaussianProcess.fit(
            xy, values, sigma_m, kernel, bounds=bounds, trend=trend, resolution=resolution
        )
    except CapacityError:
        return None


def _in_tiles(
    kernel: Kernel,
    xy: FloatArray,
    values: FloatArray,
    sigma_m: FloatArray,
    *,
    bounds: Bounds | None,
    trend: TrendName,
    config: GaussianProcessConfig,
    progress: Progress | None,
) -> Process | None:
    """Divide the site into tiles in Fourier waves; None where no tile fits, or its mean does not settle."""
    from survey.reconstruction.gp.engines.tiles import TiledGaussianProcess

    limits = {"tolerance_m": config.tolerance_m, "memory_mb": config.memory_mb}
    try:
        tiles = TiledGaussianProcess.fit(
            xy, values, sigma_m, kernel, bounds=bounds, trend=trend, progress=progress, **limits
        )
        tiles.require_settled()
    except CapacityError:
        return None
    return tiles

"""Choice of the Gaussian-process engine for the size of a task."""

from typing import Any, Literal, NamedTuple

from survey.core.arrays import Bounds, FloatArray, Progress
from survey.core.errors import CapacityError
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.engines.regression import DenseGaussianProcess, NoisyValues, Process, TrendName
from survey.reconstruction.gp.kernels import Kernel

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
    task = _LargeTask(kernel, xy, values, sigma_m, bounds, trend, config, progress)
    return task.in_waves() or task.in_tiles() or task.in_neighbourhoods()


class _LargeTask(NamedTuple):
    """Points to condition on, too many for the dense engine."""

    kernel: Kernel
    xy: FloatArray
    values: FloatArray
    sigma_m: FloatArray
    bounds: Bounds | None
    trend: TrendName
    config: GaussianProcessConfig
    progress: Progress | None

    @property
    def _limits(self) -> dict[str, Any]:
        return {"tolerance_m": self.config.tolerance_m, "memory_mb": self.config.memory_mb}

    @property
    def _points(self) -> tuple[FloatArray, FloatArray, FloatArray, Kernel]:
        return self.xy, self.values, self.sigma_m, self.kernel

    def in_waves(self) -> Process | None:
        """Condition the whole site in Fourier waves; None where they do not fit, or their mean does not settle."""
        # Here, because compiling support costs half a second that other methods need not pay.
        from survey.reconstruction.gp.engines.fourier_basis import resolution_for
        from survey.reconstruction.gp.engines.fourier_gp import FourierGaussianProcess

        site = NoisyValues.of(self.xy, self.values, self.sigma_m).extent(self.bounds)
        try:
            resolution = resolution_for(self.kernel, site, self.xy, self.sigma_m**2, **self._limits)
            return FourierGaussianProcess.fit(
                *self._points, bounds=self.bounds, trend=self.trend, resolution=resolution
            )
        except CapacityError:
            return None

    def in_tiles(self) -> Process | None:
        """Divide the site into tiles in Fourier waves; None where no tile fits, or its mean does not settle."""
        from survey.reconstruction.gp.engines.tiled_gp import TiledGaussianProcess

        try:
            tiles = TiledGaussianProcess.fit(
                *self._points, bounds=self.bounds, trend=self.trend, progress=self.progress, **self._limits
            )
            tiles.require_settled()
        except CapacityError:
            return None
        return tiles

    def in_neighbourhoods(self) -> Process:
        """Map every small tile from its nearest points."""
        from survey.reconstruction.gp.engines.tiled_gp import LocalGaussianProcess

        return LocalGaussianProcess.fit(
            *self._points, bounds=self.bounds, trend=self.trend, progress=self.progress
        )

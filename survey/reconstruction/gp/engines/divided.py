"""Base of the Gaussian-process engines that divide the site into tiles."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np

from survey.core.arrays import BoolArray, FloatArray, IntArray, Progress
from survey.reconstruction.gp.covariance.kernels import Kernel
from survey.reconstruction.gp.engines.base import Process
from survey.reconstruction.gp.engines.dense_gp import DenseGaussianProcess
from survey.reconstruction.gp.engines.noisy_values import NoisyValues
from survey.reconstruction.gp.engines.polynomial_trend import PolynomialTrend, TrendName

_N_FOR_TREND = 800
Tile = TypeVar("Tile")
Places = TypeVar("Places", IntArray, BoolArray)
"""Places of a tile among others, by their numbers or by a mask."""


@dataclass(frozen=True, kw_only=True)
class DividedGaussianProcess(Process, Generic[Tile, Places]):
    """A process whose tiles are conditioned one after the other, when they are asked for.

    Neighbouring tiles differ a little at their seam. No joint likelihood exists: `log_marginal_likelihood` is 0.

    Parameters
    ----------
    kernel : Kernel
        Covariance of all tiles.
    data : NoisyValues
        All points.
    trend : PolynomialTrend
        Mean surface of the site.
    coefficients : (T,) ndarray
        Its coefficients, from an evenly spaced part of the points.
    progress : callable, optional
        Called with what is done, the number of tiles done, and their number.
    """

    divides_site: ClassVar = True

    kernel: Kernel
    data: NoisyValues
    trend: PolynomialTrend
    coefficients: FloatArray
    log_marginal_likelihood: float = 0.0
    progress: Progress | None = field(default=None, compare=False, repr=False)

    @abstractmethod
    def _tiles_of(self, xy: FloatArray) -> Sequence[tuple[Tile, Places]]:
        """Return the tiles that hold places (M, 2), each with its places."""

    @abstractmethod
    def _process_of(self, tile: Tile) -> Process:
        """Return the process of a tile, conditioned on what lies in and around it, without the trend."""

    @abstractmethod
    def _left_out(self, tile: Tile, own: Places) -> tuple[FloatArray, FloatArray]:
        """Return the leave-one-out mean and variance of the points of a tile, without the trend."""

    def update(self, xy: FloatArray, values: FloatArray, sigma_m: FloatArray) -> Self:
        """Return the process that is conditioned on more points, in the same tiles."""
        return replace(self, data=self.data + NoisyValues.of(xy, values, sigma_m))

    def predict(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean [m] and variance [m²] (M,) at places (M, 2) [m]."""
        mean, variance = np.empty(len(xy)), np.empty(len(xy))
        for done, (tile, here) in enumerate(tiles := self._tiles_of(xy)):
            mean[here], variance[here] = self._process_of(tile).predict(xy[here])
            self._report("tiles of the calibration", done + 1, len(tiles))
        return mean + self._trend_at(xy), variance

    def gradient(self, xy: FloatArray) -> FloatArray:
        """Return the slope (M, 2) of the mean [m/m]."""
        slope = np.empty((len(xy), 2))
        for done, (tile, here) in enumerate(tiles := self._tiles_of(xy)):
            slope[here] = self._process_of(tile).gradient(xy[here])
            self._report("tiles of the slopes", done + 1, len(tiles))
        return slope + self.trend.gradient @ self.coefficients

    def leave_one_out(self) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (N,) that the others predict for each point, tile by tile."""
        mean, variance = np.empty(len(self.data)), np.empty(len(self.data))
        for done, (tile, here) in enumerate(tiles := self._tiles_of(self.data.xy)):
            mean[here], variance[here] = self._left_out(tile, here)
            self._report("tiles of the outliers", done + 1, len(tiles))
        return mean + self._trend_at(self.data.xy), variance

    def _trend_at(self, xy: FloatArray) -> FloatArray:
        """Return the mean surface (...,) [m] at places (..., 2) [m]."""
        return self.trend.columns(xy) @ self.coefficients

    def _without_trend(self, near: IntArray | BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return places, values less the trend, and standard deviations of some points."""
        xy = self.data.xy[near]
        return xy, self.data.values[near] - self._trend_at(xy), np.sqrt(self.data.noise_m2[near])

    def _report(self, what: str, done: int, total: int) -> None:
        """Call `progress` about 200 times."""
        if self.progress is not None and (done == total or done % max(total // 200, 1) == 0):
            self.progress(what, done, total)


def trend_of_part(
    xy: FloatArray, values: FloatArray, sigma_m: FloatArray, kernel: Kernel, trend: TrendName
) -> dict[str, Any]:
    """Return the trend of a site and its coefficients, from an evenly spaced part of the points."""
    part = np.unique(np.linspace(0, len(xy) - 1, _N_FOR_TREND).astype(int))
    sample = DenseGaussianProcess.fit(xy[part], values[part], sigma_m[part], kernel, trend=trend)
    return {"trend": sample.trend, "coefficients": sample.trend_coefficients}

"""Gaussian-process regression of large sites in tiles of Fourier waves with a halo.

`DividedGaussianProcess` is the base of all engines that condition tiles one after the other, about one trend of the site.
`TiledGaussianProcess` conditions each tile in Fourier waves on the points within it and a halo around it.
"""

import time
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Generic, Protocol, Self, TypeVar

import numpy as np

from survey.core import BoolArray, Bounds, CapacityError, FloatArray, InputError, IntArray, Progress
from survey.reconstruction.gp.engines.fourier_basis import sharpest_std_m
from survey.reconstruction.gp.engines.fourier_gp import FourierGaussianProcess
from survey.reconstruction.gp.engines.regression import (
    DenseGaussianProcess,
    NoisyValues,
    PolynomialTrend,
    Process,
    TrendName,
)
from survey.reconstruction.gp.engines.tiles import HALO_LENGTHS, TileGrid, halo_m
from survey.reconstruction.gp.kernels import Kernel

# The trend needs few points: they are factorized densely.
_N_FOR_TREND = 800
Tile = TypeVar("Tile")
Places = TypeVar("Places", IntArray, BoolArray)
"""Places of a tile among others, by their numbers or by a mask."""


class TileProcess(Protocol):
    """What is asked of the process of one tile."""

    def predict(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (M,) at places (M, 2)."""

    def gradient(self, xy: FloatArray) -> FloatArray:
        """Return the slope of the mean (M, 2)."""


@dataclass(frozen=True, kw_only=True)
class DividedGaussianProcess(Process, Generic[Tile, Places]):
    """A process whose tiles are conditioned one after the other, when they are needed.

    Neighbouring tiles differ a little at their seam. No joint likelihood exists: `log_marginal_likelihood` is 0.

    `kernel`: covariance of all tiles. `data`: all points. `trend`: mean surface of the site. `coefficients`
    (T,): its coefficients, from an evenly spaced part of the points. `progress`: called with what is done,
    the number of tiles done, and their number.
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
    def _process_of(self, tile: Tile) -> TileProcess:
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


_N_TIMED_POINTS = 5000
# Every tile is conditioned for the outliers, for the calibration, and for the map.
_PASSES_OVER_TILES = 3.0


@dataclass(frozen=True, kw_only=True)
class TiledGaussianProcess(DividedGaussianProcess[tuple[int, int], BoolArray]):
    """A process whose tiles are conditioned one after the other, when they are needed.

    `kernel`: covariance of all tiles. `data`: all points. `tiles`: division of the site. `trend`: mean surface
    of the site. `coefficients` (T,): its coefficients, from an evenly spaced part of the points. `tolerance_m`,
    `memory_mb`: as for one tile of `FourierGaussianProcess`.

    Neighbouring tiles differ at their seam by up to the error of the halo. No joint
    likelihood exists: `log_marginal_likelihood` is 0.
    """

    tiles: TileGrid
    tolerance_m: float
    memory_mb: float

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
        memory_mb: float = 300.0,
        tiles: TileGrid | None = None,
        progress: Progress | None = None,
    ) -> Self:
        """Choose the largest tiles that fit the memory, unless `tiles` are given."""
        data = NoisyValues.of(xy, values, sigma_m)
        if tiles is None:
            sharpest, limits = sharpest_std_m(kernel, data.xy, data.noise_m2), (tolerance_m, memory_mb)
            tiles = TileGrid.largest_within(kernel, data.extent(bounds), sharpest, *limits)
        if tiles is None:
            raise CapacityError(
                f"not even a small tile with its halo of {halo_m(kernel):.0f} m fits {memory_mb:.0f} MB; allow more "
                "memory or give a longer shortest length scale."
            )
        return cls(
            kernel=kernel,
            data=data,
            tiles=tiles,
            tolerance_m=tolerance_m,
            memory_mb=memory_mb,
            progress=progress,
            **trend_of_part(xy, values, sigma_m, kernel, trend),
        )

    def predict_on_axes(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (H, W) [m] on the nodes of two axes [m]."""
        mean, std = np.empty((len(y), len(x))), np.empty((len(y), len(x)))
        columns, rows = self.tiles.index(x, 0), self.tiles.index(y, 1)
        done = 0
        for column in np.unique(columns):
            for row in np.unique(rows):
                i, j = np.flatnonzero(rows == row), np.flatnonzero(columns == column)
                tile = self._process_of((int(column), int(row)))
                part = np.ix_(i, j)
                mean[part], std[part] = tile.predict_on_axes(x[j], y[i])
                nodes = np.stack(np.meshgrid(x[j], y[i]), axis=-1)
                mean[part] += self._trend_at(nodes)
                done += 1
                self._report("tiles of the map", done, len(self.tiles))
        return mean, std

    @property
    def has_converged(self) -> bool:
        """Whether the mean of the tile with the most points converges."""
        tile, _ = self.tiles.fullest(self.data.xy)
        return self._solve(tile, self.tiles.near(tile, self.data.xy)).has_converged

    def record(self) -> dict[str, Any]:
        """Return name and number of tiles for the record."""
        return {**super().record(), "n_tiles": len(self.tiles)}

    def expected_s(self, x: FloatArray, y: FloatArray) -> float:  # noqa: ARG002
        """Return the expected time [s], from that of the tile with the most points."""
        tile, here = self.tiles.fullest(self.data.xy)
        began = time.perf_counter()
        self._process_of(tile).predict(self.data.xy[here][:_N_TIMED_POINTS])
        seconds = time.perf_counter() - began
        return len(self.tiles) * _PASSES_OVER_TILES * seconds

    def _left_out(self, tile: tuple[int, int], own: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return the leave-one-out mean and variance of the points of a tile, without the trend."""
        inside = own[self.tiles.near(tile, self.data.xy)]
        mean, variance = self._process_of(tile).leave_one_out()
        return mean[inside], variance[inside]

    def _tiles_of(self, xy: FloatArray) -> list[tuple[tuple[int, int], BoolArray]]:
        return self.tiles.holding(xy)

    def _process_of(self, tile: tuple[int, int]) -> FourierGaussianProcess:
        near = self.tiles.near(tile, self.data.xy)
        if not near.any():
            raise InputError(
                f"no point lies within {HALO_LENGTHS:g} length scales of the ground about "
                f"{tuple(round(b, 1) for b in self.tiles.bounds(tile))}; map a smaller area, or give a longer length scale."
            )
        return self._solve(tile, near).converged()

    def _solve(self, tile: tuple[int, int], near: BoolArray) -> FourierGaussianProcess:
        return FourierGaussianProcess.solve(
            *self._without_trend(near),
            self.kernel,
            bounds=self.tiles.bounds(tile),
            tolerance_m=self.tolerance_m,
            memory_mb=self.memory_mb,
        )

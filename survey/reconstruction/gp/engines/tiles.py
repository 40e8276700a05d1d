"""Fourier Gaussian process in tiles, each conditioned on the points within it and a halo around it."""

import time
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from survey.core.arrays import BoolArray, Bounds, FloatArray, IntArray, Progress
from survey.core.errors import CapacityError, InputError
from survey.reconstruction.gp.covariance.kernels import Kernel
from survey.reconstruction.gp.engines.divided import DividedGaussianProcess, trend_of_part
from survey.reconstruction.gp.engines.fourier.gaussian_process import FourierGaussianProcess
from survey.reconstruction.gp.engines.fourier.resolution import resolve, sharpest_std_m
from survey.reconstruction.gp.engines.noisy_values import NoisyValues
from survey.reconstruction.gp.engines.polynomial_trend import TrendName

HALO_LENGTHS = 7.0
"""Width of the halo in length scales; at 7 the map differs from the whole one's by less than a centimetre."""

_LARGEST_HALVINGS = 7
_N_TIMED = 5000
# Every tile is conditioned for the outliers, for the calibration, and for the map.
_PASSES = 3.0


@dataclass(frozen=True, kw_only=True)
class TiledGaussianProcess(DividedGaussianProcess[tuple[int, int], BoolArray]):
    """A process whose tiles are conditioned one after the other, when they are asked.

    Parameters
    ----------
    kernel : Kernel
        Covariance of all tiles.
    data : NoisyValues
        All points.
    site : (xmin, ymin, xmax, ymax)
        What the tiles divide [m].
    n_tiles : (int, int)
        Columns and rows of tiles.
    trend : PolynomialTrend
        A mean surface of the whole site.
    coefficients : (T,) ndarray
        Its coefficients, from a spread part of the points.
    tolerance_m, memory_mb : float
        As for one tile of `FourierGaussianProcess`.

    Notes
    -----
    Neighbouring tiles differ at their seam by up to the error of the halo. No joint
    likelihood exists: `log_marginal_likelihood` is 0.
    """

    site: Bounds
    n_tiles: tuple[int, int]
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
        progress: Progress | None = None,
    ) -> Self:
        """Choose the largest tiles that fit the memory.

        Raises
        ------
        CapacityError
            When not even a tile as small as its halo fits.
        """
        data = NoisyValues.of(xy, values, sigma_m)
        site = data.extent(bounds)
        sharpest = sharpest_std_m(kernel, data.xy, data.noise_m2)
        n_tiles = _tiling(kernel, site, sharpest, tolerance_m=tolerance_m, memory_mb=memory_mb)
        return cls(
            kernel=kernel,
            data=data,
            site=site,
            n_tiles=n_tiles,
            tolerance_m=tolerance_m,
            memory_mb=memory_mb,
            progress=progress,
            **trend_of_part(xy, values, sigma_m, kernel, trend),
        )

    def predict_on_axes(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (H, W) [m] on the nodes of two axes [m]."""
        mean, std = np.empty((len(y), len(x))), np.empty((len(y), len(x)))
        columns, rows = self._index(x, 0), self._index(y, 1)
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
                self._report("tiles of the map", done, self.n_tiles[0] * self.n_tiles[1])
        return mean, std

    def require_settled(self) -> None:
        """Condition the tile with the most points, to check that its mean converges.

        Raises
        ------
        CapacityError
            It does not.
        """
        tile, here = max(self._tiles_of(self.data.xy), key=lambda pair: int(pair[1].sum()))
        self._process_of(tile).predict(self.data.xy[here][:1])

    def record(self) -> dict[str, Any]:
        """Return name and number of tiles for the record."""
        return {**super().record(), "n_tiles": self.n_tiles[0] * self.n_tiles[1]}

    def expected_s(self, x: FloatArray, y: FloatArray) -> float:  # noqa: ARG002
        """Return the expected time [s], from that of the tile with the most points.

        Raises
        ------
        CapacityError
            The tile's mean does not settle.
        """
        tile, here = max(self._tiles_of(self.data.xy), key=lambda pair: int(pair[1].sum()))
        began = time.perf_counter()
        self._process_of(tile).predict(self.data.xy[here][:_N_TIMED])
        seconds = time.perf_counter() - began
        n_tiles = self.n_tiles[0] * self.n_tiles[1]
        return n_tiles * _PASSES * seconds

    def _left_out(self, tile: tuple[int, int], own: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return the leave-one-out mean and variance of the points of a tile, without the trend."""
        inside = own[self._near(tile)]
        mean, variance = self._process_of(tile).leave_one_out()
        return mean[inside], variance[inside]

    def _tiles_of(self, xy: FloatArray) -> list[tuple[tuple[int, int], BoolArray]]:
        """Return the tiles that hold places, each with the mask of its places."""
        column, row = self._index(xy[:, 0], 0), self._index(xy[:, 1], 1)
        tiles = np.unique(np.column_stack([column, row]), axis=0)
        return [((int(c), int(r)), (column == c) & (row == r)) for c, r in tiles]

    def _index(self, coordinate: FloatArray, axis: int) -> IntArray:
        low, high, n = self.site[axis], self.site[axis + 2], self.n_tiles[axis]
        index: IntArray = np.clip(((coordinate - low) / (high - low) * n).astype(np.int64), 0, n - 1)
        return index

    def _bounds(self, tile: tuple[int, int]) -> Bounds:
        low, high = np.array(self.site[:2]), np.array(self.site[2:])
        size = (high - low) / np.array(self.n_tiles)
        corner = low + size * np.array(tile)
        return (*corner.tolist(), *(corner + size).tolist())

    def _near(self, tile: tuple[int, int]) -> BoolArray:
        """Return the mask of the points in a tile and its halo."""
        halo = HALO_LENGTHS * self.kernel.length_scales_m[1]
        xmin, ymin, xmax, ymax = self._bounds(tile)
        x, y = self.data.xy.T
        near: BoolArray = (x >= xmin - halo) & (x <= xmax + halo) & (y >= ymin - halo) & (y <= ymax + halo)
        return near

    def _process_of(self, tile: tuple[int, int]) -> FourierGaussianProcess:
        near = self._near(tile)
        if not near.any():
            raise InputError(
                f"no point lies within {HALO_LENGTHS:g} length scales of the ground about "
                f"{tuple(round(b, 1) for b in self._bounds(tile))}; map a smaller area, or give a longer length scale."
            )
        return FourierGaussianProcess.fit(
            *self._without_trend(near),
            self.kernel,
            bounds=self._bounds(tile),
            tolerance_m=self.tolerance_m,
            memory_mb=self.memory_mb,
        )


def _tiling(
    kernel: Kernel, site: Bounds, sharpest_m: float, *, tolerance_m: float, memory_mb: float
) -> tuple[int, int]:
    """Halve the longer side until a tile with its halo fits."""
    size, n = np.array([site[2] - site[0], site[3] - site[1]]), np.ones(2, dtype=int)
    halo = HALO_LENGTHS * kernel.length_scales_m[1]
    for _ in range(2 * _LARGEST_HALVINGS):
        width, height = size / n + 2 * halo
        try:
            resolve(
                kernel, (0.0, 0.0, width, height), sharpest_m, tolerance_m=tolerance_m, memory_mb=memory_mb
            )
        except CapacityError:
            n[int(np.argmax(size / n))] *= 2
            continue
        return int(n[0]), int(n[1])
    raise CapacityError(
        f"not even a small tile with its halo of {halo:.0f} m fits {memory_mb:.0f} MB; allow more memory or give a "
        "longer shortest length scale."
    )

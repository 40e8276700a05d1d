"""Local Gaussian-process regression: every small tile is mapped from its nearest points.

For large sites on which a rough covariance needs more waves than fit into memory. Points that are dense beside the
length scale screen those farther away (Stein 2002), so a few hundred neighbours determine the surface of a tile.
"""

import time
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy.linalg import cho_solve, lapack
from scipy.spatial import cKDTree

from survey.core.arrays import Bounds, FloatArray, IntArray, Progress
from survey.reconstruction.gp.covariance.kernels import Kernel
from survey.reconstruction.gp.engines.dense_gp import DenseGaussianProcess
from survey.reconstruction.gp.engines.divided import DividedGaussianProcess, trend_of_part
from survey.reconstruction.gp.engines.noisy_values import NoisyValues
from survey.reconstruction.gp.engines.polynomial_trend import TrendName
from survey.reconstruction.gp.engines.site_tree import SiteTree

_N_NEAREST = 256
_N_OWN = 48
_N_TIMED = 40
# The leave-one-out pass, and that of the calibration, which predicts a sixth of the points.
_PASSES_OVER_POINTS = 1.6


@dataclass(frozen=True, kw_only=True)
class LocalGaussianProcess(DividedGaussianProcess[int, IntArray]):
    """A process whose tiles are conditioned on their 256 nearest points.

    Parameters
    ----------
    kernel : Kernel
        Covariance of all tiles.
    data : NoisyValues
        All points.
    tree : SiteTree
        Tiles of the site, with 48 points or fewer each.
    trend : PolynomialTrend
        Mean surface of the site.
    coefficients : (T,) ndarray
        Its coefficients, from an evenly spaced part of the points.
    progress : callable, optional
        Called with what is done, the number of tiles done, and their number.

    Notes
    -----
    Neighbouring tiles differ a little at their seam, more so where points are sparse. The variance is that
    given the neighbours, never smaller than that given all points. There is no joint likelihood.
    """

    tree: SiteTree

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
        progress: Progress | None = None,
    ) -> Self:
        """Divide the site into tiles; points are conditioned on when a tile is asked for."""
        data = NoisyValues.of(xy, values, sigma_m)
        tree = SiteTree.of(data.xy, data.extent(bounds), _N_OWN)
        shape = trend_of_part(xy, values, sigma_m, kernel, trend)
        return cls(kernel=kernel, data=data, tree=tree, progress=progress, **shape)

    def predict_on_axes(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (H, W) [m] on the nodes of two axes [m], x rising and y falling."""
        mean, std = np.empty((len(y), len(x))), np.empty((len(y), len(x)))
        for tile in range(len(self.tree)):
            rows, columns = self.tree.nodes_in(tile, x, y)
            if rows.start < rows.stop and columns.start < columns.stop:
                nodes = np.stack(np.meshgrid(x[columns], y[rows]), axis=-1)
                trend = self._trend_at(nodes)
                height, spread = self._process_of(tile).predict_on_axes(x[columns], y[rows])
                mean[rows, columns], std[rows, columns] = height + trend, spread
            self._report("tiles of the map", tile + 1, len(self.tree))
        return mean, std

    def record(self) -> dict[str, Any]:
        """Return name, number of tiles and of neighbours for the record."""
        return {**super().record(), "n_tiles": len(self.tree), "n_neighbours": _N_NEAREST}

    def expected_s(self, x: FloatArray, y: FloatArray) -> float:
        """Return the expected time [s], from that of a few tiles."""
        groups = self._tiles_of(self.data.xy)
        some = groups[:: max(len(groups) // _N_TIMED, 1)]
        n_each = max(len(x) * len(y) // len(self.tree), 1)
        self._left_out(*groups[0])  # the first call prepares what the others find ready
        began = time.perf_counter()
        for tile, here in some:
            self._left_out(tile, here)
        between = time.perf_counter()
        for tile, here in some:
            self._process_of(tile).predict(np.resize(self.data.xy[here], (n_each, 2)))
        ended = time.perf_counter()
        over_points, over_nodes = (between - began) / len(some), (ended - between) / len(some)
        return len(groups) * _PASSES_OVER_POINTS * over_points + len(self.tree) * over_nodes

    def _left_out(self, tile: int, own: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the leave-one-out mean and variance of the points of a tile, without the trend."""
        near = self._near(tile, own)
        local = self._conditioned(near)
        inverse, _ = lapack.dpotri(local.factor, lower=1)
        at = np.searchsorted(near, own)
        variance = 1.0 / np.diag(inverse)[at]
        weights = cho_solve((local.factor, True), local.data.values, check_finite=False)[at]
        return local.data.values[at] - weights * variance, variance

    def _process_of(self, tile: int) -> DenseGaussianProcess:
        return self._conditioned(self._near(tile))

    def _conditioned(self, near: IntArray) -> DenseGaussianProcess:
        return DenseGaussianProcess.fit(*self._without_trend(near), self.kernel)

    def _near(self, tile: int, own: IntArray | None = None) -> IntArray:
        """Return the numbers of the points nearest to a tile's centre, with given ones, in ascending order."""
        k = min(_N_NEAREST, len(self.data))
        nearest = np.atleast_1d(self._points.query(self.tree.centre(tile), k=k)[1]).astype(np.int64)
        return np.unique(nearest if own is None else np.concatenate([nearest, own]))

    @cached_property
    def _points(self) -> cKDTree:
        return cKDTree(self.data.xy)

    def _tiles_of(self, xy: FloatArray) -> list[tuple[int, IntArray]]:
        """Return the tiles that hold places (M, 2), each with the numbers of its places."""
        tile = self.tree.tile_of(xy)
        order = np.argsort(tile, kind="stable")
        tiles, starts = np.unique(tile[order], return_index=True)
        return list(zip(tiles.tolist(), np.split(order, starts[1:]), strict=True))

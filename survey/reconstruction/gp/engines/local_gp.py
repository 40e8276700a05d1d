"""Gaussian-process regression of large sites with rough covariances: each small tile from its nearest points.

A `SiteTree` divides the site into small tiles. Points that are dense beside the length scale screen those farther away
(Stein 2002), so that a tile needs few. Neighbouring tiles differ a little at their seam, and there is no joint likelihood.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from scipy.linalg import blas, lapack
from scipy.spatial import cKDTree

from survey.core import Bounds, FloatArray, IntArray, Progress
from survey.reconstruction.gp.engines.covariance_table import CovarianceTable
from survey.reconstruction.gp.engines.regression import NoisyValues, TrendName, factorized
from survey.reconstruction.gp.engines.spline_grid import TOLERANCE, spline_weights
from survey.reconstruction.gp.engines.tiled_gp import DividedGaussianProcess, trend_of_part
from survey.reconstruction.gp.engines.tiles import N_NEAREST, SiteTree
from survey.reconstruction.gp.kernels import Kernel

_N_OWN = 48
_N_TIMED_TILES = 40
# The leave-one-out pass, and that of the calibration, which predicts some of the points.
_PASSES_OVER_POINTS = 1.2
# Places at once, which bounds the memory of their covariance with the points of a tile.
_BLOCK = 1000
# Places across a tile between which a spline gives the nodes, the fewest first, and tiles in which they are compared.
_ACROSS, _N_COMPARED_TILES = (8, 11, 16, 22), 24


class Neighbourhood(NamedTuple):
    """Points (N, 2) [m] about a tile, the lower factor (N, N) of their covariance, and their whitened values (N,)."""

    covariance: CovarianceTable
    xy: FloatArray
    factor: FloatArray
    whitened: FloatArray

    @classmethod
    def of(cls, covariance: CovarianceTable, data: NoisyValues) -> Self:
        """Condition on values about 0."""
        matrix = covariance.among(data.xy)
        matrix[np.diag_indices(len(data))] += data.noise_m2
        factor = factorized(matrix)
        return cls(covariance, data.xy, factor, blas.dtrsv(factor, data.values, lower=1))

    def predict(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean [m] and variance [m²] (M,) at places (M, 2) [m]."""
        mean, variance = np.empty(len(xy)), np.empty(len(xy))
        for first in range(0, len(xy), _BLOCK):
            block = slice(first, first + _BLOCK)
            prior = self.covariance.between(self.xy, xy[block])
            half = blas.dtrsm(1.0, self.factor, prior, lower=1, overwrite_b=1)
            mean[block] = self.whitened @ half
            variance[block] = self.covariance.kernel.variance_m2 - np.einsum("ij,ij->j", half, half)
        return mean, np.maximum(variance, 0.0)

    def gradient(self, xy: FloatArray) -> FloatArray:
        """Return the slope (M, 2) of the mean [m/m], by central differences of a thousandth of a length scale."""
        step = 1e-3 * self.covariance.kernel.length_scales_m[0]
        shifts = step * np.eye(2)
        slopes = [(self.predict(xy + s)[0] - self.predict(xy - s)[0]) / (2.0 * step) for s in shifts]
        return np.stack(slopes, axis=-1)

    def left_out(self, n_last: int) -> tuple[FloatArray, FloatArray]:
        """Return what the others predict for each of the last points, less its value, and the variance (n,).

        Their rows of the inverse need the last rows of the factor alone (Rasmussen and Williams 2006, Eqs. 5.10-5.12).
        """
        inverse, _ = lapack.dtrtri(np.tril(self.factor[-n_last:, -n_last:]), lower=1)
        variance = 1.0 / np.einsum("ij,ij->j", inverse, inverse)
        return -(self.whitened[-n_last:] @ inverse) * variance, variance


@dataclass(frozen=True, kw_only=True)
class LocalGaussianProcess(DividedGaussianProcess[int, IntArray]):
    """A process whose tiles are conditioned on their 256 nearest points.

    `kernel`: covariance of all tiles. `data`: all points. `tree`: tiles of the site, with 48 points or fewer
    each. `trend`: mean surface of the site. `coefficients` (T,): its coefficients, from an evenly spaced part
    of the points. `progress`: called with what is done, the number of tiles done, and their number.

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
        """Divide the site into tiles; points are conditioned on when a tile is needed."""
        data = NoisyValues.of(xy, values, sigma_m)
        tree = SiteTree.of(data.xy, data.extent(bounds), _N_OWN)
        shape = trend_of_part(xy, values, sigma_m, kernel, trend)
        return cls(kernel=kernel, data=data, tree=tree, progress=progress, **shape)

    def predict_on_axes(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (H, W) [m] on the nodes of two axes [m], x rising and y falling.

        Where nodes are dense beside the points, a bicubic spline gives them between fewer places. Their number is the
        smallest for which no node of 24 tiles errs by more than 5 % of its standard deviation.
        """
        mean, std = np.empty((len(y), len(x))), np.empty((len(y), len(x)))
        n_across = self._places_across(x, y)
        for tile in range(len(self.tree)):
            rows, columns = self.tree.nodes_in(tile, x, y)
            if rows.start < rows.stop and columns.start < columns.stop:
                nodes = np.stack(np.meshgrid(x[columns], y[rows]), axis=-1)
                part = self._process_of(tile)
                height, spread = _on_axes(part, x[columns], y[rows], n_across)
                mean[rows, columns], std[rows, columns] = height + self._trend_at(nodes), spread
            self._report("tiles of the map", tile + 1, len(self.tree))
        return mean, std

    def record(self) -> dict[str, Any]:
        """Return name, number of tiles and of neighbours for the record."""
        return {**super().record(), "n_tiles": len(self.tree), "n_neighbours": N_NEAREST}

    def expected_s(self, x: FloatArray, y: FloatArray) -> float:
        """Return the expected time [s], from that of a few tiles."""
        groups = self._tiles_of(self.data.xy)
        some = groups[:: max(len(groups) // _N_TIMED_TILES, 1)]
        n_across = self._places_across(x, y)  # this prepares what the timed calls find ready, too
        began = time.perf_counter()
        for tile, here in some:
            self._left_out(tile, here)
        between = time.perf_counter()
        for tile, _ in some:
            rows, columns = self.tree.nodes_in(tile, x, y)
            _on_axes(self._process_of(tile), x[columns], y[rows], n_across)
        ended = time.perf_counter()
        over_points, over_nodes = (between - began) / len(some), (ended - between) / len(some)
        return len(groups) * _PASSES_OVER_POINTS * over_points + len(self.tree) * over_nodes

    def _places_across(self, x: FloatArray, y: FloatArray) -> int:
        """Return the number of places across a tile between which a spline gives its nodes; that of the nodes where none will do."""
        tiles = range(0, len(self.tree), max(len(self.tree) // _N_COMPARED_TILES, 1))
        compared = []
        for rows, columns, tile in ((*self.tree.nodes_in(tile, x, y), tile) for tile in tiles):
            if rows.start < rows.stop and columns.start < columns.stop:
                part, axes = self._process_of(tile), (x[columns], y[rows])
                compared.append((part, axes, _on_axes(part, *axes, len(x) + len(y))))
        for n_across in _ACROSS:
            if all(
                (np.abs(found - exact) <= TOLERANCE * std).all()
                for part, axes, (mean, std) in compared
                for found, exact in zip(_on_axes(part, *axes, n_across), (mean, std), strict=True)
            ):
                return n_across
        return len(x) + len(y)

    def _left_out(self, tile: int, own: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the leave-one-out mean and variance of the points of a tile, without the trend."""
        others = np.setdiff1d(self._near(tile), own, assume_unique=True)
        residual, variance = self._conditioned(np.concatenate([others, own])).left_out(len(own))
        return self._residual[own] + residual, variance

    def _process_of(self, tile: int) -> Neighbourhood:
        return self._conditioned(self._near(tile))

    def _conditioned(self, near: IntArray) -> Neighbourhood:
        data = NoisyValues(self.data.xy[near], self._residual[near, None], self.data.noise_m2[near])
        return Neighbourhood.of(self._covariance, data)

    def _near(self, tile: int) -> IntArray:
        """Return the numbers of the points nearest to a tile's centre, in ascending order."""
        k = min(N_NEAREST, len(self.data))
        return np.sort(np.atleast_1d(self._points.query(self.tree.centre(tile), k=k)[1]).astype(np.int64))

    @cached_property
    def _points(self) -> cKDTree:
        return cKDTree(self.data.xy)

    @cached_property
    def _residual(self) -> FloatArray:
        """Values (N,) less the trend [m]."""
        residual: FloatArray = self.data.values - self._trend_at(self.data.xy)
        return residual

    @cached_property
    def _covariance(self) -> CovarianceTable:
        return CovarianceTable(self.kernel)

    def _tiles_of(self, xy: FloatArray) -> Sequence[tuple[int, IntArray]]:
        """Return the tiles that hold places (M, 2), each with the numbers of its places."""
        tile = self.tree.tile_of(xy)
        order = np.argsort(tile, kind="stable")
        tiles, starts = np.unique(tile[order], return_index=True)
        return list(zip(tiles.tolist(), np.split(order, starts[1:]), strict=True))


def _on_axes(
    part: Neighbourhood, x: FloatArray, y: FloatArray, n_across: int
) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation (H, W) [m] on even axes by splines between `n_across` places along the longer one."""
    longest = max(len(x), len(y), 2)
    of_x, of_y = (
        spline_weights(len(axis), -(-(len(axis) - 1) * (n_across - 1) // (longest - 1)) + 1)
        for axis in (x, y)
    )
    places = np.stack(
        np.meshgrid(*(np.linspace(a[0], a[-1], w.shape[1]) for a, w in ((x, of_x), (y, of_y)))), axis=-1
    )
    mean, variance = part.predict(places.reshape(-1, 2))
    std = np.sqrt(variance)
    mean, std = (of_y @ values.reshape(places.shape[:2]) @ of_x.T for values in (mean, std))
    return mean, np.maximum(std, 0.0)

"""Gaussian-process regression of large sites with rough covariances: each small tile from its nearest points.

A `SiteTree` divides the site into small tiles. Points that are dense beside the length scale screen those farther away
(Stein 2002), so that a tile needs few. Neighbouring tiles differ a little at their seam, and there is no joint likelihood.

Covariances of pairs of points are looked up in a `CovarianceTable`, a cubic spline between values at even distances: they are
the same function of one distance for millions of neighbourhoods, and exponentials and Bessel functions cost several times as much.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, Self

import numpy as np
from numba import njit
from scipy.interpolate import CubicSpline
from scipy.linalg import blas, lapack
from scipy.spatial import cKDTree

from survey.core import Bounds, FloatArray, IntArray, Progress
from survey.reconstruction.gp.engines.regression import NoisyValues, TrendName, factorized
from survey.reconstruction.gp.engines.spline_grid import TOLERANCE, spline_weights
from survey.reconstruction.gp.engines.tiled_gp import DividedGaussianProcess, trend_of_part
from survey.reconstruction.gp.engines.tiles import N_NEAREST
from survey.reconstruction.gp.families import parts_of
from survey.reconstruction.gp.kernels import Kernel, Stationary

_N_OWN = 48
_N_TIMED_TILES = 40
# The leave-one-out pass, and that of the calibration, which predicts some of the points.
_PASSES_OVER_POINTS = 1.2
# Places at once, which bounds the memory of their covariance with the points of a tile.
_BLOCK = 1000
# Places across a tile between which a spline gives the nodes, the fewest first, and tiles in which they are compared.
_ACROSS, _N_COMPARED_TILES = (8, 10, 12, 14, 16, 18, 20, 22), 24


# A tile is at most this many mean distances of the points wide, however few points it holds.
_WIDEST = 16.0
_MOST_LEVELS = 48


class _Cut(NamedTuple):
    """Division of a node: axis, coordinate [m], and the nodes below and above it; -1 for the axis of a tile."""

    axis: int
    at: float
    below: int
    above: int


@dataclass(frozen=True)
class SiteTree:
    """Tiles of a site.

    `bounds` (K, 4): west, south, east and north of every tile [m]. `cuts` (J, 4): axis, coordinate [m] and
    the two following nodes of every node; axis -1 for a tile, whose number follows. `site` (xmin, ymin, xmax,
    ymax): the site [m].

    >>> tree = SiteTree.of(np.array([[1.0, 1.0], [2.0, 1.0], [9.0, 8.0]]), (0.0, 0.0, 10.0, 10.0), 2)
    >>> len(tree), tree.tile_of(np.array([[1.5, 1.0], [9.0, 9.0]]))
    (2, array([0, 1]))
    """

    bounds: FloatArray
    cuts: FloatArray
    site: Bounds

    @classmethod
    def of(cls, xy: FloatArray, site: Bounds, most: int) -> Self:
        """Halve the longer side of rectangles until none holds more than `most` points or is much too wide."""
        area = (site[2] - site[0]) * (site[3] - site[1])
        widest = _WIDEST * float(np.sqrt(area / len(xy)))
        bounds: list[Bounds] = []
        cuts: list[_Cut] = []
        waiting: list[tuple[Bounds, IntArray, int, int]] = [(site, np.arange(len(xy)), -1, 0)]
        while waiting:
            rectangle, inside, parent, level = waiting.pop()
            if parent >= 0:
                cut = cuts[parent]
                cuts[parent] = (
                    cut._replace(below=len(cuts)) if cut.below < 0 else cut._replace(above=len(cuts))
                )
            width, height = rectangle[2] - rectangle[0], rectangle[3] - rectangle[1]
            is_tile = len(inside) <= most and max(width, height) <= max(widest, 1e-9)
            if is_tile or level == _MOST_LEVELS:
                cuts.append(_Cut(-1, 0.0, len(bounds), -1))
                bounds.append(rectangle)
                continue
            axis = 0 if width >= height else 1
            at = 0.5 * (rectangle[axis] + rectangle[axis + 2])
            cuts.append(_Cut(axis, at, -1, -1))
            is_below = xy[inside, axis] < at
            below, above = list(rectangle), list(rectangle)
            below[axis + 2], above[axis] = at, at
            here = len(cuts) - 1
            waiting.append(((above[0], above[1], above[2], above[3]), inside[~is_below], here, level + 1))
            waiting.append(((below[0], below[1], below[2], below[3]), inside[is_below], here, level + 1))
        return cls(np.array(bounds), np.array(cuts, dtype=np.float64), site)

    def __len__(self) -> int:
        return len(self.bounds)

    def centre(self, tile: int) -> FloatArray:
        """Return the centre (2,) of a tile [m]."""
        centre: FloatArray = 0.5 * (self.bounds[tile, :2] + self.bounds[tile, 2:])
        return centre

    def tile_of(self, xy: FloatArray) -> IntArray:
        """Return the number of the tile (M,) that holds each place; the nearest one for places beyond the site."""
        node = np.zeros(len(xy), dtype=np.int64)
        axis, at = self.cuts[:, 0].astype(np.int64), self.cuts[:, 1]
        below, above = self.cuts[:, 2].astype(np.int64), self.cuts[:, 3].astype(np.int64)
        inner = np.flatnonzero(axis[node] >= 0)
        while inner.size:
            here = node[inner]
            is_below = xy[inner, axis[here]] < at[here]
            node[inner] = np.where(is_below, below[here], above[here])
            inner = inner[axis[node[inner]] >= 0]
        return below[node]

    def nodes_in(self, tile: int, x: FloatArray, y: FloatArray) -> tuple[slice, slice]:
        """Return the rows and columns of the nodes in a tile, on axes x (rising) and y (falling) [m]."""
        west, south, east, north = self.bounds[tile].tolist()
        columns = _span(x, west, east, is_last=east >= self.site[2])
        rising = _span(y[::-1], south, north, is_last=north >= self.site[3])
        return slice(len(y) - rising.stop, len(y) - rising.start), columns


def _span(axis: FloatArray, low: float, high: float, *, is_last: bool) -> slice:
    """Return the part of a rising axis from `low` up to, but without, `high`; with it at the end of the site."""
    first = int(np.searchsorted(axis, low))
    return slice(first, len(axis) if is_last else int(np.searchsorted(axis, high)))


_N_CELLS = 8192
# Cells to the shortest length scale. The spline then errs by less than 1e-5 of the variance for Whittle's kernel, whose second
# derivative is infinite at 0, and by less than 1e-9 for the others.
_FEWEST_TO_LENGTH = 100


@dataclass(frozen=True)
class CovarianceTable:
    """Covariances of a kernel, looked up by the distance in the metric that all its parts share.

    Exact ones where they share none, and where distances are so many length scales that a table would be coarse.
    """

    kernel: Kernel

    def among(self, xy: FloatArray) -> FloatArray:
        """Return the covariance (N, N) [m²] of places (N, 2) [m] in column order; only its lower triangle is meant."""
        places = self._stretched(xy)
        reach_m = _reach_m(places)
        if not self._is_fine(reach_m):
            return self.kernel.covariance(xy, xy).T
        return _look_up_pairs(places, _table(self.kernel, reach_m), _N_CELLS / reach_m).T

    def between(self, xy: FloatArray, others: FloatArray) -> FloatArray:
        """Return the covariance (N, M) [m²] between places (N, 2) and (M, 2) [m], in column order."""
        places = self._stretched(np.concatenate([xy, others]))
        reach_m = _reach_m(places)
        if not self._is_fine(reach_m):
            return self.kernel.covariance(others, xy).T
        n, table = len(xy), _table(self.kernel, reach_m)
        return _look_up(places[n:], places[:n], table, _N_CELLS / reach_m).T

    def _stretched(self, xy: FloatArray) -> FloatArray:
        """Return places (N, 2) along the axes of the anisotropy, stretched so that their plain distances count."""
        if not self._parts or self._parts[0].anisotropy == 1.0:
            return xy
        return self._parts[0].stretched(xy)

    def _is_fine(self, reach_m: float) -> bool:
        """Return whether a table of distances is fine beside the shortest length scale."""
        shortest_m = min((part.length_scale_m for part in self._parts), default=0.0)
        return reach_m * _FEWEST_TO_LENGTH <= shortest_m * _N_CELLS

    @cached_property
    def _parts(self) -> list[Stationary]:
        """The parts of the kernel where they share one metric, or none."""
        parts = [part for part in parts_of(self.kernel) if isinstance(part, Stationary)]
        metrics = {(part.anisotropy, part.anisotropy != 1.0 and part.angle_deg) for part in parts}
        return parts if len(metrics) == 1 and len(parts) == len(parts_of(self.kernel)) else []


def _reach_m(places: FloatArray) -> float:
    """Return a power of two above every distance between places [m], so that few tables are needed."""
    diagonal = max(float(np.hypot(*np.ptp(places, axis=0))), 1e-6)
    return float(2.0 ** (np.floor(np.log2(diagonal)) + 1.0))


@lru_cache(maxsize=16)
def _table(kernel: Kernel, reach_m: float) -> FloatArray:
    """Return the coefficients (8192, 4) of the covariance within each cell of the distance, from 0 to 1 of the cell."""
    distance_m = np.linspace(0.0, reach_m, _N_CELLS + 1)
    values = np.sum(
        [
            part.covariance_of_squared(distance_m**2)
            for part in parts_of(kernel)
            if isinstance(part, Stationary)
        ],
        axis=0,
    )
    spline = CubicSpline(np.arange(_N_CELLS + 1.0), values)
    return np.ascontiguousarray(spline.c[::-1].T)


@njit(cache=True)
def _look_up(a: FloatArray, b: FloatArray, table: FloatArray, cells_per_m: float) -> FloatArray:
    """Return the covariance (A, B) between places."""
    covariance = np.empty((len(a), len(b)))
    for i in range(len(a)):
        _look_up_row(a[i], b, table, cells_per_m, covariance[i])
    return covariance


@njit(cache=True)
def _look_up_pairs(a: FloatArray, table: FloatArray, cells_per_m: float) -> FloatArray:
    """Return the upper triangle of the covariance (A, A) of places."""
    covariance = np.empty((len(a), len(a)))
    for i in range(len(a)):
        _look_up_row(a[i], a[i:], table, cells_per_m, covariance[i, i:])
    return covariance


@njit(cache=True)
def _look_up_row(
    place: FloatArray, others: FloatArray, table: FloatArray, cells_per_m: float, row: FloatArray
) -> None:
    for j in range(len(others)):
        east, north = others[j, 0] - place[0], others[j, 1] - place[1]
        at = np.sqrt(east * east + north * north) * cells_per_m
        cell = min(int(at), len(table) - 1)
        u = at - cell
        row[j] = table[cell, 0] + u * (table[cell, 1] + u * (table[cell, 2] + u * table[cell, 3]))


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
            if rows.start < rows.stop and columns.start < columns.stop:
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
    axes = (
        axis if of.shape[1] == len(axis) else np.linspace(axis[0], axis[-1], of.shape[1])
        for axis, of in ((x, of_x), (y, of_y))
    )
    places = np.stack(np.meshgrid(*axes), axis=-1)
    mean, variance = part.predict(places.reshape(-1, 2))
    std = np.sqrt(variance)
    mean, std = (of_y @ values.reshape(places.shape[:2]) @ of_x.T for values in (mean, std))
    return mean, np.maximum(std, 0.0)

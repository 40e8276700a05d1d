"""Gaussian-process regression of large sites in tiles: Fourier waves with a halo, or the nearest points of each tile.

`DividedGaussianProcess` is the base of both: tiles are conditioned one after the other, about one trend of the site.
`TiledGaussianProcess` conditions each tile in Fourier waves on the points within it and a halo around it.
`LocalGaussianProcess` serves rough covariances that need more waves than fit into memory. `SiteTree` divides the site into
small tiles, and each is mapped from its nearest points: points that are dense beside the length scale screen those farther
away (Stein 2002). Neighbouring tiles differ a little at their seam, and there is no joint likelihood.
"""

import time
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Generic, NamedTuple, Self, TypeVar

import numpy as np
from scipy.linalg import cho_solve, lapack
from scipy.spatial import cKDTree

from survey.core.arrays import BoolArray, Bounds, FloatArray, IntArray, Progress
from survey.core.errors import CapacityError, InputError
from survey.reconstruction.gp.engines.fourier_basis import resolve, sharpest_std_m
from survey.reconstruction.gp.engines.fourier_gp import FourierGaussianProcess
from survey.reconstruction.gp.engines.regression import (
    DenseGaussianProcess,
    NoisyValues,
    PolynomialTrend,
    Process,
    TrendName,
)
from survey.reconstruction.gp.kernels import Kernel

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


HALO_LENGTHS = 7.0
"""Width of the halo in length scales; at 7 the map differs from the whole one's by less than a centimetre."""

_LARGEST_HALVINGS = 7
_N_TIMED_POINTS = 5000
# Every tile is conditioned for the outliers, for the calibration, and for the map.
_PASSES_OVER_TILES = 3.0


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
        self._process_of(tile).predict(self.data.xy[here][:_N_TIMED_POINTS])
        seconds = time.perf_counter() - began
        n_tiles = self.n_tiles[0] * self.n_tiles[1]
        return n_tiles * _PASSES_OVER_TILES * seconds

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

    Parameters
    ----------
    bounds : (K, 4) ndarray
        West, south, east and north of every tile [m].
    cuts : (J, 4) ndarray
        Axis, coordinate [m] and the two following nodes of every node; axis -1 for a tile, whose number follows.
    site : (xmin, ymin, xmax, ymax)
        The site [m].

    Examples
    --------
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


_N_NEAREST = 256
_N_OWN = 48
_N_TIMED_TILES = 40
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
        some = groups[:: max(len(groups) // _N_TIMED_TILES, 1)]
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

"""Division of large sites into tiles: a grid of equal tiles with a halo, and a tree of small tiles by their points.

`TileGrid` halves the longer side of the tiles until the waves of one with its halo fit into memory. `SiteTree` halves
rectangles until none holds more than a few dozen points.
"""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from survey.core import BoolArray, Bounds, FloatArray, IntArray
from survey.reconstruction.gp.engines.fourier_basis import resolve_within
from survey.reconstruction.gp.kernels import Kernel

HALO_LENGTHS = 7.0
"""Width of the halo in length scales. At 7 the map differs from that of one solve by less than a centimetre; smooth terrain
with precise points reaches far, and 3.4 length scales left errors of 0.56 m, 6.2 of 0.03 m."""
_LARGEST_HALVINGS = 7
N_NEAREST = 256
"""Points on which a small tile is conditioned."""


def halo_m(kernel: Kernel) -> float:
    """Return the width of the halo of a tile [m]."""
    return HALO_LENGTHS * kernel.length_scales_m[1]


@dataclass(frozen=True)
class TileGrid:
    """Equal tiles of a site, in columns and rows.

    `site` (xmin, ymin, xmax, ymax): what the tiles divide [m]. `shape` (int, int): columns and rows of tiles.
    `halo_m`: width of the ground around a tile whose points count for it [m].
    """

    site: Bounds
    shape: tuple[int, int]
    halo_m: float

    @classmethod
    def largest_within(
        cls, kernel: Kernel, site: Bounds, sharpest_m: float, tolerance_m: float, memory_mb: float
    ) -> Self | None:
        """Halve the longer side until a tile with its halo fits the memory; None where no tile does.

        `sharpest_m`: smallest standard deviation of the map [m], see `sharpest_std_m`.
        """
        size, n = np.array([site[2] - site[0], site[3] - site[1]]), np.ones(2, dtype=int)
        halo = halo_m(kernel)
        for _ in range(2 * _LARGEST_HALVINGS):
            width, height = size / n + 2 * halo
            tile = (0.0, 0.0, float(width), float(height))
            if (
                resolve_within(kernel, tile, sharpest_m, tolerance_m=tolerance_m, memory_mb=memory_mb)
                is not None
            ):
                return cls(site, (int(n[0]), int(n[1])), halo)
            n[int(np.argmax(size / n))] *= 2
        return None

    def __len__(self) -> int:
        return self.shape[0] * self.shape[1]

    def index(self, coordinate: FloatArray, axis: int) -> IntArray:
        """Return the columns (`axis` 0) or rows (1) of the tiles that hold coordinates [m]."""
        low, high, n = self.site[axis], self.site[axis + 2], self.shape[axis]
        index: IntArray = np.clip(((coordinate - low) / (high - low) * n).astype(np.int64), 0, n - 1)
        return index

    def bounds(self, tile: tuple[int, int]) -> Bounds:
        """Return the rectangle of a tile [m]."""
        low, high = np.array(self.site[:2]), np.array(self.site[2:])
        size = (high - low) / np.array(self.shape)
        corner = low + size * np.array(tile)
        return (*corner.tolist(), *(corner + size).tolist())

    def holding(self, xy: FloatArray) -> list[tuple[tuple[int, int], BoolArray]]:
        """Return the tiles that hold places (M, 2), each with the mask of its places."""
        column, row = self.index(xy[:, 0], 0), self.index(xy[:, 1], 1)
        tiles = np.unique(np.column_stack([column, row]), axis=0)
        return [((int(c), int(r)), (column == c) & (row == r)) for c, r in tiles]

    def fullest(self, xy: FloatArray) -> tuple[tuple[int, int], BoolArray]:
        """Return the tile that holds the most of some places (M, 2), with their mask."""
        return max(self.holding(xy), key=lambda pair: int(pair[1].sum()))

    def near(self, tile: tuple[int, int], xy: FloatArray) -> BoolArray:
        """Return the mask of the places (M, 2) in a tile and its halo."""
        xmin, ymin, xmax, ymax = self.bounds(tile)
        halo, (x, y) = self.halo_m, xy.T
        near: BoolArray = (x >= xmin - halo) & (x <= xmax + halo) & (y >= ymin - halo) & (y <= ymax + halo)
        return near


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

"""Division of large sites into equal tiles with a halo, whose waves fit into memory."""

from dataclasses import dataclass
from typing import Self

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

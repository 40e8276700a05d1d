"""Test of a map in tiles by the cells that were withheld from it: coverage over the map, and reliability."""

from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtri

from survey.core.arrays import Bounds, FloatArray
from survey.reconstruction.tiled.layout import CellWindow

LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
"""Nominal coverages of the reliability diagram."""
_BLOCK_CELLS, _SMALLEST_BLOCK = 250, 31
_LEAST_CELLS = 10


class WithheldTest(NamedTuple):
    """Errors at withheld cells against the standard deviations that the map states.

    Parameters
    ----------
    n : int
        Withheld cells.
    coverage_95 : float
        Share of them within the 95 % interval; NaN without cells.
    rms_ratio : float
        Root mean square of error over standard deviation.
    reliability : dict of float to float
        Share of the cells within the central interval of each nominal coverage.
    """

    n: int
    coverage_95: float
    rms_ratio: float
    reliability: dict[float, float]

    @classmethod
    def of(cls, error: FloatArray, sigma: FloatArray) -> "WithheldTest":
        """Return the test of errors (N,) with standard deviations (N,) [m]."""
        ratio = np.abs(error) / sigma
        within = {level: float(np.mean(ratio <= ndtri(0.5 + 0.5 * level))) for level in LEVELS if len(ratio)}
        rms = float(np.sqrt(np.mean(ratio**2))) if len(ratio) else float("nan")
        return cls(len(ratio), within.get(0.95, float("nan")), rms, within)

    def facts(self) -> dict[str, Any]:
        """Return the test for the record."""
        return {
            "n_withheld": self.n,
            "coverage_95": self.coverage_95,
            "rms_ratio": self.rms_ratio,
            "reliability": [[nominal, found] for nominal, found in self.reliability.items()],
        }


class CoverageMap(NamedTuple):
    """Share of withheld cells within the 95 % interval over blocks of cells.

    Parameters
    ----------
    share : (H, W) ndarray
        The first row is the southern one; NaN with fewer than ten cells.
    blocks : CellWindow
        The blocks, counted in blocks from the origin of the CRS.
    side_m : float
        Side of a block [m].
    """

    share: FloatArray
    blocks: CellWindow
    side_m: float

    @property
    def bounds(self) -> Bounds:
        """West, south, east and north edge [m]."""
        west, south, columns, rows = (n * self.side_m for n in self.blocks)
        return west, south, west + columns, south + rows


def coverage_map(tested: FloatArray, extent: CellWindow, cell_m: float) -> CoverageMap:
    """Return how often the 95 % intervals held the withheld cells, in blocks of 250 cells, fewer on small maps.

    Parameters
    ----------
    tested : (N, 4) ndarray
        Easting, northing, error and standard deviation [m].
    extent : CellWindow
        Cells of the map.
    cell_m : float
        Side of a cell [m].

    Returns
    -------
    CoverageMap
        Shares and blocks.
    """
    n = _BLOCK_CELLS
    while n > _SMALLEST_BLOCK and min(extent.shape) < 2 * n:
        n //= 2
    blocks = CellWindow(
        extent.west // n,
        extent.south // n,
        (extent.west + extent.columns - 1) // n - extent.west // n + 1,
        (extent.south + extent.rows - 1) // n - extent.south // n + 1,
    )
    column, row = np.floor(tested[:, :2].T / (cell_m * n)).astype(np.int64)
    flat = np.clip(row - blocks.south, 0, blocks.rows - 1) * blocks.columns
    flat = flat + np.clip(column - blocks.west, 0, blocks.columns - 1)
    inside = np.abs(tested[:, 2]) <= ndtri(0.975) * tested[:, 3]
    count = np.bincount(flat, minlength=blocks.rows * blocks.columns)
    total = np.bincount(flat, inside, blocks.rows * blocks.columns)
    share: FloatArray = np.full(len(count), np.nan)
    np.divide(total, count, out=share, where=count >= _LEAST_CELLS)
    return CoverageMap(share.reshape(blocks.shape), blocks, n * cell_m)

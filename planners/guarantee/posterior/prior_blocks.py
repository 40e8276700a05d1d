r"""Likelihood of covariances given blocks of cells of a prior, by restricted likelihood about a plane.

What a cell shows is the mean over a square of the product's effective resolution. Blocks of neighbouring cells
are taken as independent of one another, so that a prior of any size is read at its own resolution.

.. math::  -2 \log p = (n - 3 b) \log \hat s^2 + \sum_b \left( \log |C_b| + \log |H_b^T C_b^{-1} H_b| \right)

for b blocks with n cells in all, each about a plane H of its own (Patterson and Thompson 1971).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely
from scipy.linalg import lapack

from survey.core.arrays import BoolArray, FloatArray, IntArray
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.reconstruction.gp.kernels import Kernel

RESOLUTION_CELLS = 2.0
"""Width of what a cell of a coarse product shows, in cells: products resolve two to three of their cells."""

_SIDE = 10
_MOST_BLOCKS = 6
_LEAST_CELLS = 9
_PLACES_ALONG = 4


class Block(NamedTuple):
    """Neighbouring cells: their rows, columns and heights (N,) [m]."""

    row: IntArray
    column: IntArray
    height_m: FloatArray


class Fit(NamedTuple):
    """Variance of the terrain [m²] that suits a covariance best, the log likelihood, and the degrees of freedom."""

    variance_m2: float
    log_likelihood: float
    n_free: int


@dataclass(frozen=True, eq=False)
class PriorBlocks:
    """Blocks of cells of a prior on an area.

    Parameters
    ----------
    blocks : sequence of Block
        Cells, at most 100 each.
    cell_m : float
        Width of a cell [m].
    resolution_cells : float
        Width of what a cell shows, in cells.
    """

    blocks: Sequence[Block]
    cell_m: float
    resolution_cells: float = RESOLUTION_CELLS

    @classmethod
    def of(cls, area: SurveyArea, prior: Dem, resolution_cells: float = RESOLUTION_CELLS) -> "PriorBlocks":
        """Take up to six blocks of ten by ten cells, spread evenly over an area.

        Parameters
        ----------
        area : SurveyArea
            Cells whose centres lie on it, or within one cell of it, are used.
        prior : Dem
            Coarse elevations of any size.
        resolution_cells : float
            Width of what a cell shows, in cells.

        Returns
        -------
        PriorBlocks
            With at least nine cells.

        Raises
        ------
        InputError
            Fewer than nine cells with a height on the area.
        """
        half = 0.5 * prior.step_m
        xmin, ymin, xmax, ymax = area.bounds
        near = prior.window((xmin - half, ymin - half, xmax + half, ymax + half))
        known = np.isfinite(near.elevation)
        if known.sum() > 4 * _LEAST_CELLS:
            about = area.free.buffer(prior.step_m)
            shapely.prepare(about)
            known &= shapely.contains_xy(about, near.xy).reshape(known.shape)
        if known.sum() < _LEAST_CELLS:
            raise InputError(
                f"the prior has {int(known.sum())} known cells on the area; at least {_LEAST_CELLS} are needed to estimate how the "
                "terrain varies, take a finer prior."
            )
        blocks = sorted(_blocks(known, near.elevation), key=lambda block: -len(block.row))
        large = [block for block in blocks if len(block.row) >= 0.5 * len(blocks[0].row)]
        chosen = np.linspace(0, len(large) - 1, min(len(large), _MOST_BLOCKS)).round().astype(int)
        return cls([large[index] for index in chosen], prior.step_m, resolution_cells)

    @cached_property
    def extent_m(self) -> float:
        """Longest side of a block [m]."""
        return self.cell_m * float(max(max(np.ptp(b.row), np.ptp(b.column)) + 1 for b in self.blocks))

    @property
    def typical_error_m(self) -> float:
        """White error that cells of this width typically have: half a metre at 30 m [m]."""
        return 0.5 * float(np.sqrt(self.cell_m / 30.0))

    @cached_property
    def relief_m(self) -> float:
        """Standard deviation of the cells' heights about the planes of their blocks [m]."""
        rest = [
            block.height_m - basis @ (np.linalg.pinv(basis) @ block.height_m) for block, basis in self._bases
        ]
        return float(np.sqrt(np.mean(np.square(np.concatenate(rest)))))

    @cached_property
    def slope(self) -> float:
        """Root mean square slope of the planes through the blocks, rise over run."""
        rises = [(np.linalg.pinv(_plane(block)) @ block.height_m)[1:] for block in self.blocks]
        return float(np.sqrt(np.mean([np.square(rise).sum() for rise in rises]))) / self.cell_m

    def fit(self, kernel: Kernel, ratio: float) -> Fit | None:
        """Return the likeliest variance for a covariance of unit variance, with white errors of the cells.

        Parameters
        ----------
        kernel : Kernel
            Covariance of variance 1 m².
        ratio : float
            Variance of a cell's error over that of the terrain.

        Returns
        -------
        Fit or None
            None where rounding makes a covariance indefinite.
        """
        parts = [self._part(block, basis, kernel, ratio) for block, basis in self._bases]
        known = [part for part in parts if part is not None]
        if len(known) < len(parts):
            return None
        squared = sum(part[0] for part in known)
        n_free = sum(part[1] for part in known)
        variance = max(squared / n_free, 1e-12)
        log_likelihood = sum(part[2] for part in known) - 0.5 * n_free * float(np.log(variance))
        return Fit(variance, log_likelihood, n_free)

    @cached_property
    def _bases(self) -> list[tuple[Block, FloatArray]]:
        """Blocks with the plane (N, 3) that each varies about, or a constant (N, 1) where there are few cells."""
        found = []
        for block in self.blocks:
            plane = _plane(block)
            is_plane = len(plane) >= 2 * _LEAST_CELLS and np.linalg.matrix_rank(plane) == 3
            found.append((block, plane if is_plane else plane[:, :1]))
        return found

    def _part(
        self, block: Block, basis: FloatArray, kernel: Kernel, ratio: float
    ) -> tuple[float, int, float] | None:
        """Return squared residual, degrees of freedom and log determinants of one block."""
        matrix = self._covariance(block, kernel)
        matrix[np.diag_indices(len(matrix))] += ratio + 1e-8
        factor, failed = lapack.dpotrf(matrix.T, lower=1, clean=1)
        if failed:
            return None
        half = lapack.dtrtrs(factor, np.column_stack([basis, block.height_m]), lower=1)[0]
        q, r = np.linalg.qr(half[:, :-1])
        rest = half[:, -1] - q @ (q.T @ half[:, -1])
        logs = -np.log(np.diag(factor)).sum() - np.log(np.abs(np.diag(r))).sum()
        return float(rest @ rest), len(matrix) - basis.shape[1], float(logs)

    def _covariance(self, block: Block, kernel: Kernel) -> FloatArray:
        """Return the covariance (N, N) of what the cells of a block show, by how many rows and columns they are apart."""
        lags, weights = self._within
        down, right = np.arange(np.ptp(block.row) + 1), np.arange(np.ptp(block.column) + 1)
        steps = self.cell_m * np.stack(np.meshgrid(right, down), axis=-1)
        table = kernel.covariance_of_lag(steps[:, :, None, :] + lags) @ weights
        apart = np.abs(block.row[:, None] - block.row), np.abs(block.column[:, None] - block.column)
        covariance: FloatArray = table[apart]
        return covariance

    @cached_property
    def _within(self) -> tuple[FloatArray, FloatArray]:
        """Lags (K, 2) [m] between the places of one cell and those of another at the same spot, and their shares (K,)."""
        share = (np.arange(_PLACES_ALONG) + 0.5) / _PLACES_ALONG - 0.5
        offsets = self.resolution_cells * self.cell_m * np.stack(np.meshgrid(share, share), axis=-1)
        flat = offsets.reshape(-1, 2)
        lags = (flat[:, None] - flat).reshape(-1, 2)
        distinct, counts = np.unique(np.round(lags, 6), axis=0, return_counts=True)
        return distinct, counts / len(lags)


def _plane(block: Block) -> FloatArray:
    """Return the design (N, 3) of a plane: 1, rows and columns about their means."""
    row, column = block.row - block.row.mean(), block.column - block.column.mean()
    return np.column_stack([np.ones(len(row)), row, column])


def _blocks(known: BoolArray, height_m: FloatArray) -> Iterator[Block]:
    """Yield the blocks of a grid that hold enough known cells; all cells as one block where they are few."""
    rows, columns = known.shape
    n_down, n_right = max(rows // _SIDE, 1), max(columns // _SIDE, 1)
    is_small = int(known.sum()) <= (_SIDE + 2) ** 2
    for part in [(0, rows, 0, columns)] if is_small else _tiles(rows, columns, n_down, n_right):
        top, bottom, left, right = part
        row, column = np.nonzero(known[top:bottom, left:right])
        if len(row) >= _LEAST_CELLS:
            yield Block(row, column, height_m[top + row, left + column])


def _tiles(rows: int, columns: int, n_down: int, n_right: int) -> list[tuple[int, int, int, int]]:
    """Return the bounds of the blocks of a grid: first and last row, first and last column."""
    down = [(i * _SIDE, rows if rows < _SIDE else (i + 1) * _SIDE) for i in range(n_down)]
    right = [(j * _SIDE, columns if columns < _SIDE else (j + 1) * _SIDE) for j in range(n_right)]
    return [(*a, *b) for a in down for b in right]

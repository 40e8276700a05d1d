r"""Fit of covariances to the cells of a prior: restricted likelihood of blocks of cells, each about a plane.

A cell shows the mean over a square of the product's effective resolution. Blocks of neighbouring cells are taken as
independent of one another, so that a prior of any size is read at its own resolution.

.. math::  -2 \log p = (n - 3 b) \log \hat s^2 + \sum_b \left( \log |C_b| + \log |H_b^T C_b^{-1} H_b| \right)

for b blocks with n cells in all, each about a plane H of its own (Patterson and Thompson 1971). `fitted_family` weighs
the length scales, resolutions and errors of the cells of one family by this likelihood, and by the roughness of other
ground that is as steep.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely
from scipy.linalg import lapack

from planners.guarantee.requirement import roughness_elsewhere
from survey.core.arrays import BoolArray, FloatArray, IntArray
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.reconstruction.gp.families import SearchedFamily
from survey.reconstruction.gp.kernel_search import Cell
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


_LENGTHS_PER_DOUBLING = 2


# Variances of a cell's error over that of the terrain: up to cells that show errors alone.
_RATIOS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)


# Widths of what a cell shows, in cells: products resolve two to three of theirs, and do not state how many.
_RESOLUTIONS = (2.0, 3.0)


class FittedFamily(NamedTuple):
    """The likeliest length scale (in a cell) of a family, a variance [m²], mean and spread of the log roughness [log m]."""

    cell: Cell
    variance_m2: float
    log_roughness: float
    spread: float


class _Weighed(NamedTuple):
    """A length scale (in a cell), the variance that suits it best [m²], and what the cells say of the roughness there.

    The logarithm of the roughness [log m] is normal with a mean and a variance; `log_likelihood` is the evidence.
    """

    cell: Cell
    variance_m2: float
    log_likelihood: float
    fitted: float
    mean: float
    variance: float


def fitted_family(blocks: PriorBlocks, family: SearchedFamily) -> FittedFamily:
    """Return the likeliest length scale (in a cell) of one family, a variance [m²], and the spread of the roughness.

    The roughness is the standard deviation of a difference of heights over half a cell: what decides the error between
    swaths. The variance is that with which the covariance has the mean logarithm of the roughness, over all lengths,
    resolutions and errors of the cells; the spread is its standard deviation.
    """
    weighed = list(_weighed(blocks, family))
    if not weighed:
        raise InputError("the prior's cells fit no covariance; take a prior whose heights differ.")
    best = max(weighed, key=lambda one: one.log_likelihood)
    weights = np.exp([one.log_likelihood - best.log_likelihood for one in weighed])
    weights /= weights.sum()
    means = np.array([one.mean for one in weighed])
    mean = float(weights @ means)
    spread = float(np.sqrt(weights @ (np.square(means - mean) + [one.variance for one in weighed])))
    variance_m2 = best.variance_m2 * float(np.exp(2.0 * (mean - best.fitted)))
    return FittedFamily(best.cell, variance_m2, mean, spread)


def _weighed(blocks: PriorBlocks, family: SearchedFamily) -> Iterator[_Weighed]:
    """Yield the fits of all resolutions, length scales and errors of the cells."""
    first, last = np.log2(2.0 * blocks.cell_m), np.log2(2.0 * blocks.extent_m)
    half_cell = np.array([0.5 * blocks.cell_m, 0.0])
    for resolution_cells in _RESOLUTIONS:
        shown = replace(blocks, resolution_cells=resolution_cells)
        for length in np.exp2(np.arange(first, last + 0.01, 1.0 / _LENGTHS_PER_DOUBLING)):
            cell = Cell.of(family, float(length), 0.0)
            lost = 1.0 - float(cell.kernel(1.0).covariance_of_lag(half_cell))
            for ratio in _RATIOS:
                fit = shown.fit(cell.kernel(1.0), ratio)
                if fit is not None:
                    yield _with_roughness(shown, cell, ratio, fit, lost)


def _with_roughness(blocks: PriorBlocks, cell: Cell, ratio: float, fit: Fit, lost: float) -> _Weighed:
    """Weigh one fit by the typical error of cells, and by the roughness of ground elsewhere that is as steep."""
    error_m = np.sqrt(ratio * fit.variance_m2)
    log = fit.log_likelihood - 0.5 * float(np.log(error_m / blocks.typical_error_m) ** 2)
    roughness = 0.5 * float(np.log(2.0 * max(lost, 1e-12) * fit.variance_m2))
    elsewhere = roughness_elsewhere(0.5 * blocks.cell_m, blocks.slope)
    # The logarithm of a standard deviation from n free values has a variance of 1 / (2 n). Cells within one width of
    # what a cell shows are one value.
    own = 0.5 * blocks.resolution_cells**2 / fit.n_free
    total = own + elsewhere.variance
    log -= 0.5 * ((roughness - elsewhere.mean) ** 2 / total + float(np.log(total)))
    mean = (roughness * elsewhere.variance + elsewhere.mean * own) / total
    return _Weighed(cell, fit.variance_m2, log, roughness, mean, own * elsewhere.variance / total)

r"""Posterior distribution of the terrain's covariance, from the cells of a prior or from a survey.

`PriorBlocks.fits` is the restricted likelihood of a covariance, from blocks of cells of a prior. A cell shows the mean
over a square of the product's effective resolution. Blocks of neighbouring cells are taken as independent of one
another, so that a prior of any size is read at its own resolution.

.. math::  -2 \log p = (n - 3 b) \log \hat s^2 + \sum_b \left( \log |C_b| + \log |H_b^T C_b^{-1} H_b| \right)

for b blocks with n cells in all, each about a plane H of its own (Patterson and Thompson 1971). `fitted_family` weighs
the length scales, resolutions and errors of the cells of one family by this likelihood, and by the roughness of other
ground that is as steep.

`KernelPosterior` is a weighted list of covariances. `posterior_from_prior` fits them to the cells and adds the class of
surface, `posterior_from_survey` fits them to samples. Samples are near one another along the lines, and the error of a
map is made between them, where the ground may be smoother or rougher. `checked_by_lines` therefore predicts each line
from all others. With the inverse A of the covariance of all samples, about a constant mean, the residuals of line b and
their covariance are

.. math::  e_b = A_{bb}^{-1} (A y)_b, \qquad C_b = A_{bb}^{-1}

(Dubrule 1983, Mathematical Geology 15, 687). The mean square of the residuals over that expected gives a factor of the
roughness; its logarithm is weighed against 0 by how many independent values the residuals hold.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
import shapely
from scipy.linalg import cho_factor, cho_solve, lapack

from planners.prediction.assumptions import SURFACES, MapAssumptions, Surface, roughness_elsewhere
from planners.prediction.places import slope_length_m
from survey import Dem, InputError, SurveyArea
from survey.core import BoolArray, FloatArray, IntArray
from survey.reconstruction.gp.families import SearchedFamily
from survey.reconstruction.gp.kernel_search import ALL, Cell, KernelSearch
from survey.reconstruction.gp.kernels import Kernel

RESOLUTION_CELLS = 2.0
"""Width of what a cell of a coarse product shows, in cells: products resolve two to three of their cells."""

# Blocks of ten by ten cells, of which six are used: a covariance of 100 cells is factorized for each length scale.
_SIDE = 10
_MOST_BLOCKS = 6
_LEAST_CELLS = 9
_PLACES_ALONG = 4


class Block(NamedTuple):
    """Neighbouring cells: their rows, columns and heights (N,) [m]."""

    row: IntArray
    column: IntArray
    height_m: FloatArray


class _Layout(NamedTuple):
    """Blocks whose cells lie alike: rows and columns (N,), what each varies about (N, T), heights (N, B) [m]."""

    row: IntArray
    column: IntArray
    basis: FloatArray
    height_m: FloatArray

    @classmethod
    def of(cls, blocks: Sequence[Block]) -> Self:
        """Join blocks; each varies about a plane, or about a constant where there are few cells."""
        plane = _plane(blocks[0])
        is_plane = len(plane) >= 2 * _LEAST_CELLS and np.linalg.matrix_rank(plane) == 3
        heights = np.column_stack([block.height_m for block in blocks])
        return cls(blocks[0].row, blocks[0].column, plane if is_plane else plane[:, :1], heights)


class Fit(NamedTuple):
    """Variance of the terrain [m²] that suits a covariance best, the log likelihood, and the degrees of freedom."""

    variance_m2: float
    log_likelihood: float
    n_free: int


@dataclass(frozen=True, eq=False)
class PriorBlocks:
    """Blocks of cells of a prior on an area.

    `blocks`: cells, at most 100 each. `cell_m`: width of a cell [m]. `resolution_cells`: width of what a cell
    shows, in cells.
    """

    blocks: Sequence[Block]
    cell_m: float
    resolution_cells: float = RESOLUTION_CELLS

    @classmethod
    def of(cls, area: SurveyArea, prior: Dem, resolution_cells: float = RESOLUTION_CELLS) -> "PriorBlocks":
        """Take up to six blocks of ten by ten cells, spread evenly over an area."""
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
            (one.height_m - one.basis @ (np.linalg.pinv(one.basis) @ one.height_m)).ravel()
            for one in self._layouts
        ]
        return float(np.sqrt(np.mean(np.square(np.concatenate(rest)))))

    @cached_property
    def slope(self) -> float:
        """Root mean square slope of the planes through the blocks, rise over run."""
        rises = [(np.linalg.pinv(_plane(block)) @ block.height_m)[1:] for block in self.blocks]
        return float(np.sqrt(np.mean([np.square(rise).sum() for rise in rises]))) / self.cell_m

    def fits(self, kernel: Kernel, ratios: Sequence[float]) -> list[Fit | None]:
        """Return the likeliest variance for a covariance of unit variance, with white errors of the cells, for each ratio.

        `ratios`: variances of the errors over that of the terrain.

        Returns: None where rounding makes a covariance indefinite.
        """
        covariances = [self._covariance(layout, kernel) for layout in self._layouts]
        return [self._fit(covariances, ratio) for ratio in ratios]

    def _fit(self, covariances: list[FloatArray], ratio: float) -> Fit | None:
        """Return the likeliest variance for covariances (N, N) of all layouts."""
        parts = [_part(*pair, ratio) for pair in zip(self._layouts, covariances, strict=True)]
        known = [part for part in parts if part is not None]
        if len(known) < len(parts):
            return None
        squared = sum(part[0] for part in known)
        n_free = sum(part[1] for part in known)
        variance = max(squared / n_free, 1e-12)
        log_likelihood = sum(part[2] for part in known) - 0.5 * n_free * float(np.log(variance))
        return Fit(variance, log_likelihood, n_free)

    @cached_property
    def _layouts(self) -> list[_Layout]:
        """Blocks whose cells lie alike, which have one covariance."""
        alike: dict[tuple[bytes, bytes], list[Block]] = {}
        for block in self.blocks:
            alike.setdefault((block.row.tobytes(), block.column.tobytes()), []).append(block)
        return [_Layout.of(blocks) for blocks in alike.values()]

    def _covariance(self, layout: _Layout, kernel: Kernel) -> FloatArray:
        """Return the covariance (N, N) of what the cells of a block show, by how many rows and columns they are apart."""
        row, column = layout.row, layout.column
        lags, weights = self._within
        down, right = np.arange(np.ptp(row) + 1), np.arange(np.ptp(column) + 1)
        steps = self.cell_m * np.stack(np.meshgrid(right, down), axis=-1)
        table = kernel.covariance_of_lag(steps[:, :, None, :] + lags) @ weights
        covariance: FloatArray = table[np.abs(row[:, None] - row), np.abs(column[:, None] - column)]
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


def _part(layout: _Layout, covariance: FloatArray, ratio: float) -> tuple[float, int, float] | None:
    """Return squared residuals, degrees of freedom and log determinants of blocks whose cells lie alike."""
    matrix = covariance.copy()
    matrix[np.diag_indices(len(matrix))] += ratio + 1e-8
    factor, failed = lapack.dpotrf(matrix.T, lower=1, clean=1)
    if failed:
        return None
    half = lapack.dtrtrs(factor, np.column_stack([layout.basis, layout.height_m]), lower=1)[0]
    n_columns, n_blocks = layout.basis.shape[1], layout.height_m.shape[1]
    q, r = np.linalg.qr(half[:, :n_columns])
    rest = half[:, n_columns:] - q @ (q.T @ half[:, n_columns:])
    logs = -np.log(np.diag(factor)).sum() - np.log(np.abs(np.diag(r))).sum()
    return float(np.square(rest).sum()), n_blocks * (len(matrix) - n_columns), n_blocks * float(logs)


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
_RESOLUTIONS = (1.0, 2.0, 3.0)


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
            for ratio, fit in zip(_RATIOS, shown.fits(cell.kernel(1.0), _RATIOS), strict=True):
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


# Four covariances hold nearly all of what the samples leave open.
_MOST_KERNELS = 4


_LEAST_WEIGHT = 0.01


# Spread of errors where the prior is no information: that of the roughness from landscape to landscape.
_PRIOR_SPREAD = 0.8


# Samples of a cluster, counted along the way from its first one, and how many clusters a covariance is learned from.
_LAGS = np.array([0, 1, 3, 7])


_MOST_CLUSTERS = 60


def localized_noise_m(noise_m: float, localization_m: float, kernel: Kernel) -> float:
    r"""Return the error of a sample whose place errs too, east and north by `localization_m` each [m].

    .. math::  \sigma^2 + 2 \, \sigma_{xy}^2 \, v / \lambda^2

    with the variance v of the terrain and its slope length λ, so that v/λ² is the variance of each slope.
    This is the one place where errors of the rover's place enter a predicted error; they are taken
    as independent from sample to sample.

    >>> from survey.reconstruction.gp.kernels import SquaredExponential
    >>> round(localized_noise_m(0.1, 1.0, SquaredExponential(25.0, 100.0)), 3)
    0.122
    """
    slope_variance = kernel.variance_m2 / slope_length_m(kernel) ** 2
    return float(np.sqrt(noise_m**2 + 2.0 * localization_m**2 * slope_variance))


class WeightedKernel(NamedTuple):
    """A covariance that the terrain may have, the error of a sample under it [m], and its weight.

    ``unseen_m2`` is the variance of relief so fine that samples show it as noise: each place of a map misses it. ``known``
    is a covariance of any kind that is given, in place of that of the cell.
    """

    cell: Cell
    variance_m2: float
    noise_m: float
    weight: float
    unseen_m2: float = 0.0
    known: Kernel | None = None

    @classmethod
    def given(cls, kernel: Kernel, noise_m: float) -> Self:
        """Take a covariance that is known [m²], with the error of a sample [m]."""
        nearest = Cell.of("matern-3/2", kernel.length_scales_m[0], 0.0)
        return cls(nearest, kernel.variance_m2, noise_m, 1.0, 0.0, kernel)

    @property
    def kernel(self) -> Kernel:
        """The covariance function [m²]."""
        return self.cell.kernel(self.variance_m2) if self.known is None else self.known

    @property
    def correlation_key(self) -> object:
        """What kernels with the same correlations have in common."""
        return (self.cell.family, self.cell.length) if self.known is None else self.known


@dataclass(frozen=True)
class KernelPosterior:
    """Covariances that the terrain may have, the weightiest first; weights sum to 1.

    `kernels`: the covariances. `spread`: scale of the logarithm of actual over predicted error, on ground
    unlike all of them (Student's distribution). `open_spread`: standard deviation of the logarithm of the
    roughness that the cells leave open (normal distribution).
    """

    kernels: tuple[WeightedKernel, ...]
    spread: float = 0.0
    open_spread: float = 0.0

    @classmethod
    def of(cls, found: list[WeightedKernel]) -> "KernelPosterior":
        """Take the weightiest covariances, and scale their weights."""
        order = sorted(found, key=lambda one: -one.weight)
        chosen = [one for one in order[:_MOST_KERNELS] if one.weight > _LEAST_WEIGHT * order[0].weight]
        total = sum(one.weight for one in chosen)
        return cls(tuple(one._replace(weight=one.weight / total) for one in chosen))

    def with_noise_times(self, factor: float) -> "KernelPosterior":
        """Return the covariances with the errors of samples multiplied by a factor."""
        if factor == 1.0:
            return self
        return replace(
            self, kernels=tuple(one._replace(noise_m=factor * one.noise_m) for one in self.kernels)
        )

    def of_means(self, localization_m: float, n_in_one: float) -> "KernelPosterior":
        """Return the covariances for samples without noise whose place errs [m], each the mean of so many."""
        kernels = []
        for one in self.kernels:
            displaced_m = localized_noise_m(0.0, localization_m, one.kernel)
            kernels.append(
                one._replace(noise_m=float(np.hypot(displaced_m, np.sqrt(one.unseen_m2 / n_in_one))))
            )
        return replace(self, kernels=tuple(kernels))

    @property
    def likeliest(self) -> WeightedKernel:
        """The weightiest covariance."""
        return self.kernels[0]

    @cached_property
    def slope_length_m(self) -> float:
        """Weighted geometric mean of the slope lengths: what waves are measured by [m]."""
        logs = [one.weight * np.log(slope_length_m(one.kernel)) for one in self.kernels]
        return float(np.exp(np.sum(logs)))

    @property
    def growth(self) -> float:
        """Weighted mean of the exponents with which the squared error of a strip grows with its width."""
        return sum(one.weight * (one.cell.kind.error_growth or 0.0) for one in self.kernels)


def posterior_from_prior(
    blocks: PriorBlocks,
    *,
    noise_m: float,
    localization_m: float = 0.0,
    prior_sigma_m: float = 1.0,
    surface: Surface = "unknown",
    micro_relief_m: float | None = None,
    assumed: SearchedFamily | None = None,
) -> KernelPosterior:
    r"""Learn covariances from the cells of a coarse prior, on ground of a class of surface.

    Each family of the class takes its likeliest length scale, and the mean roughness of all. The weights of the
    families are those of the class: cells do not show how rough the terrain is between them. What the cells leave open
    is a factor of the roughness, whose squared spread is the sum of that under all length scales, resolutions and errors
    of the cells, weighted with the roughness of other landscapes, and

    .. math::  0.8^2 \, \left( \frac{r^2}{1 + r^2} \right)^2, \qquad
               r = \sigma_{prior} / \mathrm{sd}(\mathrm{cells})

    so that a worse prior never makes a survey more certain, and one that is older than the ground, with a stated
    deviation of many metres, leaves the roughness as open as it is from landscape to landscape. By the same share, and
    never below that of the cells, the mean moves to the roughness of other landscapes, on ground as steep. The spread of
    the class of surface is a factor of its own.

    `noise_m`, `localization_m`: errors of the samples to come, and of their places [m]. `prior_sigma_m`:
    standard deviation of a cell [m]. `micro_relief_m`: standard deviation of relief finer than the samples
    [m]; that of the class by default.
    """
    chosen = SURFACES[surface]
    weights = chosen.weights if assumed is None else {assumed: 1.0}
    unseen_m = chosen.micro_relief_m if micro_relief_m is None else micro_relief_m
    share = prior_sigma_m**2 / max(prior_sigma_m**2 + blocks.relief_m**2, 1e-12)
    elsewhere = roughness_elsewhere(0.5 * blocks.cell_m, blocks.slope)
    found, open_share = [], 0.0
    for family, weight in weights.items():
        one = fitted_family(blocks, family)
        # Cells that may be wrong by more than they vary do not show that the ground is smoother than elsewhere.
        rougher = share * max(elsewhere.mean - one.log_roughness, 0.0)
        variance_m2 = one.variance_m2 * float(np.exp(2.0 * rougher))
        noise = localized_noise_m(noise_m, localization_m, one.cell.kernel(variance_m2))
        total = float(np.hypot(noise, unseen_m))
        found.append(WeightedKernel(one.cell, variance_m2, total, weight, unseen_m**2))
        open_share += weight * one.spread**2 / sum(weights.values())
    open_spread = float(np.sqrt(open_share + (_PRIOR_SPREAD * share) ** 2))
    return replace(KernelPosterior.of(found), spread=chosen.spread, open_spread=open_spread)


def posterior_from_survey(
    xy: FloatArray, heights: FloatArray, *, noise_m: float, localization_m: float = 0.0, spread: float = 0.0
) -> KernelPosterior:
    """Learn family, length scale, variance and noise from the samples of a survey.

    `xy`, `heights` (N, 2) and (N,): places and measured heights [m]. `noise_m`, `localization_m`: stated
    errors of a sample, and of its place [m]; the fit may depart from them by some 20 %. What it finds beyond
    them is taken as relief finer than the samples.
    """
    stated = max(noise_m, 1e-6)
    chosen = _clusters(len(xy))

    def search(noise_m: float) -> KernelSearch:
        return KernelSearch(xy[chosen], heights[chosen, None], noise_m, ALL, most=len(chosen))

    if localization_m > 0.0:
        stated = localized_noise_m(stated, localization_m, search(stated).search()[0].kernel)
    plausible = search(stated).plausible()
    unseen_m2 = max(sum(weight * one.noise_m**2 for one, weight in plausible) - stated**2, 0.0)
    found = [
        WeightedKernel(one.cell, one.variance_m2, one.noise_m, weight, unseen_m2) for one, weight in plausible
    ]
    return replace(KernelPosterior.of(found), spread=spread)


def _clusters(n: int) -> IntArray:
    """Return which of n samples, in driving order, a covariance is learned from: neighbours, and neighbours of those.

    Samples that all lie far apart would leave it open how rough the terrain is at short distances, and most of a
    map lies within short distances of a sample.
    """
    n_clusters = min(_MOST_CLUSTERS, max(n // len(_LAGS), 1))
    first = np.linspace(0, max(n - 1 - _LAGS[-1], 0), n_clusters).astype(int)
    chosen: IntArray = np.unique(np.minimum(first[:, None] + _LAGS, n - 1))
    return chosen


def posterior_in_grid(area: SurveyArea, prior: Dem, assumed: MapAssumptions) -> KernelPosterior:
    """Return the covariances that a prior makes likely, for assumptions whose lengths are grid metres."""
    return posterior_from_prior(
        PriorBlocks.of(area, prior),
        noise_m=assumed.noise_m,
        localization_m=assumed.localization_m,
        prior_sigma_m=assumed.prior_sigma_m,
        surface=assumed.surface,
        micro_relief_m=assumed.micro_relief_m,
        assumed=assumed.assumed,
    )


_LEAST_LINES = 3
# Standard deviation of the logarithm of the factor before any line is left out.
_UNCHECKED_SPREAD = 0.25
_LEAST_SHARE = 0.05
_MOST_SAMPLES = 1500


class _Check(NamedTuple):
    """Mean square of residuals over that expected, its degrees of freedom, and the terrain's share of the expected."""

    ratio: float
    freedom: float
    terrain_share: float


def checked_by_lines(
    posterior: KernelPosterior, xy: FloatArray, heights: FloatArray, line: IntArray
) -> KernelPosterior:
    """Scale the roughness of each covariance by what lines that are left out show of it.

    `xy`, `heights` (N, 2) and (N,): places and measured heights [m]. `line` (N,) int: line that each sample
    belongs to. Returns: with the uncertainty of the roughness as its ``open_spread``.
    """
    if len(np.unique(line)) < _LEAST_LINES:
        return KernelPosterior(posterior.kernels, posterior.spread, _UNCHECKED_SPREAD)
    every = slice(None, None, int(np.ceil(len(xy) / _MOST_SAMPLES)))
    found, open_share = [], 0.0
    for one in posterior.kernels:
        mean, variance = _log_factor(_check(one, xy[every], heights[every], line[every]))
        found.append(one._replace(variance_m2=one.variance_m2 * float(np.exp(2.0 * mean))))
        open_share += one.weight * variance
    return KernelPosterior(tuple(found), posterior.spread, float(np.sqrt(open_share)))


def _log_factor(check: _Check) -> tuple[float, float]:
    """Return mean and variance of the logarithm of the factor of the roughness."""
    share = max(check.terrain_share, _LEAST_SHARE)
    squared = max((check.ratio - (1.0 - share)) / share, _LEAST_SHARE)
    prior, own = _UNCHECKED_SPREAD**2, 0.5 / check.freedom / share**2
    return 0.5 * float(np.log(squared)) * prior / (prior + own), prior * own / (prior + own)


def _check(one: WeightedKernel, xy: FloatArray, heights: FloatArray, line: IntArray) -> _Check:
    """Predict each line from all others."""
    covariance = one.kernel.covariance(xy, xy)
    covariance[np.diag_indices(len(xy))] += one.noise_m**2 + 1e-9 * one.variance_m2
    inverse = cho_solve(cho_factor(covariance, lower=True), np.eye(len(xy)))
    ones = inverse.sum(axis=1)
    inverse -= np.outer(ones, ones) / ones.sum()
    weighted = inverse @ heights
    ratios, freedoms, shares = [], [], []
    for index in np.unique(line):
        chosen = np.flatnonzero(line == index)
        block = np.linalg.inv(inverse[np.ix_(chosen, chosen)])
        expected = float(np.trace(block))
        ratios.append(float(np.square(block @ weighted[chosen]).sum()) / expected)
        freedoms.append(expected**2 / float(np.square(block).sum()))
        shares.append(1.0 - len(chosen) * one.noise_m**2 / expected)
    weights = np.array(freedoms) / sum(freedoms)
    return _Check(float(weights @ ratios), sum(freedoms), float(weights @ shares))

"""Fit of a family of covariances to the cells of a prior, over all length scales, resolutions and errors of the cells."""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from planners.guarantee.posterior.prior_blocks import Fit, PriorBlocks
from planners.guarantee.posterior.surfaces import roughness_elsewhere
from survey.core.errors import InputError
from survey.reconstruction.gp.families import SearchedFamily
from survey.reconstruction.gp.kernel_search import Cell

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

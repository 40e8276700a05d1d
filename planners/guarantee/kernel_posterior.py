"""Posterior distribution of the terrain's covariance, from the cells of a prior or from a survey."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from planners.swaths.wavy import slope_length_m
from survey.core.arrays import FloatArray, IntArray
from survey.reconstruction.gp.covariance.families import SearchedFamily
from survey.reconstruction.gp.covariance.kernels import Kernel
from survey.reconstruction.gp.covariance.stationary import Stationary
from survey.reconstruction.gp.selection.cells import Cell
from survey.reconstruction.gp.selection.kernel_search import ALL, KernelSearch
from survey.terrain.conditional import CoarseCells

_LENGTHS_PER_DOUBLING = 2


# Four covariances hold nearly all of what the samples leave open.
_MOST_KERNELS = 4


_LEAST_WEIGHT = 0.01


# A family is excluded where the cells are less likely under all of it, by this factor, than under the best. It takes
# much: on real ground one valley decides the likelihood of coarse cells, and says little about the relief between them.
_EXCLUDED = 0.001


# Samples of a cluster, counted along the way from its first one, and how many clusters a covariance is learned from.
_LAGS = np.array([0, 1, 3, 7])


_MOST_CLUSTERS = 60


def localized_noise_m(noise_m: float, localization_m: float, kernel: Kernel) -> float:
    r"""Return the error of a sample whose place errs too, east and north by `localization_m` each [m].

    .. math::  \sigma^2 + 2 \, \sigma_{xy}^2 \, v / \lambda^2

    with the variance v of the terrain and its slope length λ, so that v/λ² is the variance of each slope.
    This is the one place where errors of the rover's place enter a predicted error; they are taken
    as independent from sample to sample.

    Examples
    --------
    >>> from survey.reconstruction.gp.covariance.kernels import SquaredExponential
    >>> round(localized_noise_m(0.1, 1.0, SquaredExponential(25.0, 100.0)), 3)
    0.122
    """
    slope_variance = kernel.variance_m2 / slope_length_m(kernel) ** 2
    return float(np.sqrt(noise_m**2 + 2.0 * localization_m**2 * slope_variance))


class WeightedKernel(NamedTuple):
    """A covariance that the terrain may have, the error of a sample under it [m], and its weight.

    ``unseen_m2`` is the variance of relief so fine that samples show it as noise: each place of a map misses it.
    """

    cell: Cell
    variance_m2: float
    noise_m: float
    weight: float
    unseen_m2: float = 0.0

    @property
    def kernel(self) -> Stationary:
        """The covariance function [m²]."""
        return self.cell.kernel(self.variance_m2)


@dataclass(frozen=True)
class KernelPosterior:
    """Covariances that the terrain may have, the weightiest first; weights sum to 1."""

    kernels: tuple[WeightedKernel, ...]

    @classmethod
    def of(cls, found: list[WeightedKernel]) -> "KernelPosterior":
        """Take the weightiest covariances, and scale their weights."""
        order = sorted(found, key=lambda one: -one.weight)
        chosen = [one for one in order[:_MOST_KERNELS] if one.weight > _LEAST_WEIGHT * order[0].weight]
        total = sum(one.weight for one in chosen)
        return cls(tuple(one._replace(weight=one.weight / total) for one in chosen))

    @classmethod
    def of_families(cls, found: list[WeightedKernel]) -> "KernelPosterior":
        """Take the weightiest of each family, with the total weight of the family.

        Families that the data do not separate stay in: cells of a prior seldom show how rough the terrain is
        between them.
        """
        best = {one.cell.family: one for one in sorted(found, key=lambda one: one.weight) if one.weight > 0.0}
        shares = {family: sum(one.weight for one in found if one.cell.family == family) for family in best}
        return cls.of([one._replace(weight=shares[family]) for family, one in best.items()])

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

    def draw(self, rng: np.random.Generator) -> WeightedKernel:
        """Return one of the covariances by chance."""
        weights = [one.weight for one in self.kernels]
        return self.kernels[int(rng.choice(len(weights), p=weights))]


def posterior_from_prior(
    cells: CoarseCells, *, noise_m: float, localization_m: float = 0.0
) -> KernelPosterior:
    """Learn covariances from the cells of a coarse prior, all families equally likely beforehand.

    Parameters
    ----------
    cells : CoarseCells
        Coarse elevations and their error.
    noise_m, localization_m : float
        Errors of the samples to come, and of their places [m].

    Notes
    -----
    Cells show nothing finer than themselves: how rough the terrain is between them is
    extrapolated through the families, and no more than that.
    """
    return KernelPosterior.of_families(_lattice(cells, ALL, noise_m, localization_m))


def cautious_posterior(
    cells: CoarseCells, *, noise_m: float, localization_m: float = 0.0, assumed: SearchedFamily | None = None
) -> KernelPosterior:
    """Return the covariances of the roughest family that the cells of a prior do not exclude.

    Parameters
    ----------
    cells : CoarseCells
        Coarse elevations and their error.
    noise_m, localization_m : float
        Errors of the samples to come, and of their places [m].
    assumed : str, optional
        The family, where it is known and need not be doubted.
    """
    found = _lattice(cells, ALL if assumed is None else (assumed,), noise_m, localization_m)
    most = max(one.weight for one in found)
    plausible = {one.cell.family for one in found if one.weight >= _EXCLUDED * most}
    roughest = max(plausible, key=ALL.index)
    return KernelPosterior.of([one for one in found if one.cell.family == roughest])


def _lattice(
    cells: CoarseCells, families: tuple[SearchedFamily, ...], noise_m: float, localization_m: float
) -> list[WeightedKernel]:
    """Weigh the covariances of a lattice of lengths and variances by how likely they make the cells."""
    height = cells.height_m - cells.height_m.mean()
    extent = float(np.ptp(cells.places.reshape(-1, 2), axis=0).max())
    lengths = np.exp2(np.arange(np.log2(extent / 16.0), np.log2(2.0 * extent), 1.0 / _LENGTHS_PER_DOUBLING))
    variances = float(height.var()) * np.exp2(np.arange(-3.0, 8.0))
    found, logs = [], []
    for family in families:
        for length in lengths:
            cell = Cell.of(family, float(length), 0.0)
            unit = cells.covariance(cell.kernel(1.0))
            for variance in variances.tolist():
                noise = localized_noise_m(noise_m, localization_m, cell.kernel(variance))
                logs.append(_log_likelihood(variance * unit, cells.sigma_m, height))
                found.append(WeightedKernel(cell, variance, noise, 0.0))
    weights = np.exp(np.array(logs) - np.max(logs)).tolist()
    return [one._replace(weight=weight) for one, weight in zip(found, weights, strict=True)]


def _log_likelihood(covariance: FloatArray, sigma_m: float, height: FloatArray) -> float:
    """Restricted log likelihood of the cells' heights, their constant mean integrated out."""
    n = len(height)
    matrix = covariance.copy()
    matrix[np.diag_indices(n)] += sigma_m**2 + 1e-6 * matrix[0, 0]
    factor, failed = lapack.dpotrf(matrix.T, lower=1, clean=1)
    if failed:
        return -np.inf
    half = lapack.dtrtrs(factor, np.column_stack([np.ones(n), height]), lower=1)[0]
    ones, rest = half[:, 0], half[:, 1]
    weight = float(ones @ ones)
    about = rest - ones * (ones @ rest / weight)
    return float(-0.5 * (about @ about) - np.log(np.diag(factor)).sum() - 0.5 * np.log(weight))


def posterior_from_survey(
    xy: FloatArray, heights: FloatArray, *, noise_m: float, localization_m: float = 0.0
) -> KernelPosterior:
    """Learn family, length scale, variance and noise from the samples of a survey.

    Parameters
    ----------
    xy, heights : (N, 2) and (N,) ndarray
        Places and measured heights [m].
    noise_m, localization_m : float
        Stated errors of a sample, and of its place [m]; the fit may depart from them by some 20 %. What it finds
        beyond them is taken as relief finer than the samples.
    """
    stated = max(noise_m, 1e-6)
    chosen = _clusters(len(xy))

    def search(noise_m: float) -> KernelSearch:
        return KernelSearch(xy[chosen], heights[chosen, None], noise_m, ALL, most=len(chosen))

    if localization_m > 0.0:
        stated = localized_noise_m(stated, localization_m, search(stated).found()[0].kernel)
    return KernelPosterior.of(
        [
            WeightedKernel(
                one.cell, one.variance_m2, one.noise_m, weight, max(one.noise_m**2 - stated**2, 0.0)
            )
            for one, weight in search(stated).plausible()
        ]
    )


def _clusters(n: int) -> IntArray:
    """Return which of n samples, in driving order, a covariance is learned from: neighbours, and neighbours of those.

    Samples that all lie far apart would leave it open how rough the terrain is at short distances, and most of a
    map lies within short distances of a sample.
    """
    n_clusters = min(_MOST_CLUSTERS, max(n // len(_LAGS), 1))
    first = np.linspace(0, max(n - 1 - _LAGS[-1], 0), n_clusters).astype(int)
    chosen: IntArray = np.unique(np.minimum(first[:, None] + _LAGS, n - 1))
    return chosen

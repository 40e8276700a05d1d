r"""Posterior distribution of the terrain's covariance, from the cells of a prior or from a survey.

`KernelPosterior` is a weighted list of covariances. `posterior_from_prior` fits them to the cells and adds the class of
surface, `posterior_from_survey` fits them to samples. Samples are near one another along the lines, and the error of a
map is made between them, where the ground may be smoother or rougher. `checked_by_lines` therefore predicts each line
from all others. With the inverse A of the covariance of all samples, about a constant mean, the residuals of line b and
their covariance are

.. math::  e_b = A_{bb}^{-1} (A y)_b, \qquad C_b = A_{bb}^{-1}

(Dubrule 1983, Mathematical Geology 15, 687). The mean square of the residuals over that expected gives a factor of the
roughness; its logarithm is weighed against 0 by how many independent values the residuals hold.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from planners.guarantee.prior_fit import PriorBlocks, fitted_family
from planners.guarantee.requirement import SURFACES, MapRequirement, Surface, roughness_elsewhere
from planners.prediction import slope_length_m
from survey.core.arrays import FloatArray, IntArray
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.reconstruction.gp.families import SearchedFamily
from survey.reconstruction.gp.kernel_search import ALL, Cell, KernelSearch
from survey.reconstruction.gp.kernels import Kernel, Stationary

# Four covariances hold nearly all of what the samples leave open.
_MOST_KERNELS = 4


_LEAST_WEIGHT = 0.01


# Spread of errors where the prior says nothing: that of the roughness from landscape to landscape.
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

    Examples
    --------
    >>> from survey.reconstruction.gp.kernels import SquaredExponential
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
    """Covariances that the terrain may have, the weightiest first; weights sum to 1.

    Parameters
    ----------
    kernels : tuple of WeightedKernel
        The covariances.
    spread : float
        Scale of the logarithm of actual over predicted error, on ground unlike all of them (Student's distribution).
    open_spread : float
        Standard deviation of the logarithm of the roughness that the cells leave open (normal distribution).
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

    Parameters
    ----------
    blocks : PriorBlocks
        Cells of the prior on the area.
    noise_m, localization_m : float
        Errors of the samples to come, and of their places [m].
    prior_sigma_m : float
        Standard deviation of a cell [m].
    surface : {"bare-ice", "snow", "moraine", "bedrock", "unknown"}
        Class of the ground.
    micro_relief_m : float, optional
        Standard deviation of relief finer than the samples [m]; that of the class by default.
    assumed : str, optional
        Family of covariance, where it is known.

    Returns
    -------
    KernelPosterior
        With one covariance for each family.
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
    xy: FloatArray,
    heights: FloatArray,
    *,
    noise_m: float,
    localization_m: float = 0.0,
    spread: float = 0.0,
) -> KernelPosterior:
    """Learn family, length scale, variance and noise from the samples of a survey.

    Parameters
    ----------
    xy, heights : (N, 2) and (N,) ndarray
        Places and measured heights [m].
    noise_m, localization_m : float
        Stated errors of a sample, and of its place [m]; the fit may depart from them by some 20 %. What it finds
        beyond them is taken as relief finer than the samples.
    spread : float
        Of the posterior.

    Returns
    -------
    KernelPosterior
        The covariances that are nearly as likely as the best.
    """
    stated = max(noise_m, 1e-6)
    chosen = _clusters(len(xy))

    def search(noise_m: float) -> KernelSearch:
        return KernelSearch(xy[chosen], heights[chosen, None], noise_m, ALL, most=len(chosen))

    if localization_m > 0.0:
        stated = localized_noise_m(stated, localization_m, search(stated).found()[0].kernel)
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


def posterior_in_grid(area: SurveyArea, prior: Dem, requirement: MapRequirement) -> KernelPosterior:
    """Return the covariances that a prior makes likely, for a requirement whose lengths are grid metres.

    Parameters
    ----------
    area : SurveyArea
        What is to be mapped.
    prior : Dem
        Coarse elevations over the area.
    requirement : MapRequirement
        Errors of the samples and of the prior, and the class of surface.

    Returns
    -------
    KernelPosterior
        With lengths in the metres of the CRS.
    """
    return posterior_from_prior(
        PriorBlocks.of(area, prior),
        noise_m=requirement.noise_m,
        localization_m=requirement.localization_m,
        prior_sigma_m=requirement.prior_sigma_m,
        surface=requirement.surface,
        micro_relief_m=requirement.micro_relief_m,
        assumed=requirement.assumed,
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

    Parameters
    ----------
    posterior : KernelPosterior
        Covariances fitted to the samples.
    xy, heights : (N, 2) and (N,) ndarray
        Places and measured heights [m].
    line : (N,) ndarray of int
        Line that each sample belongs to.

    Returns
    -------
    KernelPosterior
        With the uncertainty of the roughness as its ``open_spread``.
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

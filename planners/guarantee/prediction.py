r"""Probability that a map meets a limit, over all covariances that the terrain may have.

For each covariance of a `KernelPosterior` the mean squared error of the map over M nodes is a weighted sum of
squared normal numbers. Its mean and variance follow from the posterior covariance C of the heights,

.. math::  E = \frac{1}{M} \mathrm{tr}\, C, \qquad V = \frac{2}{M^2} \mathrm{tr}\, C^2

which make a gamma distribution (`planners.guarantee.error_distribution`). An error that all samples share adds its
variance to E. Where there are more samples than can be factorized at once, the map is judged in patches, each from the
samples nearest to it.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack
from scipy.spatial import cKDTree

from planners.guarantee.error_distribution import ErrorDistribution, ErrorMoments
from planners.guarantee.posterior.correlogram import Correlogram
from planners.guarantee.posterior.kernel_posterior import KernelPosterior, WeightedKernel
from planners.prediction.map_places import spread_places
from planners.prediction.slope_length import slope_length_m
from survey.core.arrays import FloatArray
from survey.data.area import SurveyArea
from survey.reconstruction.gp.kernel_search import Cell

_N_NODES = 200


# The first nodes give the covariance of errors at different nodes.
_N_IN_COMMON = 120


FITTED_KERNEL_INFLATION = 1.02
"""Ratio of errors with a fitted covariance to those with the true one, on rough terrain."""


# Of more samples than this, those nearer to one another than a share of the slope length are averaged, but no more of
# them than here: rough terrain changes between them.
_MOST_FACTORIZED = 1000
_AVERAGED = 0.2


# Noise beside the variance of the terrain, below which rounding makes covariances indefinite.
_LEAST_RATIO = 4e-9


# More samples are read in so many patches, of so many samples and places each.
_MOST_AT_ONCE = 2000
_N_PATCHES = 12
_PATCH_SAMPLES = 250
_PATCH_SHARE = 0.4
_PATCH_NODES = np.sqrt((np.arange(24) + 0.5) / 24.0)[:, None] * np.column_stack(
    [np.cos(2.4 * np.arange(24)), np.sin(2.4 * np.arange(24))]
)


class MapPrediction(NamedTuple):
    """Probability that the map meets the limit, and its expected root mean square error [m]."""

    probability: float
    rmse_m: float


class _Seen(NamedTuple):
    """Correlations of the places of a plan, for one family and length: among them, and with the nodes."""

    among: FloatArray
    across: FloatArray
    common: FloatArray


@dataclass(frozen=True, eq=False)
class LimitPredictor:
    """Predictor of the probability that samples at given places give a map within a limit.

    Parameters
    ----------
    area : SurveyArea
        Where the map is judged, at 300 places or so.
    limit_m : float
        Largest root mean square error allowed [m].
    step_m : float
        Distance between samples [m].
    inflation : float
        Factor on predicted errors for covariances that are fitted.
    shared_m : float
        Standard deviation of an error of height that all samples share [m].
    """

    area: SurveyArea
    limit_m: float
    step_m: float
    inflation: float = 1.0
    shared_m: float = 0.0

    @cached_property
    def nodes(self) -> FloatArray:
        """Places (M, 2) on the free ground [m], in no step with any swaths; any first part of them is spread evenly."""
        return spread_places(self.area, _N_NODES)

    @cached_property
    def _reach_m(self) -> float:
        """Farthest that two places of the area can be apart [m]."""
        xmin, ymin, xmax, ymax = self.area.bounds
        return float(np.hypot(xmax - xmin, ymax - ymin))

    def of(self, xy: FloatArray, posterior: KernelPosterior) -> MapPrediction:
        """Predict the map made from samples at places.

        Parameters
        ----------
        xy : (N, 2) ndarray
            Places of the samples [m].
        posterior : KernelPosterior
            Covariances that the terrain may have.

        Returns
        -------
        MapPrediction
            Weighted over the covariances.
        """
        distribution = self.distribution(xy, posterior).with_shared(self.shared_m)
        return MapPrediction(distribution.probability(self.limit_m), distribution.rmse_m)

    def distribution(self, xy: FloatArray, posterior: KernelPosterior) -> ErrorDistribution:
        """Predict the distribution of the map's error, from samples at places (N, 2) [m].

        Parameters
        ----------
        xy : (N, 2) ndarray
            Places of the samples [m].
        posterior : KernelPosterior
            Covariances that the terrain may have.

        Returns
        -------
        ErrorDistribution
            Of the error over the area, without the error that all samples share.
        """
        if len(xy) > _MOST_AT_ONCE:
            return self._in_patches(xy, posterior)
        return ErrorDistribution(
            self._moments(xy, posterior, self.nodes), posterior.spread, posterior.open_spread
        )

    def _in_patches(self, xy: FloatArray, posterior: KernelPosterior) -> ErrorDistribution:
        """Predict the distribution from the moments of patches, whose errors are independent of one another."""
        tree, patches = cKDTree(xy), []
        for centre in self.nodes[:_N_PATCHES]:
            far_m, near = tree.query(centre, _PATCH_SAMPLES)
            radius_m = _PATCH_SHARE * float(np.max(far_m))
            nodes = centre + radius_m * _PATCH_NODES
            inside = nodes[self.area.contains(nodes)]
            chosen = inside if len(inside) > 1 else np.vstack([centre, centre])
            patches.append((self._moments(xy[np.asarray(near)], posterior, chosen), np.pi * radius_m**2))
        total = []
        for index, one in enumerate(posterior.kernels):
            mean = float(np.mean([parts[index].mean for parts, _ in patches]))
            noise = float(np.mean([parts[index].noise for parts, _ in patches]))
            shares = [min(size_m2 / float(self.area.free.area), 1.0) for _, size_m2 in patches]
            within = [
                parts[index].variance * share for (parts, _), share in zip(patches, shares, strict=True)
            ]
            total.append(ErrorMoments(mean, float(np.mean(within)), one.weight, noise))
        return ErrorDistribution(total, posterior.spread, posterior.open_spread)

    def _moments(self, xy: FloatArray, posterior: KernelPosterior, nodes: FloatArray) -> list[ErrorMoments]:
        """Return the moments of the mean squared error over nodes (M, 2), for each covariance."""
        seen: dict[tuple[str, float], _Seen] = {}
        found = []
        for one in posterior.kernels:
            thin = self._averaged(one) if len(xy) > _MOST_FACTORIZED else 1
            key = one.cell.family, one.cell.length
            if key not in seen:
                seen[key] = self._seen(xy[::thin], one.cell, nodes)
            found.append(self._under(one, seen[key], thin))
        return found

    def _averaged(self, weighted: WeightedKernel) -> int:
        """Return how many samples one place stands for."""
        n = int(_AVERAGED * slope_length_m(weighted.kernel) / self.step_m)
        return min(max(n, 1), weighted.cell.kind.most_averaged)

    def _seen(self, places: FloatArray, cell: Cell, nodes: FloatArray) -> _Seen:
        read, some = _correlogram(cell._replace(ratio=0.0), self._reach_m), nodes[:_N_IN_COMMON]
        return _Seen(read.between(places, places), read.between(places, nodes), read.between(some, some))

    def _under(self, weighted: WeightedKernel, seen: _Seen, thin: int) -> ErrorMoments:
        """Return the moments for one covariance; each place stands for `thin` samples."""
        matrix = seen.among.copy()
        ratio = max(weighted.noise_m**2 / thin / weighted.variance_m2, _LEAST_RATIO)
        matrix[np.diag_indices(len(matrix))] += ratio
        factor, failed = lapack.dpotrf(matrix.T, lower=1, overwrite_a=1, clean=1)
        if failed:
            return ErrorMoments(weighted.variance_m2, weighted.variance_m2**2, weighted.weight)
        half = lapack.dtrtrs(factor, np.column_stack([np.ones(len(matrix)), seen.across]), lower=1)[0]
        ones, explained = half[:, 0], half[:, 1:]
        gap = (1.0 - ones @ explained) / (ones @ ones)
        left = 1.0 - np.square(explained).sum(axis=0) + np.square(gap) * (ones @ ones)
        weights = lapack.dtrtrs(factor, explained + np.outer(ones, gap), lower=1, trans=1)[0]
        noise = ratio * np.square(weights).sum(axis=0).mean()
        some, gap = explained[:, :_N_IN_COMMON], gap[:_N_IN_COMMON]
        common = seen.common - some.T @ some + np.outer(gap, gap) * (ones @ ones)
        scale_m2 = self.inflation**2 * weighted.variance_m2
        common = scale_m2 * common
        common[np.diag_indices(len(common))] += weighted.unseen_m2
        mean = float((scale_m2 * left + weighted.unseen_m2).mean())
        variance = 2.0 * float(np.square(common).mean())
        return ErrorMoments(mean, variance, weighted.weight, scale_m2 * float(noise) + weighted.unseen_m2)


@lru_cache(maxsize=32)
def _correlogram(cell: Cell, reach_m: float) -> Correlogram:
    """Return the table of a covariance, which plans of one area share."""
    return Correlogram(cell, reach_m)

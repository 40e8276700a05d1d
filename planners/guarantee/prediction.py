r"""Probability that a map meets a limit, over all covariances that the terrain may have.

For each covariance of a `KernelPosterior` the mean squared error of the map over M nodes is a weighted sum of
squared normal numbers. Its mean and variance follow from the posterior covariance C of the heights,

.. math::  E = \frac{1}{M} \mathrm{tr}\, C, \qquad V = \frac{2}{M^2} \mathrm{tr}\, C^2

and the probability that it stays below the squared limit is that of the gamma distribution with the same two
moments (Satterthwaite 1946).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack
from scipy.special import gammainc, gammaln

from planners.capacity import MOST_SAMPLES, require_samples
from planners.guarantee.correlogram import Correlogram
from planners.guarantee.kernel_posterior import KernelPosterior, WeightedKernel
from planners.swaths.wavy import slope_length_m
from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.reconstruction.gp.selection.cells import Cell

_N_NODES = 300


# The first nodes give the covariance of errors at different nodes.
_N_IN_COMMON = 120


# The plastic number, whose powers spread places evenly over the plane (Roberts 2018).
_PLASTIC = 1.324717957244746


FITTED_KERNEL_INFLATION = 1.02
"""Ratio of errors with a fitted covariance to those with the true one, on rough terrain."""


# Samples nearer to one another than this share of the slope length are averaged, but no more of them than here:
# rough terrain changes between them.
_AVERAGED = 0.2


# Noise beside the variance of the terrain, below which rounding makes covariances indefinite.
_LEAST_RATIO = 4e-9


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
    """

    area: SurveyArea
    limit_m: float
    step_m: float
    inflation: float = 1.0

    @cached_property
    def nodes(self) -> FloatArray:
        """Places (M, 2) on the free ground [m], in no step with any swaths; any first part of them is spread evenly."""
        low, high = np.array(self.area.bounds[:2]), np.array(self.area.bounds[2:])
        n = int(_N_NODES * np.prod(high - low) / max(self.area.free.area, 1e-9))
        share = (0.5 + np.arange(1, min(n, 100 * _N_NODES) + 1)[:, None] / _PLASTIC ** np.array([1, 2])) % 1.0
        nodes = low + share * (high - low)
        inside: FloatArray = nodes[self.area.contains(nodes)]
        if not len(inside):
            raise InputError("the area is so thin that no node of its map lies on free ground; widen it.")
        return inside

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

        Raises
        ------
        CapacityError
            More samples than a matrix can be factorized for.
        """
        if len(xy) > MOST_SAMPLES:
            length_m = len(xy) * self.step_m
            require_samples(length_m, self.step_m, MOST_SAMPLES)
        seen: dict[tuple[str, float], _Seen] = {}
        each = []
        for one in posterior.kernels:
            thin = self._averaged(one)
            key = one.cell.family, one.cell.length
            if key not in seen:
                seen[key] = self._seen(xy[::thin], one.cell)
            each.append(self._under(one, seen[key], thin))
        weights = np.array([one.weight for one in posterior.kernels])
        return MapPrediction(
            float(weights @ [one.probability for one in each]),
            float(weights @ [one.rmse_m for one in each]),
        )

    def _averaged(self, weighted: WeightedKernel) -> int:
        """Return how many samples one place stands for."""
        n = int(_AVERAGED * slope_length_m(weighted.kernel) / self.step_m)
        return min(max(n, 1), weighted.cell.kind.most_averaged)

    def _seen(self, places: FloatArray, cell: Cell) -> _Seen:
        read, some = Correlogram(cell, self._reach_m), self.nodes[:_N_IN_COMMON]
        return _Seen(read.between(places, places), read.between(places, self.nodes), read.between(some, some))

    def _under(self, weighted: WeightedKernel, seen: _Seen, thin: int) -> MapPrediction:
        """Predict the map for one covariance; each place stands for `thin` samples."""
        matrix = seen.among.copy()
        matrix[np.diag_indices(len(matrix))] += max(
            weighted.noise_m**2 / thin / weighted.variance_m2, _LEAST_RATIO
        )
        factor, failed = lapack.dpotrf(matrix.T, lower=1, overwrite_a=1, clean=1)
        if failed:
            return MapPrediction(0.0, float(np.sqrt(weighted.variance_m2)))
        half = lapack.dtrtrs(factor, np.column_stack([np.ones(len(matrix)), seen.across]), lower=1)[0]
        ones, explained = half[:, 0], half[:, 1:]
        gap = 1.0 - ones @ explained
        left = 1.0 - np.square(explained).sum(axis=0) + np.square(gap) / (ones @ ones)
        some, gap = explained[:, :_N_IN_COMMON], gap[:_N_IN_COMMON]
        common = seen.common - some.T @ some + np.outer(gap, gap) / (ones @ ones)
        scale_m2 = self.inflation**2 * weighted.variance_m2
        common = scale_m2 * common
        common[np.diag_indices(len(common))] += weighted.unseen_m2
        return self._chance(scale_m2 * left + weighted.unseen_m2, common)

    def _chance(self, variance_m2: FloatArray, covariance_m2: FloatArray) -> MapPrediction:
        """Return the chance of a gamma distributed mean square, from the errors' variances and some covariances."""
        mean = max(float(variance_m2.mean()), 1e-12)
        variance = max(2.0 * float(np.square(covariance_m2).mean()), 1e-6 * mean**2)
        shape = mean**2 / variance
        # The mean of the square root of a gamma distributed number.
        rmse = np.exp(gammaln(shape + 0.5) - gammaln(shape)) * np.sqrt(mean / shape)
        return MapPrediction(float(gammainc(shape, shape * self.limit_m**2 / mean)), float(rmse))

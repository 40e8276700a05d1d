r"""Distribution of the error of a map, over all covariances that the terrain may have, and the probability of a limit.

Under each covariance of a `KernelPosterior` the mean squared error of the map over M nodes is a weighted sum of squared
normal numbers. Its mean and variance follow from the posterior covariance C of the heights,

.. math::  E = \frac{1}{M} \mathrm{tr}\, C, \qquad V = \frac{2}{M^2} \mathrm{tr}\, C^2

and it is about the gamma distribution with these moments (Satterthwaite 1946). An error that all samples share adds its
variance to E. On ground that is rougher than the covariance by a factor f the mean is at most

.. math::  E(f) = f^2 \, T + N, \qquad T + N = E

with the part N of the noise of the samples and of relief finer than they are, which does not grow with the roughness:
the error of the best linear map is a concave function of the variance of the terrain, and this is its tangent. The
families of covariance stand for degrees of smoothness, and ground lies between them: T is their geometric mean, and its
standard deviation from family to family makes a normal factor, cut off at the roughest family, which grows the farther
the swaths are below what the prior shows. There are two other factors. The differences between landscapes are estimated
from few of them, so that the logarithm for a new one has Student's distribution of four degrees of freedom (Geisser
1993, Predictive Inference); what the cells of a prior or the samples of a survey leave open of the roughness is normal.
The factors are integrated by Gauss-Legendre nodes of their distribution functions (`ErrorDistribution`).

`LimitPredictor` computes the moments for the samples of a route. Where there are more samples than can be factorized at
once, the map is judged in patches, each from the samples nearest to it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.linalg import lapack
from scipy.spatial import cKDTree
from scipy.special import gammainc, gammaln, ndtri, stdtrit

from planners.prediction.kernel_posterior import KernelPosterior, WeightedKernel
from planners.prediction.places import slope_length_m, spread_places
from survey import SurveyArea
from survey.core import FloatArray
from survey.reconstruction.gp.kernel_search import Cell

_FREEDOM = 4.0
_N_FACTORS = 28
_N_BISECTIONS = 40
_LEAST_SPREAD = 1e-6


class ErrorMoments(NamedTuple):
    """Mean [m²] and variance [m⁴] of the mean squared error under one covariance, and the covariance's weight.

    ``noise`` is the part of the mean that does not grow with the roughness of the terrain [m²].
    """

    mean: float
    variance: float
    weight: float
    noise: float = 0.0


@dataclass(frozen=True)
class ErrorDistribution:
    """Distribution of the root mean square error of a map.

    `parts`: one for each covariance; weights sum to 1. `spread`: scale of the logarithm of a factor of the
    roughness, which has Student's distribution. `open_spread`: standard deviation of the logarithm of another
    factor of the roughness, which is normal.
    """

    parts: Sequence[ErrorMoments]
    spread: float = 0.0
    open_spread: float = 0.0

    def with_shared(self, shared_m: float) -> "ErrorDistribution":
        """Return the distribution with an error that all samples share, of a standard deviation [m]."""
        squared = shared_m**2
        parts = [
            part._replace(
                mean=part.mean + squared,
                variance=part.variance + 2.0 * squared**2,
                noise=part.noise + squared,
            )
            for part in self.parts
        ]
        return replace(self, parts=parts)

    def probability(self, limit_m: float) -> float:
        """Return the probability that the error is at most a limit [m]."""
        terrain, noise, shape = self._moments
        factors, shares = self._factors
        means = np.square(factors) * terrain + noise
        return float(shares @ gammainc(shape, shape * limit_m**2 / means))

    @cached_property
    def rmse_m(self) -> float:
        """Expected error [m], at the median of the factors."""
        terrain, noise, shape = self._moments
        root = float(np.exp(gammaln(shape + 0.5) - gammaln(shape)))
        return root * float(np.sqrt((terrain + noise) / shape))

    def quantile_m(self, probability: float) -> float:
        """Return the error that the map stays within with a probability [m]."""
        low, high = 0.0, float(np.sqrt(max(part.mean for part in self.parts)))
        while self.probability(high) < probability:
            high *= 2.0
        for _ in range(_N_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if self.probability(middle) >= probability else (middle, high)
        return high

    @cached_property
    def _weights(self) -> FloatArray:
        return np.array([part.weight for part in self.parts])

    @cached_property
    def _log_terrain(self) -> FloatArray:
        """Half the logarithm of the terrain's part of the mean, for each covariance [log m]."""
        return 0.5 * np.log(np.maximum([part.mean - part.noise for part in self.parts], 1e-12))

    @cached_property
    def _moments(self) -> tuple[float, float, float]:
        """Terrain's and noise's part of the mean square [m²], and the shape of the gamma distribution."""
        mean = np.maximum([part.mean for part in self.parts], 1e-12)
        variance = np.maximum([part.variance for part in self.parts], 1e-6 * mean**2)
        shape = float(np.exp(self._weights @ np.log(mean**2 / variance)))
        noise = float(self._weights @ [part.noise for part in self.parts])
        return float(np.exp(2.0 * self._weights @ self._log_terrain)), noise, shape

    @cached_property
    def _factors(self) -> tuple[FloatArray, FloatArray]:
        """Factors of the roughness and their shares."""
        logs, shares = self._between
        for spread, nodes in ((self.spread, _student), (self.open_spread, _normal)):
            if spread > 0.0:
                values, weights = nodes()
                logs = np.add.outer(logs, spread * values).ravel()
                shares = np.multiply.outer(shares, weights).ravel()
        return np.exp(logs), shares

    @cached_property
    def _between(self) -> tuple[FloatArray, FloatArray]:
        """Logarithms of the factor from family to family, no rougher than the roughest, and their shares."""
        off = self._log_terrain - self._weights @ self._log_terrain
        spread = float(np.sqrt(self._weights @ np.square(off)))
        if spread < _LEAST_SPREAD:
            return np.zeros(1), np.ones(1)
        values, weights = _normal()
        return np.minimum(spread * values, off.max()), weights


@cache
def _student() -> tuple[FloatArray, FloatArray]:
    """Return the values of a number with Student's distribution, and their shares."""
    share, weights = _nodes()
    return np.asarray(stdtrit(_FREEDOM, share), dtype=np.float64), weights


@cache
def _normal() -> tuple[FloatArray, FloatArray]:
    """Return the values of a number with the normal distribution, and their shares."""
    share, weights = _nodes()
    return np.asarray(ndtri(share), dtype=np.float64), weights


def _nodes() -> tuple[FloatArray, FloatArray]:
    """Return the nodes of a distribution function from 0 to 1, and their weights."""
    nodes, weights = np.polynomial.legendre.leggauss(_N_FACTORS)
    return 0.5 * (1.0 + nodes), 0.5 * weights


_STEPS_PER_LENGTH = 8192
_MOST_STEPS = 65536


@dataclass(frozen=True, eq=False)
class Correlogram:
    """The correlation of an isotropic cell, by distance.

    Read linearly between steps of 1/8192 of the length scale, it is off by less than 5e-8 even where it
    has no second derivative, and by 2e-7 where the length scale is a fortieth of the reach; correlations beyond the
    reach are those at its end.

    `cell`: family and length scale. `reach_m`: largest distance that is evaluated [m].

    >>> cell = Cell.of("whittle", 1000.0, 0.0)
    >>> xy = np.array([[0.0, 0.0], [30.0, 40.0]])
    >>> read = Correlogram(cell, reach_m=100.0).between(xy, xy)
    >>> bool(np.abs(read - cell.correlation(np.array([[0.0, 2500.0], [2500.0, 0.0]]))).max() < 5e-8)
    True
    """

    cell: Cell
    reach_m: float

    @property
    def _step_m(self) -> float:
        return max(self.cell.length_scale_m / _STEPS_PER_LENGTH, self.reach_m / _MOST_STEPS)

    @cached_property
    def _table(self) -> FloatArray:
        steps = np.arange(int(np.ceil(self.reach_m / self._step_m)) + 2, dtype=np.float64)
        return self.cell.correlation(np.square(self._step_m * steps))

    def between(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return the correlation (A, B) of places (A, 2) with places (B, 2) [m]."""
        read: FloatArray = _read(
            np.ascontiguousarray(a), np.ascontiguousarray(b), self._table, 1.0 / self._step_m
        )
        return read


@njit(cache=True)
def _read(a: FloatArray, b: FloatArray, table: FloatArray, per_m: float) -> FloatArray:
    """Return the correlations (A, B), linear between the entries of the table."""
    read = np.empty((len(a), len(b)))
    last = len(table) - 2
    for i in range(len(a)):
        for j in range(len(b)):
            place = per_m * np.sqrt((a[i, 0] - b[j, 0]) ** 2 + (a[i, 1] - b[j, 1]) ** 2)
            k = min(int(place), last)
            share = min(place - k, 1.0)
            read[i, j] = (1.0 - share) * table[k] + share * table[k + 1]
    return read


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

    `area`: where the map is judged, at 300 places or so. `limit_m`: largest root mean square error allowed
    [m]. `step_m`: distance between samples [m]. `inflation`: factor on predicted errors for covariances that
    are fitted. `shared_m`: standard deviation of an error of height that all samples share [m].
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

        `xy` (N, 2): places of the samples [m].
        """
        distribution = self.distribution(xy, posterior).with_shared(self.shared_m)
        return MapPrediction(distribution.probability(self.limit_m), distribution.rmse_m)

    def distribution(self, xy: FloatArray, posterior: KernelPosterior) -> ErrorDistribution:
        """Predict the distribution of the map's error, from samples at places (N, 2) [m].

        `xy` (N, 2): places of the samples [m].
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

r"""Distribution of the error of a map, over all covariances that the terrain may have, and the probability of a limit.

Under each covariance of a `KernelPosterior` the mean squared error of the map over M nodes is a weighted sum of squared
normal numbers. Its mean and variance follow from the posterior covariance C of the heights,

.. math::  E = \frac{1}{M} \mathrm{tr}\, C, \qquad V = \frac{2}{M^2} \mathrm{tr}\, C^2

and it is about the gamma distribution with these moments (Satterthwaite 1946). An error that all samples share adds its
square, over whose normal distribution the probability is integrated. On ground that is rougher than the covariance by a factor f the mean is at most

.. math::  E(f) = f^2 \, T + N, \qquad T + N = E

with the part N of the noise of the samples and of relief finer than they are, which does not grow with the roughness:
the error of the best linear map is a concave function of the variance of the terrain, and this is its tangent. The
families of covariance stand for degrees of smoothness, and ground lies between them: T is their geometric mean, and its
standard deviation from family to family makes a normal factor, cut off at the roughest family, which grows the farther
the swaths are below what the prior shows. There are two other factors. The differences between landscapes are estimated
from few of them, so that the logarithm for a new one has Student's distribution of four degrees of freedom (Geisser
1993, Predictive Inference); what the cells of a prior or the samples of a survey leave open of the roughness is normal.
The factors are integrated by Gauss-Legendre nodes of their distribution functions (`ErrorDistribution`).

`MapPredictor` computes the moments for the samples of a route and the cells of the prior that the map is made with: C is what
both leave open (see `survey.reconstruction.gp.prior_measurements`). Where there are more than can be factorized at once,
places are predicted in groups, each from the samples and cells near it.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack
from scipy.optimize import brentq
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.special import gammainc, gammaln, ndtri, stdtrit

from planners.prediction.kernel_posterior import KernelPosterior, WeightedKernel
from planners.prediction.places import spread_places
from planners.prediction.prior_cells import PriorCells
from survey import SurveyArea
from survey.core import FloatArray, IntArray
from survey.reconstruction.gp.kernel_search import Cell
from survey.reconstruction.level import TIES

_FREEDOM = 4.0
_N_FACTORS = 28
_ROUNDING = 1e-12
_N_MERGED = 400
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
    factor of the roughness, which is normal. `shared_m`: standard deviation of an error that all samples share [m].
    """

    parts: Sequence[ErrorMoments]
    spread: float = 0.0
    open_spread: float = 0.0
    shared_m: float = 0.0

    def with_shared(self, shared_m: float) -> "ErrorDistribution":
        """Return the distribution with an error that all samples share, of a standard deviation [m]."""
        return replace(self, shared_m=float(np.hypot(self.shared_m, shared_m)))

    def with_part(self, covariance_m2: FloatArray) -> "ErrorDistribution":
        """Return the distribution with errors of another source, of a covariance (M, M) at the nodes [m²].

        Their mean over the nodes is an error that all samples share.
        """
        level_m2 = max(float(covariance_m2.mean()), 0.0)
        rest_m2 = max(float(np.trace(covariance_m2)) / len(covariance_m2) - level_m2, 0.0)
        parts = [one._replace(mean=one.mean + rest_m2, noise=one.noise + rest_m2) for one in self.parts]
        return replace(self, parts=parts).with_shared(float(np.sqrt(level_m2)))

    def by_level(self, level_m: float) -> "dict[str, ErrorDistribution]":
        """Return the distributions of a map whose level the prior alone holds, to `level_m`, and one more tie each.

        The distribution itself is that without an error of the level. Names are "prior" and those of `TIES`.
        """
        left_m = {name: tie.left_m(level_m, self.rmse_m) for name, tie in TIES.items()}
        return {name: self.with_shared(one) for name, one in ({"prior": level_m} | left_m).items()}

    def probability(self, limit_m: float) -> float:
        """Return the probability that the error is at most a limit [m]."""
        terrain, noise, shape = self._moments
        factors, shares = self._factors
        means = np.square(factors) * terrain + noise
        left_m2 = np.maximum(limit_m**2 - np.square(self._levels_m[0]), 0.0)
        return float(self._levels_m[1] @ gammainc(shape, shape * np.divide.outer(left_m2, means)) @ shares)

    @cached_property
    def rmse_m(self) -> float:
        """Expected error [m], at the median of the factors."""
        terrain, noise, shape = self._moments
        # Mean and variance of the mean square with what samples share, as of a gamma distribution.
        mean = terrain + noise + self.shared_m**2
        shape = mean**2 / ((terrain + noise) ** 2 / shape + 2.0 * self.shared_m**4)
        root = float(np.exp(gammaln(shape + 0.5) - gammaln(shape)))
        return root * float(np.sqrt(mean / shape))

    @property
    def shared_share(self) -> float:
        """Share of what samples share in the expected squared error, at the median of the factors."""
        terrain, noise, _ = self._moments
        return self.shared_m**2 / (terrain + noise + self.shared_m**2)

    def quantile_m(self, probability: float) -> float:
        """Return the error that the map stays within with a probability [m]."""
        low, high = 0.0, float(np.sqrt(max(part.mean for part in self.parts)) + self.shared_m)
        while self.probability(high) < probability:
            high *= 2.0
        return float(
            brentq(lambda limit_m: self.probability(limit_m) - probability, low, high, xtol=_ROUNDING * high)
        )

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
        """Factors of the roughness and their shares, those nearly alike as one."""
        logs, shares = self._between
        for spread, nodes in ((self.spread, _student), (self.open_spread, _normal)):
            if spread > 0.0:
                values, weights = nodes()
                logs = np.add.outer(logs, spread * values).ravel()
                shares = np.multiply.outer(shares, weights).ravel()
        edges = np.histogram_bin_edges(logs, _N_MERGED)
        merged, sums = (np.histogram(logs, edges, weights=w)[0] for w in (shares, shares * logs))
        kept = merged > 0.0
        return np.exp(sums[kept] / merged[kept]), merged[kept]

    @cached_property
    def _levels_m(self) -> tuple[FloatArray, FloatArray]:
        """Sizes of the error that samples share [m], and their shares."""
        if self.shared_m == 0.0:
            return np.zeros(1), np.ones(1)
        share, weights = _nodes()
        return self.shared_m * ndtri(0.5 + 0.5 * share), weights

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


_STEPS_PER_LENGTH, _STEPS_PER_WIDTH = 8192, 128
# Means over a square are those of its Gauss nodes, exact for cubic relief; directions within the eighth of a circle.
_GAUSS, _SIGNS = 0.5 / np.sqrt(3.0), np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
_DIRECTIONS = np.pi / 4.0 * (np.arange(3) + 0.5) / 3.0
_MOST_STEPS, _ROWS_AT_ONCE = 65536, 128


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

    @cached_property
    def _slopes(self) -> FloatArray:
        return np.diff(self._table, append=self._table[-1])

    def between(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return the correlation (A, B) of places (A, 2) with places (B, 2) [m]."""
        share = cdist(a, b)
        share *= 1.0 / self._step_m
        step = share.astype(np.intp)
        share -= step
        share *= self._slopes.take(step, mode="clip")
        share += self._table.take(step, mode="clip")
        return share

    def among(self, places: FloatArray) -> FloatArray:
        """Return the correlation (A, A) of places (A, 2) [m] with one another, its upper triangle alone."""
        found = np.zeros((len(places), len(places)))
        for first in range(0, len(places), _ROWS_AT_ONCE):
            rows = slice(first, first + _ROWS_AT_ONCE)
            found[rows, first:] = self.between(places[rows], places[first:])
        return found


@dataclass(frozen=True, eq=False)
class MeanCorrelogram(Correlogram):
    """The correlation of a mean over a square with a place or, for two means, with that over another square, by distance.

    It is averaged over the direction between them, which matters for neighbours alone.

    `width_m`: side of the squares [m]. `n_means`: 1 or 2.
    """

    width_m: float
    n_means: int

    @property
    def _step_m(self) -> float:
        return max(self.width_m / _STEPS_PER_WIDTH, self.reach_m / _MOST_STEPS)

    @cached_property
    def _table(self) -> FloatArray:
        lags = _GAUSS * self.width_m * _SIGNS
        if self.n_means == 2:
            lags = (lags[:, None] - lags).reshape(-1, 2)
        steps = self._step_m * np.arange(int(np.ceil(self.reach_m / self._step_m)) + 2, dtype=np.float64)
        total = np.zeros(len(steps))
        for angle in _DIRECTIONS:
            to = np.outer(steps, [np.cos(angle), np.sin(angle)])
            for lag in lags:
                total += self.cell.correlation(np.square(to + lag).sum(axis=1))
        return total / (len(_DIRECTIONS) * len(lags))


_N_NODES = 200
# So many nodes give the covariance of errors at different nodes.
_N_IN_COMMON = 120

FITTED_KERNEL_INFLATION = 1.02
"""Ratio of errors with a fitted covariance to those with the true one, on rough terrain."""

# Noise beside the variance of the terrain, below which rounding makes covariances indefinite.
_LEAST_RATIO = 4e-9

# Maps of more samples or cells are predicted group by group of places, each from so many samples near it; the radius of a
# group is at most a share of theirs. Samples of a long route are no nearer than a share of the distance between lines.
_MOST_AT_ONCE, _MOST_CELLS = 1000, 500
# Pictures of the variance have many places: groups take a fifth of the time, and differ by 0.4 % of the deviation at most
# on the sample site of 1 km². Without cells of a prior few samples leave the mean of the terrain less well known.
_MOST_FOR_PICTURES = 300
_N_NEAR, _NEAR_SHARE = 120, 0.4
_SHARE_OF_GAP = 0.125


class MapPrediction(NamedTuple):
    """Probability that the map meets the limit, and its expected root mean square error [m]."""

    probability: float
    rmse_m: float


class _Group(NamedTuple):
    """Places that are predicted together (by number), and the samples (N, 2) and cells that predict them [m].

    ``own_m2`` (N,): variances of the samples' errors beside those of the covariance [m²].
    """

    places: IntArray
    xy: FloatArray
    own_m2: FloatArray
    cells: PriorCells | None


class _Seen(NamedTuple):
    """Correlations of samples and cells: among them (N + C, N + C; the upper triangle alone), and with places (N + C, M)."""

    among: FloatArray
    across: FloatArray


class _Errors(NamedTuple):
    """Covariance of the errors of samples and cells, over the variance of the terrain.

    ``samples`` (N,): its diagonal, for samples have errors of their own. ``cells`` (C, C): its block of cells.
    """

    samples: FloatArray
    cells: FloatArray

    def added_to(self, covariance: FloatArray) -> FloatArray:
        """Return the sum with a covariance (N + C, N + C)."""
        total, n = covariance.copy(), len(self.samples)
        total[np.arange(n), np.arange(n)] += self.samples
        total[n:, n:] += self.cells
        return total

    def variance_under(self, weights: FloatArray) -> FloatArray:
        """Return the variance (M,) of weighted sums of the errors, for weights (N + C, M)."""
        n = len(self.samples)
        own, shared = weights[:n], weights[n:]
        variance: FloatArray = self.samples @ np.square(own)
        return variance + np.einsum("ij,ij->j", shared, self.cells @ shared)  # type: ignore[no-any-return]


class _Left(NamedTuple):
    """What a map leaves of one covariance at M places [m²].

    ``variance`` (M,): error. ``noise`` (M,): its part from errors of samples and cells. ``squared``: sum of the squared
    covariances of errors over all pairs of places [m⁴].
    """

    variance: FloatArray
    noise: FloatArray
    squared: float


@dataclass(frozen=True, eq=False)
class MapPredictor:
    """Predictor of the error of the map that samples at given places give, beside the cells of a prior.

    `area`: where the map is judged, at `n_nodes` places or so. `step_m`: distance between samples [m]. `inflation`: factor on
    predicted errors for covariances that are fitted. `cells`: the prior that the map is made with.
    """

    area: SurveyArea
    step_m: float
    inflation: float = 1.0
    cells: PriorCells | None = None
    n_nodes: int = _N_NODES

    @cached_property
    def nodes(self) -> FloatArray:
        """Places (M, 2) on the free ground [m], in no step with any swaths; any first part of them is spread evenly."""
        return spread_places(self.area, self.n_nodes)

    @cached_property
    def _reach_m(self) -> float:
        """Farthest that two places of the area or its cells can be apart [m], rounded up so that edited areas share tables."""
        xmin, ymin, xmax, ymax = self.area.bounds
        pad_m = 0.0 if self.cells is None else 4.0 * self.cells.cell_m
        reach_m = np.hypot(xmax - xmin + pad_m, ymax - ymin + pad_m)
        return float(2.0 ** (np.ceil(4.0 * np.log2(reach_m)) / 4.0))

    def distribution(
        self, xy: FloatArray, posterior: KernelPosterior, own_m2: FloatArray | None = None
    ) -> ErrorDistribution:
        """Predict the distribution of the map's error, from samples at places (N, 2) [m].

        `own_m2` (N,): variances of the samples' errors beside those of the covariances [m²].
        """
        parts, n = [], len(self.nodes)
        found = (
            self._left_at_nodes(xy, posterior)
            if own_m2 is None
            else self._left(xy, posterior, self.nodes, own_m2)
        )
        for one, left in zip(posterior.kernels, found, strict=True):
            mean, noise = float(left.variance.mean()), float(left.noise.mean())
            parts.append(ErrorMoments(mean, 2.0 * left.squared / n**2, one.weight, noise))
        return ErrorDistribution(parts, posterior.spread, posterior.open_spread)

    def variance(
        self, xy: FloatArray, posterior: KernelPosterior, at: FloatArray | None = None
    ) -> FloatArray:
        """Return the variance of the map (M,) at places (M, 2) or the nodes, from samples at places (N, 2) [m²].

        It is the weighted geometric mean over the covariances, as the expected error is.
        """
        weights = [one.weight for one in posterior.kernels]
        found = (
            self._left_at_nodes(xy, posterior)
            if at is None
            else self._left(xy, posterior, at, only_variance=True)
        )
        logs = [np.log(np.maximum(one.variance, 1e-12)) for one in found]
        variance: FloatArray = np.exp(np.average(logs, axis=0, weights=weights))
        return variance

    def _left_at_nodes(self, xy: FloatArray, posterior: KernelPosterior) -> list[_Left]:
        """Return what the map leaves at the nodes; that of the last samples is kept, for the picture after the headline."""
        for samples, covariances, found in self._last:
            if covariances is posterior and np.array_equal(samples, xy):
                return found
        self._last[:] = [(xy, posterior, self._left(xy, posterior, self.nodes))]
        return self._last[0][-1]

    @cached_property
    def _last(self) -> list[tuple[FloatArray, KernelPosterior, list[_Left]]]:
        return []

    def shared_part(
        self, xy: FloatArray, one: WeightedKernel, own_m2: FloatArray, shared_m2: FloatArray
    ) -> FloatArray:
        """Return what errors that samples share add to the covariance of the map's errors at the nodes (M, M) [m²].

        `xy` (N, 2): places of the samples [m]. `own_m2` (N,), `shared_m2` (N, N): variances of their own errors beside that of
        the covariance, and covariance of the errors that they share [m²].
        """
        everywhere = np.arange(len(self.nodes))
        cells = None if self.cells is None else self.cells.spread(_MOST_CELLS)
        group = _Group(everywhere, xy, own_m2, cells)
        seen = self._seen(group, one, self.nodes)
        own = self._errors(one, group).added_to(seen.among)
        both = own.copy()
        both[: len(xy), : len(xy)] += shared_m2 / one.variance_m2
        part = np.zeros((len(everywhere), len(everywhere)))
        for sign, total in ((1.0, both), (-1.0, own)):
            solved = lapack.dpotrf(total.T, lower=1, overwrite_a=1, clean=0)[0]
            half = lapack.dtrtrs(solved, np.column_stack([np.ones(len(solved)), seen.across]), lower=1)[0]
            ones, explained = half[:, 0], half[:, 1:]
            gap = 1.0 - ones @ explained
            part += sign * one.variance_m2 * (np.outer(gap, gap) / (ones @ ones) - explained.T @ explained)
        return part

    def _left(
        self,
        xy: FloatArray,
        posterior: KernelPosterior,
        at: FloatArray,
        own_m2: FloatArray | None = None,
        *,
        only_variance: bool = False,
    ) -> list[_Left]:
        """Return what the map leaves at places (M, 2), for each covariance; with `only_variance` the rest is zero."""
        n_kernels = len(posterior.kernels)
        own_m2 = np.zeros(len(xy)) if own_m2 is None else own_m2
        thin = self._averaged(xy)
        xy, own_m2 = xy[::thin], own_m2[::thin] / thin
        posterior = posterior.with_noise_times(1.0 / float(np.sqrt(thin)))
        variance, noise = np.empty((n_kernels, len(at))), np.empty((n_kernels, len(at)))
        squared = np.zeros(n_kernels)
        most = _MOST_FOR_PICTURES if only_variance and self.cells is not None else _MOST_AT_ONCE
        for group in self._groups(xy, at, own_m2, most):
            seen: dict[object, _Seen] = {}
            for k, one in enumerate(posterior.kernels):
                key = one.correlation_key
                if key not in seen:
                    seen[key] = self._seen(group, one, at)
                left = self._under(one, seen[key], group, at, only_variance=only_variance)
                variance[k, group.places], noise[k, group.places] = left.variance, left.noise
                squared[k] += left.squared
        return [_Left(*each) for each in zip(variance, noise, squared.tolist(), strict=True)]

    def _groups(self, xy: FloatArray, at: FloatArray, own_m2: FloatArray, most: int) -> Iterator[_Group]:
        """Yield all places together, or with more samples than `most` or many cells groups of them with those about each."""
        everywhere = np.arange(len(at))
        if len(xy) <= most and (self.cells is None or len(self.cells) <= _MOST_CELLS):
            yield _Group(everywhere, xy, own_m2, self.cells)
            return
        tree, waiting = cKDTree(xy), [everywhere]
        while waiting:
            index = waiting.pop()
            centre = 0.5 * (at[index].min(axis=0) + at[index].max(axis=0))
            far, near = tree.query(centre, min(_N_NEAR, len(xy)))
            cells = None if self.cells is None else self.cells.nearest(centre, _N_NEAR)
            known_m = min(float(np.max(far)), np.inf if cells is None else cells.farthest_m(centre))
            radius_m = float(np.hypot(*(at[index] - centre).T).max())
            if len(index) > 1 and radius_m > _NEAR_SHARE * known_m:
                along = int(np.argmax(np.ptp(at[index], axis=0)))
                waiting += np.array_split(index[np.argsort(at[index, along], kind="stable")], 2)
                continue
            near = np.atleast_1d(near)
            yield _Group(index, xy[near], own_m2[near], cells)

    def _averaged(self, xy: FloatArray) -> int:
        """Return how many neighbouring samples one stands for, so that samples near a place lie on several lines."""
        if len(xy) <= _MOST_AT_ONCE:
            return 1
        apart_m = float(self.area.free.area) / (len(xy) * self.step_m)
        return max(int(_SHARE_OF_GAP * apart_m / self.step_m), 1)

    def _seen(self, group: _Group, one: WeightedKernel, at: FloatArray) -> _Seen:
        """Return the correlations of a group's samples and cells."""
        xy, nodes = group.xy, at[group.places]
        if one.known is not None:
            between = self._between(one)
            return _Seen(between(xy, xy), between(xy, nodes))
        cell, n = one.cell._replace(ratio=0.0), len(xy)
        n_all = n + (0 if group.cells is None else len(group.cells))
        among, across = np.zeros((n_all, n_all)), np.empty((n_all, len(nodes)))
        place = _correlogram(cell, self._reach_m)
        among[:n, :n], across[:n] = place.among(xy), place.between(xy, nodes)
        if group.cells is not None:
            centres = group.cells.centre
            mean, means = (_mean_correlogram(cell, self._reach_m, group.cells.cell_m, k) for k in (1, 2))
            among[:n, n:], among[n:, n:] = mean.between(xy, centres), means.among(centres)
            across[n:] = mean.between(centres, nodes)
        return _Seen(among, across)

    def _between(self, one: WeightedKernel) -> Callable[[FloatArray, FloatArray], FloatArray]:
        """Return the function that gives the correlation (A, B) of places (A, 2) with places (B, 2)."""
        if one.known is None:
            return _correlogram(one.cell._replace(ratio=0.0), self._reach_m).between
        known, per_m2 = one.known, 1.0 / one.variance_m2
        return lambda a, b: per_m2 * known.covariance(a, b)

    def _under(
        self, one: WeightedKernel, seen: _Seen, group: _Group, at: FloatArray, *, only_variance: bool
    ) -> _Left:
        """Return what is left at a group's places under one covariance."""
        scale_m2, n_places = self.inflation**2 * one.variance_m2, len(group.places)
        errors = self._errors(one, group)
        factor, failed = lapack.dpotrf(errors.added_to(seen.among).T, lower=1, overwrite_a=1, clean=0)
        if failed:
            every = np.full(n_places, one.variance_m2)
            return _Left(every, np.zeros(n_places), n_places**2 * one.variance_m2**2)
        half = lapack.dtrtrs(factor, np.column_stack([np.ones(len(factor)), seen.across]), lower=1)[0]
        ones, explained = half[:, 0], half[:, 1:]
        gap = (1.0 - ones @ explained) / (ones @ ones)
        left = 1.0 - np.square(explained).sum(axis=0) + np.square(gap) * (ones @ ones)
        if only_variance:
            return _Left(scale_m2 * left + one.unseen_m2, np.zeros(n_places), 0.0)
        weights = lapack.dtrtrs(factor, explained + np.outer(ones, gap), lower=1, trans=1)[0]
        noise = errors.variance_under(weights)
        n = min(n_places, _N_IN_COMMON)
        places, some, gap = at[group.places[:n]], explained[:, :n], gap[:n]
        common = self._between(one)(places, places) - some.T @ some + np.outer(gap, gap) * (ones @ ones)
        common *= scale_m2
        common[np.diag_indices(n)] += one.unseen_m2
        squared = float(np.square(common).sum()) * (n_places / n) ** 2
        return _Left(scale_m2 * left + one.unseen_m2, scale_m2 * noise + one.unseen_m2, squared)

    def _errors(self, one: WeightedKernel, group: _Group) -> _Errors:
        """Return the covariance of the errors of a group's samples and cells, over the variance of the terrain."""
        ratio = np.maximum((one.noise_m**2 + group.own_m2) / one.variance_m2, _LEAST_RATIO)
        cells = np.empty((0, 0)) if group.cells is None else group.cells.covariance / one.variance_m2
        return _Errors(np.broadcast_to(ratio, len(group.xy)), cells)


@lru_cache(maxsize=32)
def _mean_correlogram(cell: Cell, reach_m: float, width_m: float, n_means: int) -> MeanCorrelogram:
    """Return the table of a covariance with means over squares, which plans of one area share."""
    return MeanCorrelogram(cell, reach_m, width_m, n_means)


@lru_cache(maxsize=32)
def _correlogram(cell: Cell, reach_m: float) -> Correlogram:
    """Return the table of a covariance, which plans of one area share."""
    return Correlogram(cell, reach_m)

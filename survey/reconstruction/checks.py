r"""Checks of a map that need no reference: scores of held-out points, and the posterior of the map's RMSE.

`PredictiveScores` are coverage, z-scores, log score and PIT of predictions of points that were left out. `PredictiveCheck`
tests the standard deviation of a map by them, and gives a factor by distance where they contradict it. `RmsePosterior` is
the posterior of the root mean square error, given the joint covariance of the map's errors; `RmseClaim` is that of a map.
The covariance follows from a kernel, and grounds differ from any kernel that was fitted to them. So the errors count as
:math:`e^s` times as large as the covariance states, with s normal.

The mean square of correlated normal errors is :math:`Q = \sum_k \lambda_k X_k^2` with the eigenvalues λ of their covariance
over their number. `WeightedChiSquare` takes its distribution as that of a shifted and scaled chi-square with the same mean,
variance and skewness (Hall 1983, Buckley and Eagleson 1988).
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from scipy.special import chdtr, chdtrc, chdtri, ndtr, ndtri

from survey.core import DataObject, FloatArray, IntArray
from survey.reconstruction.level import TIES


@dataclass(frozen=True)
class WeightedChiSquare:
    r"""Distribution of :math:`\sum_k \lambda_k X_k^2` for independent standard normal X.

    `mean`: sum of the weights. `variance`: twice the sum of their squares. `n_free`: degrees of freedom of
    the chi-square with the same skewness.

    Meant for the upper half: probabilities of 0.8 and more err by less than 0.01. Below the mean, where one
    weight outweighs the others, they do not hold.

    >>> plain = WeightedChiSquare.of(np.ones(3))
    >>> round(plain.below(7.815), 3), round(plain.quantile(0.95), 3)
    (0.95, 7.815)
    """

    mean: float
    variance: float
    n_free: float

    @classmethod
    def of(cls, weights: FloatArray) -> Self:
        """Return the distribution for weights (K,) of 0 or more, at least one of them above 0."""
        first, second, third = (float(np.sum(weights**power)) for power in (1, 2, 3))
        return cls(first, 2.0 * second, second**3 / third**2)

    @classmethod
    def of_mean_square(cls, covariance: FloatArray) -> Self:
        """Return the distribution of the mean square of normal errors with a covariance (M, M)."""
        size = len(covariance)
        squared = covariance @ covariance
        first, second = float(np.trace(covariance)), float(np.trace(squared))
        third = float(np.sum(squared * covariance))
        return cls(first / size, 2.0 * second / size**2, second**3 / third**2)

    @property
    def n_effective(self) -> float:
        """Number of independent errors of equal size whose mean square would scatter as much."""
        return 2.0 * self.mean**2 / self.variance

    def below(self, value: float) -> float:
        """Return the probability of a smaller sum."""
        return float(chdtr(self.n_free, max(self._standard(value), 0.0)))

    def above(self, value: float) -> float:
        """Return the probability of a larger sum."""
        return float(chdtrc(self.n_free, max(self._standard(value), 0.0)))

    def quantile(self, probability: float) -> float:
        """Return the value that the sum stays below with a probability; 0 at least."""
        standard = float(chdtri(self.n_free, 1.0 - probability))
        return max(self.mean + (standard - self.n_free) * self._step, 0.0)

    def _standard(self, value: float) -> float:
        return self.n_free + (value - self.mean) / self._step

    @property
    def _step(self) -> float:
        """Size of one unit of the chi-square."""
        return float(np.sqrt(self.variance / (2.0 * self.n_free)))


LEVEL = 0.01
"""Chance that the test rejects a map whose standard deviation is right."""
_SIGMAS_95 = 1.959964
_N_BINS = 3
_N_LEAST = 10
# Factor that the standard deviation is widened by at most.
_MOST_WIDENED = 30.0


@dataclass(frozen=True)
class PredictiveScores:
    """Scores of predictions of held-out points.

    `n`: number of points. `coverage_95`: share of the points within the 95 % interval. `z_rms`: root mean
    square of error over predicted standard deviation; 1 when it is right. `log_score`: mean logarithm of the
    predictive density [nats]; the higher the better. `pit_tenths` (10,): share of the points in each tenth of
    the predictive distribution; 0.1 each when it is right.
    """

    n: int
    coverage_95: float
    z_rms: float
    log_score: float
    pit_tenths: tuple[float, ...]

    @classmethod
    def of(cls, error: FloatArray, sigma_m: FloatArray) -> Self:
        """Compute the scores of predictions.

        `error` (M,): measured less predicted values [m]. `sigma_m` (M,): standard deviations of the
        predictions [m].

        >>> scores = PredictiveScores.of(np.array([0.1, -0.3]), np.array([0.1, 0.1]))
        >>> scores.coverage_95, round(scores.z_rms, 2)
        (0.5, 2.24)
        """
        z = error / sigma_m
        tenths, _ = np.histogram(ndtr(z), bins=10, range=(0.0, 1.0))
        log_density = -0.5 * z**2 - np.log(sigma_m) - 0.5 * np.log(2.0 * np.pi)
        return cls(
            len(z),
            float(np.mean(np.abs(z) <= _SIGMAS_95)),
            float(np.sqrt(np.mean(z**2))),
            float(np.mean(log_density)),
            tuple(float(share) for share in tenths / len(z)),
        )


class HeldOutGroups(NamedTuple):
    """Means of neighbouring points that were left out together.

    `error_m` (K,): measured less predicted mean [m]. `variance_m2` (K,): variance of the prediction [m²].
    `noise_m2` (K,): variance of the mean of the points' own errors [m²]. `distance_m` (K,): distance to the
    nearest point that the prediction used [m]. `covariance_m2` (K, K): covariance of the errors by the claim
    of the map [m²].
    """

    error_m: FloatArray
    variance_m2: FloatArray
    noise_m2: FloatArray
    distance_m: FloatArray
    covariance_m2: FloatArray

    @classmethod
    def mixture(cls, each: Sequence[Self], weights: FloatArray) -> Self:
        """Return the groups of a mixture of maps, as in `HeldOut.mixture`.

        `weights` (J,): probabilities of the maps.
        """
        error, apart = _about_mean([one.error_m for one in each], weights)
        between = (weights * apart.T) @ apart
        variance = _average([one.variance_m2 for one in each], weights) + np.diag(between)
        noise = _average([one.noise_m2 for one in each], weights)
        covariance = _average([one.covariance_m2 for one in each], weights) + between
        return cls(error, variance, noise, each[0].distance_m, covariance)


@dataclass(frozen=True, eq=False, repr=False)
class HeldOut(DataObject):
    """Points predicted by a map that was made without them.

    `kind`: what was left out one at a time, in the plural: ``swaths``, ``parts of swaths`` or ``discs``.
    `n_blocks`: how many were left out. `error_m` (M,): measured less predicted height [m]. `variance_m2`
    (M,): variance of the prediction [m²]. `noise_m2` (M,): variance of the point's own error [m²].
    `distance_m` (M,): distance to the nearest point that the prediction used [m]. `groups`: means of
    neighbours, in which the points' own errors average out and those of the map remain.
    """

    kind: str
    n_blocks: int
    error_m: FloatArray
    variance_m2: FloatArray
    noise_m2: FloatArray
    distance_m: FloatArray
    groups: HeldOutGroups

    @classmethod
    def mixture(cls, each: Sequence[Self], weights: FloatArray) -> Self:
        """Return the predictions of a mixture of maps of the same points: means, and covariances with that of the means.

        `weights` (K,): probabilities of the maps.
        """
        first = each[0]
        error, apart = _about_mean([one.error_m for one in each], weights)
        variance = _average([one.variance_m2 for one in each], weights) + weights @ apart**2
        noise = _average([one.noise_m2 for one in each], weights)
        groups = HeldOutGroups.mixture([one.groups for one in each], weights)
        return cls(first.kind, first.n_blocks, error, variance, noise, first.distance_m, groups)

    @property
    def sigma_m(self) -> FloatArray:
        """Standard deviation of the errors (M,) by the claim of the map [m]."""
        return np.sqrt(self.variance_m2 + self.noise_m2)


def _average(each: Sequence[FloatArray], weights: FloatArray) -> FloatArray:
    """Return the weighted mean of arrays of one shape."""
    return np.tensordot(weights, np.array(each), axes=1)


def _about_mean(each: Sequence[FloatArray], weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the weighted mean (M,) of K vectors, and their differences from it (K, M)."""
    mean = _average(each, weights)
    return mean, np.array(each) - mean


@dataclass(frozen=True)
class PredictiveCheck:
    r"""Test of a map's standard deviation by points that were left out.

    Within each range of distance to the nearest remaining point the mean of the squared z-scores of group means
    is compared with its distribution for the covariance that the map claims, :math:`\sum_k \lambda_k X_k^2` with
    the eigenvalues λ of the z-scores' correlation over their number. Correlated groups thus count as few.

    `kind`: what was left out one at a time, in the plural. `n_blocks`: how many were left out. `before`,
    `after`: scores by the map's claim, and after widening. `distance_m` (B,): median distance to the nearest
    remaining point in each range [m]. `n_effective` (B,): number of independent group means in each range.
    `p_value` (B,): chance of a larger mean square if the claim is right. `factor` (B,): factor on the
    standard deviation, 1 where the test does not reject.
    """

    kind: str
    n_blocks: int
    before: PredictiveScores
    after: PredictiveScores
    distance_m: tuple[float, ...]
    n_effective: tuple[float, ...]
    p_value: tuple[float, ...]
    factor: tuple[float, ...]

    @classmethod
    def of(cls, held_out: HeldOut) -> Self | None:
        """Test a map by held-out points.

        Returns: None with fewer than ten groups of points.
        """
        groups = held_out.groups
        if len(groups.error_m) < _N_LEAST:
            return None
        sigma = np.sqrt(np.diag(groups.covariance_m2))
        z, correlation = groups.error_m / sigma, groups.covariance_m2 / np.outer(sigma, sigma)
        middles, effective, p_values, factors = [], [], [], []
        for here in _ranges(groups.distance_m):
            expected = WeightedChiSquare.of_mean_square(correlation[np.ix_(here, here)])
            p_value = expected.above(float(np.mean(z[here] ** 2)))
            middles.append(float(np.median(groups.distance_m[here])))
            effective.append(expected.n_effective)
            p_values.append(p_value)
            factors.append(_factor(groups, here) if p_value < LEVEL / _N_BINS else 1.0)
        factor = np.interp(held_out.distance_m, middles, factors)
        widened = np.sqrt(factor**2 * held_out.variance_m2 + held_out.noise_m2)
        return cls(
            held_out.kind,
            held_out.n_blocks,
            PredictiveScores.of(held_out.error_m, held_out.sigma_m),
            PredictiveScores.of(held_out.error_m, widened),
            tuple(middles),
            tuple(effective),
            tuple(p_values),
            tuple(factors),
        )

    @property
    def contradicts(self) -> bool:
        """Whether held-out points contradict the claim of the map, at 1 % for all ranges of distance together."""
        return min(self.p_value) < LEVEL / _N_BINS

    def factor_at(self, distance_m: FloatArray) -> FloatArray:
        """Return the factor on the standard deviation.

        `distance_m`: distances to the nearest point [m].
        """
        return np.interp(distance_m, self.distance_m, self.factor)

    @property
    def sentence(self) -> str:
        """The finding in one sentence."""
        found = (
            f"{self.n_blocks} {self.kind} left out: {100.0 * self.before.coverage_95:.0f} % of {self.before.n} points "
            "lie within the predicted 95 % interval"
        )
        verdict = (
            f"which contradicts the standard deviation (level {100.0 * LEVEL:g} %)"
            if self.contradicts
            else "which agrees with the standard deviation"
        )
        if max(self.factor) <= 1.005:
            return f"{found}, {verdict}."
        return (
            f"{found}, {verdict}; it is widened by a factor of up to {max(self.factor):.2f}, after which "
            f"{100.0 * self.after.coverage_95:.0f} % do."
        )

    def facts(self) -> dict[str, Any]:
        """Return the check for the record of a map."""
        return asdict(self) | {"level": LEVEL, "contradicts": self.contradicts, "sentence": self.sentence}

    @classmethod
    def from_facts(cls, facts: Mapping[str, Any]) -> Self:
        """Rebuild a check from the record of a map."""
        lists = ("distance_m", "n_effective", "p_value", "factor")
        before, after = (
            PredictiveScores(**{**facts[name], "pit_tenths": tuple(facts[name]["pit_tenths"])})
            for name in ("before", "after")
        )
        return cls(facts["kind"], facts["n_blocks"], before, after, *(tuple(facts[name]) for name in lists))


def _ranges(distance_m: FloatArray) -> list[IntArray]:
    """Return the rows of points in each third of the distances; fewer where distances repeat."""
    edges = np.quantile(distance_m, np.linspace(0.0, 1.0, _N_BINS + 1))
    index = np.clip(np.searchsorted(edges, distance_m, side="right") - 1, 0, _N_BINS - 1)
    rows = (np.flatnonzero(index == k) for k in range(_N_BINS))
    return [here for here in rows if len(here)]


def _factor(groups: HeldOutGroups, rows: IntArray) -> float:
    """Return the factor on the predicted deviation that brings the mean squared z-score to 1; 1 to 30."""
    from scipy.optimize import brentq  # slow to import, and readers of maps need none

    error, variance, noise = groups.error_m[rows], groups.variance_m2[rows], groups.noise_m2[rows]

    def excess(factor: float) -> float:
        return float(np.mean(error**2 / (factor**2 * variance + noise))) - 1.0

    if excess(_MOST_WIDENED) > 0.0:
        return _MOST_WIDENED
    return float(brentq(excess, 1.0, _MOST_WIDENED, xtol=1e-4)) if excess(1.0) > 0.0 else 1.0


CONFIDENCE = 0.95
"""Probability with which a class of a map is stated from its own claim."""
_MOST_NODES = 400
# With it at most 5 % of the errors, absolute and relative, of 192 maps of twelve kinds of ground exceed their limit.
_SCALE_LOG_SD = 0.22
# Equally probable values of a standard normal variable.
_STANDARD = ndtri((np.arange(200) + 0.5) / 200)


@dataclass(frozen=True)
class RmsePosterior:
    """Posterior of a root mean square error.

    `expected_m`: root of the expected mean square error [m]. `sigma_m`: standard deviation of the root mean
    square error, to first order [m]. `upper_m`: what it stays below with a probability of 95 % [m].
    """

    expected_m: float
    sigma_m: float
    upper_m: float

    @classmethod
    def of(cls, covariance_m2: FloatArray) -> Self:
        r"""Compute the posterior for normal errors of mean 0, whose size is uncertain.

        .. math:: \mathrm{RMSE}^2 = e^{2 s} Q, \quad s \sim N(-\tau^2, \tau^2), \quad \tau = 0.22,

        with Q the mean square of errors with this covariance; the expectation of the square is that of Q.

        `covariance_m2` (M, M): covariance of the errors [m²].

        >>> one = RmsePosterior.of(0.04 * np.ones((3, 3)))
        >>> round(one.expected_m, 3), round(one.upper_m / one.expected_m, 2)
        (0.2, 2.0)
        """
        squared = WeightedChiSquare.of_mean_square(covariance_m2)
        expected = float(np.sqrt(squared.mean))
        relative_sd = float(np.hypot(np.sqrt(squared.variance) / (2.0 * squared.mean), _SCALE_LOG_SD))
        return cls(expected, relative_sd * expected, float(np.sqrt(_upper_m2(squared))))


def _upper_m2(squared: WeightedChiSquare) -> float:
    """Return what a mean square stays below with a probability of 95 %, its size uncertain [m²]."""
    from scipy.optimize import brentq

    scales = np.exp(2.0 * _SCALE_LOG_SD * (_STANDARD - _SCALE_LOG_SD))

    def missing(value: float) -> float:
        return float(np.mean([squared.below(value / scale) for scale in scales])) - CONFIDENCE

    alone = squared.quantile(CONFIDENCE)
    return float(brentq(missing, alone * scales.min(), alone * scales.max(), xtol=1e-9 * alone))


@dataclass(frozen=True)
class RmseClaim:
    """Posterior of a map's error by its own claim, with the best vertical offset and without.

    `absolute`: of the errors as they are. `relative`: of the errors less their mean, which a vertical offset
    removes. `offset_sigma_m`: standard deviation of that mean [m]. `untested_share`: share of the ground that
    lies farther from all points than any point that was left out to test the standard deviation; 0 where
    nothing was left out.
    """

    absolute: RmsePosterior
    relative: RmsePosterior
    offset_sigma_m: float
    untested_share: float = 0.0

    @classmethod
    def of(cls, covariance_m2: FloatArray, std_m: FloatArray) -> Self:
        """Compute the claim of a map from the covariance of its errors, scaled to its stated standard deviations.

        `covariance_m2` (M, M): covariance of the heights at the nodes [m²]. `std_m` (M,): standard deviations
        that the map states there [m].
        """
        scale = std_m / np.sqrt(np.diag(covariance_m2))
        stated = covariance_m2 * np.outer(scale, scale)
        by_row = stated.mean(axis=0)
        centred = stated - by_row[:, None] - by_row[None, :] + by_row.mean()
        return cls(
            RmsePosterior.of(stated), RmsePosterior.of(centred), float(np.sqrt(max(by_row.mean(), 0.0)))
        )

    @property
    def level_share(self) -> float:
        """Share of the level in the expected squared error."""
        return min((self.offset_sigma_m / max(self.absolute.expected_m, 1e-9)) ** 2, 1.0)

    @property
    def tied_m(self) -> dict[str, float]:
        """Expected error once one known height of `TIES` holds the level, by the name of the tie [m]."""
        beside_m, level_m = self.relative.expected_m, self.offset_sigma_m
        return {name: float(np.hypot(beside_m, tie.left_m(level_m, beside_m))) for name, tie in TIES.items()}

    def facts(self) -> dict[str, Any]:
        """Return the claim for the record of a map."""
        return asdict(self) | {"level_share": self.level_share, "tied_m": self.tied_m}

    @classmethod
    def from_facts(cls, facts: Mapping[str, Any]) -> Self:
        """Rebuild a claim from the record of a map."""
        absolute, relative = (RmsePosterior(**facts[name]) for name in ("absolute", "relative"))
        return cls(absolute, relative, facts["offset_sigma_m"], facts.get("untested_share", 0.0))


def sampled_nodes(inside: npt.NDArray[np.bool_]) -> IntArray:
    """Return at most 400 evenly spread nodes of a grid, as rows of its nodes in order, among those inside (H, W).

    >>> sampled_nodes(np.ones((40, 40), dtype=bool)).size
    400
    """
    step = max(int(np.ceil(np.sqrt(inside.sum() / _MOST_NODES))), 1)
    first = step // 2
    chosen = np.zeros_like(inside)
    chosen[first::step, first::step] = True
    rows = np.flatnonzero((chosen & inside).ravel())
    return rows if len(rows) else np.flatnonzero(inside.ravel())[:_MOST_NODES]

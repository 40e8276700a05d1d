r"""Map of an intensity from counts: a log-Gaussian field, its posterior by Laplace's method, and its intervals.

A count n of exposure τ at x has the expectation μ = τ λ(x), and

.. math::  \log \lambda(x) = m + f(x), \quad f \sim \mathrm{GP}(0, k), \qquad
           \operatorname{var} n = \mu + \varphi \mu^2

(Møller, Syversveen and Waagepetersen 1998, Log Gaussian Cox processes; with φ > 0 the counts are negative binomial, which
allows for what changes between counts: gusts, dead time). The posterior of f for given hyperparameters is the normal
distribution about its mode (Rasmussen and Williams 2006, section 3.4). Variance, length, φ and the stretch along the wind have
priors, and the normal distribution about the maximum of their posterior is represented by points of equal mean and covariance, so
that intervals hold what the counts leave open of them. Three covariance functions are averaged by Laplace's evidence.
"""

from typing import Literal, NamedTuple, Self, get_args

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.optimize import minimize
from scipy.special import gammaln, ndtr
from threadpoolctl import threadpool_limits

from survey.core import FloatArray, InputError
from survey.reconstruction.counts.counts import Counts

# Variance of the prior of the mean logarithm: any intensity.
_MEAN_VARIANCE = 25.0
_JITTER = 1e-6
_N_LEAST, _N_FITTED, _AT_ONCE = 10, 400, 4096
_NEWTON_STEPS, _SETTLED = 60, 1e-9
_DIFFERENCE = 0.15
_LEAST_PRECISION, _LEAST_WEIGHT = 0.25, 0.01
_BISECTIONS = 40


Family = Literal["exponential", "matern-3/2", "squared-exponential"]
FAMILIES: tuple[Family, ...] = get_args(Family)
"""Covariance functions that a fit averages over: rough, of one derivative, and smooth."""


class CountHyperparameters(NamedTuple):
    """Covariance function, standard deviation of the logarithm, length scale [m], dispersion φ, and stretch of the length scale along the wind."""

    family: Family
    sigma: float
    length_m: float
    dispersion: float
    stretch: float = 1.0


class LogIntensity(NamedTuple):
    """Posterior of the logarithm of the intensity at M places: a mixture of K normal distributions.

    Parameters
    ----------
    weights : (K,) ndarray
        Weights of the distributions.
    mean, sd : (K, M) ndarray
        Their means and standard deviations; the intensity is in counts per second.
    """

    weights: FloatArray
    mean: FloatArray
    sd: FloatArray

    def below(self, rate_per_s: float) -> FloatArray:
        """Return the probabilities (M,) that the intensity is below a rate [1/s]."""
        found: FloatArray = np.tensordot(self.weights, ndtr((np.log(rate_per_s) - self.mean) / self.sd), 1)
        return found

    def quantile(self, share: float) -> FloatArray:
        """Return the quantile (M,) of the intensity [1/s], by bisection of the distribution of its logarithm."""
        low, high = (self.mean - 9.0 * self.sd).min(axis=0), (self.mean + 9.0 * self.sd).max(axis=0)
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            is_below = np.tensordot(self.weights, ndtr((middle - self.mean) / self.sd), 1) < share
            low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
        quantile: FloatArray = np.exp(0.5 * (low + high))
        return quantile


def require_counts(counts: Counts) -> None:
    """Raise `InputError` for counts that give no map: few, none, or all of one place."""
    extent_m = float(np.hypot(*np.ptp(counts.xy, axis=0)))
    if len(counts) < _N_LEAST:
        raise InputError(f"{len(counts)} counts were given; a map needs at least {_N_LEAST}.")
    if counts.n.sum() < 1.0:
        raise InputError(f"nothing was counted in {counts.exposure_s.sum():.0f} s; a map needs counts.")
    if extent_m < 1.0:
        raise InputError(f"the counts lie within {extent_m:.2g} m; a map needs counts along a way.")


class IntensityField:
    """Log-Gaussian field given counts.

    Parameters
    ----------
    counts : Counts
        Counts on the way; more than 400 are summed in blocks.
    parts : sequence of (float, CountHyperparameters)
        Weights and hyperparameters.

    Notes
    -----
    The intensity is taken as constant in time, and places as exact. Counts cannot separate structure of the ground that is finer than their
    distance from what changes between counts: the dispersion is part of the interval.
    """

    def __init__(self, counts: Counts, parts: list[tuple[float, CountHyperparameters]]) -> None:
        self.counts, self.parts = counts, parts
        self._modes = [_Mode.of(counts, one) for _, one in parts]

    @classmethod
    @threadpool_limits.wrap(limits=1, user_api="blas")
    def fit(cls, counts: Counts) -> Self:
        """Find hyperparameters with their weights.

        Parameters
        ----------
        counts : Counts
            Counts on the way.

        Returns
        -------
        IntensityField
            The field given all counts.

        Raises
        ------
        InputError
            Nothing was counted, or all counts are of one place.
        """
        require_counts(counts)
        few = counts.in_blocks(_N_FITTED)
        extent_m = float(np.hypot(*np.ptp(few.xy, axis=0)))
        prior = _Prior.of(extent_m, has_wind=few.wind_m_s is not None)
        peaks = [_Peak.of(few, prior, family) for family in FAMILIES]
        evidence = np.array([peak.log_evidence for peak in peaks])
        weights = np.exp(evidence - evidence.max())
        weights = np.where(weights < _LEAST_WEIGHT * weights.sum(), 0.0, weights)
        parts = [
            (float(weight * share / weights.sum()), prior.read(peak.family, point))
            for weight, peak in zip(weights, peaks, strict=True)
            if weight > 0.0
            for share, point in peak.points()
        ]
        return cls(few, sorted(parts, key=lambda part: -part[0]))

    @property
    def hyperparameters(self) -> CountHyperparameters:
        """Hyperparameters of the largest posterior density."""
        return self.parts[0][1]

    @threadpool_limits.wrap(limits=1, user_api="blas")
    def at(self, xy: FloatArray) -> LogIntensity:
        """Return the posterior of the logarithm of the intensity at places.

        Parameters
        ----------
        xy : (M, 2) ndarray
            Places [m].

        Returns
        -------
        LogIntensity
            The intensity in counts per second.
        """
        blocks = [xy[k : k + _AT_ONCE] for k in range(0, len(xy), _AT_ONCE)]
        found = [[mode.at(block) for block in blocks] for mode in self._modes]
        mean, sd = (np.stack([np.concatenate([one[k] for one in each]) for each in found]) for k in (0, 1))
        return LogIntensity(np.array([weight for weight, _ in self.parts]), mean, sd)


class _Prior(NamedTuple):
    """Normal prior of the logarithms of the hyperparameters: means and standard deviations (3,), or (4,) with wind."""

    mean: FloatArray
    sd: FloatArray

    @classmethod
    def of(cls, extent_m: float, *, has_wind: bool) -> Self:
        mean, sd = [0.0, np.log(0.15 * extent_m), np.log(0.01)], [1.0, 1.0, 2.0]
        return cls(np.array([*mean, 0.5][: 3 + has_wind]), np.array([*sd, 0.5][: 3 + has_wind]))

    @property
    def bounds(self) -> list[tuple[float, float]]:
        return [(float(m - 4.0 * s), float(m + 4.0 * s)) for m, s in zip(self.mean, self.sd, strict=True)]

    def penalty(self, parameters: FloatArray) -> float:
        return float(0.5 * np.sum(((parameters - self.mean) / self.sd) ** 2))

    @staticmethod
    def read(family: Family, parameters: FloatArray) -> CountHyperparameters:
        return CountHyperparameters(family, *(float(value) for value in np.exp(parameters)))


class _Peak(NamedTuple):
    """Maximum of the posterior of a family's parameters, a root (P, P) of their covariance, and Laplace's logarithm of the evidence."""

    family: Family
    parameters: FloatArray
    root: FloatArray
    log_evidence: float

    @classmethod
    def of(cls, counts: Counts, prior: _Prior, family: Family) -> Self:
        """Climb from the mean of the prior, and take second differences at the top."""

        def loss(parameters: FloatArray) -> float:
            return prior.penalty(parameters) - _Mode.of(counts, prior.read(family, parameters)).log_evidence

        best = minimize(
            loss, prior.mean, method="L-BFGS-B", bounds=prior.bounds, options={"eps": 1e-3, "maxiter": 40}
        )
        size = len(best.x)
        steps, hessian = _DIFFERENCE * np.eye(size), np.empty((size, size))
        for i in range(size):
            for j in range(i + 1):
                signs = ((1, 1, 1.0), (1, -1, -1.0), (-1, 1, -1.0), (-1, -1, 1.0))
                values = [sign * loss(best.x + a * steps[i] + b * steps[j]) for a, b, sign in signs]
                hessian[i, j] = hessian[j, i] = sum(values) / (4.0 * _DIFFERENCE**2)
        values_of, vectors = np.linalg.eigh(hessian)
        precise = np.maximum(values_of, _LEAST_PRECISION)
        return cls(
            family, best.x, vectors / np.sqrt(precise), -float(best.fun) - 0.5 * float(np.log(precise).sum())
        )

    def points(self) -> list[tuple[float, FloatArray]]:
        """Return points with weights that have the mean and the covariance of the posterior."""
        size = len(self.parameters)
        spread, weight = np.sqrt(size + 1.0), 0.5 / (size + 1.0)
        around = [self.parameters + sign * spread * column for column in self.root.T for sign in (1.0, -1.0)]
        return [(1.0 / (size + 1.0), self.parameters), *((weight, point) for point in around)]


class _Mode(NamedTuple):
    """Mode of the field at the counts, and the factors that predictions need.

    `gradient` (N,): of the log likelihood at the mode. `root` (N,): square root of the negative second derivatives.
    `factor` (N, N): lower Cholesky factor of ``I + W^½ K W^½``.
    """

    counts: Counts
    found: CountHyperparameters
    level: float
    gradient: FloatArray
    root: FloatArray
    factor: FloatArray
    log_evidence: float

    @classmethod
    def of(cls, counts: Counts, found: CountHyperparameters) -> Self:
        """Find the mode by Newton's method (Rasmussen and Williams 2006, algorithm 3.1)."""
        level = float(np.log(max(counts.n.sum(), 0.5) / counts.exposure_s.sum()))
        covariance = _covariance(counts, counts.xy, found)
        covariance[np.diag_indices_from(covariance)] += _JITTER * found.sigma**2
        f, dual, objective = np.zeros(len(counts)), np.zeros(len(counts)), -np.inf
        for _ in range(_NEWTON_STEPS):
            gradient, curvature, _ = _likelihood(counts, level + f, found.dispersion)
            root = np.sqrt(curvature)
            factor = _factor(covariance, root)
            target = curvature * f + gradient
            step = (
                target
                - root * cho_solve((factor, True), root * (covariance @ target), check_finite=False)
                - dual
            )
            share = 1.0
            while True:  # the logarithm is concave: a shorter step rises
                tried = dual + share * step
                at = covariance @ tried
                value = _likelihood(counts, level + at, found.dispersion)[2] - 0.5 * float(tried @ at)
                if value > objective or share < 1e-4:
                    break
                share *= 0.5
            gain, dual, f, objective = value - objective, tried, at, value
            if gain < _SETTLED * max(1.0, abs(objective)):
                break
        gradient, curvature, _ = _likelihood(counts, level + f, found.dispersion)
        root = np.sqrt(curvature)
        factor = _factor(covariance, root)
        evidence = objective - float(np.log(np.diag(factor)).sum())
        return cls(counts, found, level, gradient, root, factor, evidence)

    def at(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (M,) of the logarithm of the intensity at places (M, 2)."""
        cross = _covariance(self.counts, xy, self.found)
        half = solve_triangular(self.factor, self.root[:, None] * cross, lower=True, check_finite=False)
        variance = self.found.sigma**2 + _MEAN_VARIANCE - np.sum(half**2, axis=0)
        # Dispersion may be structure of the ground that is finer than the counts.
        variance += np.log1p(self.found.dispersion)
        return self.level + cross.T @ self.gradient, np.sqrt(np.maximum(variance, 1e-12))


def _factor(covariance: FloatArray, root: FloatArray) -> FloatArray:
    matrix = root[:, None] * covariance * root
    matrix[np.diag_indices_from(matrix)] += 1.0
    factor: FloatArray = cholesky(matrix, lower=True, overwrite_a=True, check_finite=False)
    return factor


def _covariance(counts: Counts, xy: FloatArray, found: CountHyperparameters) -> FloatArray:
    """Return the covariance (N, M) of the field with its mean at the counts and at places, longer along the wind."""
    lag = counts.xy[:, None] - xy
    if counts.wind_m_s is None:
        distance = np.hypot(lag[..., 0], lag[..., 1])
    else:
        wind = counts.wind_m_s.mean(axis=0)
        along = wind / max(float(np.hypot(*wind)), 1e-12)
        distance = np.hypot(lag @ along / found.stretch, lag @ np.array([-along[1], along[0]]))
    s = distance / found.length_m
    if found.family == "squared-exponential":
        correlation = np.exp(-0.5 * s**2)
    elif found.family == "exponential":
        correlation = np.exp(-s)
    else:
        correlation = (1.0 + np.sqrt(3.0) * s) * np.exp(-np.sqrt(3.0) * s)
    covariance: FloatArray = found.sigma**2 * correlation + _MEAN_VARIANCE
    return covariance


def _likelihood(
    counts: Counts, log_rate: FloatArray, dispersion: float
) -> tuple[FloatArray, FloatArray, float]:
    """Return gradient and negative second derivative (N,) of the log likelihood in the logarithm of the rate, and its value."""
    n, mu, r = counts.n, counts.exposure_s * np.exp(np.clip(log_rate, -60.0, 60.0)), 1.0 / dispersion
    gradient = (n - mu) / (1.0 + dispersion * mu)
    curvature = mu * (1.0 + dispersion * n) / (1.0 + dispersion * mu) ** 2
    value = gammaln(n + r) - gammaln(r) - gammaln(n + 1.0) - (n + r) * np.log1p(dispersion * mu)
    value += n * (np.log(dispersion) + np.log(mu))
    return gradient, np.maximum(curvature, 1e-12), float(value.sum())

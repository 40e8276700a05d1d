r"""Kernels of a terrain with weights: several families, isotropic and anisotropic, fitted to the same points.

No single family is the best on all ground. Sparse lines leave the family and the direction of the relief open, and a map with
the likeliest kernel alone then errs more and claims less than the average of maps with all of them. `averaged_kernels` fits
each family of `MEMBERS` to at most 320 of the points by the maximum of its posterior, with the trend integrated out,

.. math::  \log p(z \mid \theta) + \log p(\theta), \qquad
           \log p = -\tfrac12 \left( z^T \Pi z + \log |V| + \log |H^T V^{-1} H| + (n - t) \log 2\pi \right)

(Rasmussen and Williams 2006, section 2.7), with the covariance V of the points, the columns H of the trend, and normal
priors of the logarithms θ of variances and length scales. Parts of a sum share one anisotropy: the scaled distance is that of
the metric :math:`\exp(-2 A)`, where the symmetric matrix A of trace 0 has the elements p and q, both normal about 0, so that
isotropic ground is an interior point of the fit and the direction has no jump.

Ground differs from place to place: terraces, channels, moraine on smooth ice. The heaviest anisotropic kernels are fitted
again to each quarter of the site, with parameters near those of the site, and hold there (`Patch`); neighbours are blended.

The weights are those of the posteriors to the power of 1/20. Points on lines are no independent evidence of the ground between
them, and no family is the true one: of the powers that were tried on development ground this one gave intervals that held.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.distance import squareform
from scipy.special import k0, softmax

from survey.core import FloatArray, IntArray
from survey.reconstruction.gp.families import Sum, family_of
from survey.reconstruction.gp.kernels import Exponential, Kernel, Matern32, Matern52, Stationary, Whittle
from survey.reconstruction.gp.marginal_likelihood import (
    Hyperparameters,
    KernelInAverage,
    Patch,
    are_wide,
    inverse_and_log_determinant,
    well_spread,
)

N_FITTED = 320
"""Most points that the kernels are fitted to."""
_POWER = 1.0 / 20.0
# Kernels of a smaller weight are left out.
_LEAST_WEIGHT = 0.04
# Prior means of length scales over the extent of the points, of the first part and of the second; standard deviations of
# the logarithms of variance and length, of the anisotropy's elements, and of the nugget's variance.
_LENGTHS, _VARIANCES = (0.2, 0.04), (1.0, 0.05)
_VARIANCE_SD, _LENGTH_SD, _ANISOTROPY_SD, _NUGGET_SD = 3.0, 1.5, 0.5, 2.0
_NUGGET_OVER_NOISE = 0.14
_FIRST_LENGTHS = (1.0, 0.3)
# Kernels that differ from one quarter of the site to the next, the fewest and the most points that one is fitted to, its
# reach over the extent of the points, and the standard deviations of its parameters about those of the site.
_MOST_LOCAL, _FEWEST_IN_PATCH, _MOST_IN_PATCH, _PATCH_REACH = 2, 60, 250, 0.375
_LOCAL_SD, _LOCAL_ANISOTROPY_SD = 0.5, 0.25


class Member(NamedTuple):
    """Parts of a kernel, the smoothest first, and whether they share an anisotropy."""

    parts: tuple[type[Stationary], ...]
    is_anisotropic: bool


MEMBERS = (
    Member((Matern32,), False),
    Member((Whittle,), False),
    Member((Whittle,), True),
    Member((Matern32, Matern32), True),
    Member((Matern52, Matern32), True),
    Member((Matern52, Exponential), True),
)
"""Kernels that are averaged. The isotropic Whittle kernel with a long scale is the thin-plate spline."""


def averaged_kernels(
    xy: FloatArray,
    values: FloatArray,
    noise_m2: FloatArray,
    *,
    has_plane: bool = False,
    nugget_m: float | None = None,
    has_patches: bool = False,
    members: Sequence[Member] = MEMBERS,
) -> Hyperparameters:
    """Return the kernels of members that are fitted to points, with their weights.

    `xy`, `values`, `noise_m2` (N, 2), (N,) and (N,): places [m], values and noise variances. `has_plane`: whether the trend
    is a plane instead of a constant. `nugget_m`: standard deviation of relief too fine to be mapped [m]; fitted when None.
    `has_patches`: whether the heaviest kernels may differ from one quarter of the site to the next.
    """

    def posterior(rows: IntArray) -> _Posterior:
        given = xy[rows], values[rows], noise_m2[rows]
        return _Posterior.of(*given, has_plane=has_plane, nugget_m=nugget_m)

    few = posterior(well_spread(xy, N_FITTED))
    members = [one for one in members if not one.is_anisotropic or are_wide(xy)]
    fitted = [few.fit(one) for one in members]
    weights = weights_of(np.array([one.log_posterior for one in fitted]))
    order = [int(k) for k in np.argsort(-weights, kind="stable") if weights[k] > 0.0]
    patches = _patches(xy) if has_patches else []
    kernels, n_local = [], 0
    for k in order:
        if patches and members[k].is_anisotropic and n_local < _MOST_LOCAL:
            n_local += 1
            kernels += [
                posterior(rows).fit(members[k], fitted[k]).in_average(weights[k], patch)
                for patch, rows in patches
            ]
        else:
            kernels.append(fitted[k].in_average(weights[k], None))
    return hyperparameters_of_average(kernels)


def _patches(xy: FloatArray) -> list[tuple[Patch, IntArray]]:
    """Return the quarters of a site, each with the points in and about it; none where one holds few points."""
    low, extent = xy.min(axis=0), np.ptp(xy, axis=0)
    centres = tuple(
        (float(low[0] + a * extent[0]), float(low[1] + b * extent[1]))
        for b in (0.25, 0.75)
        for a in (0.25, 0.75)
    )
    width = float(0.25 * extent[0]), float(0.25 * extent[1])
    found = []
    for number, centre in enumerate(centres):
        near = np.flatnonzero((np.abs(xy - centre) < _PATCH_REACH * extent).all(axis=1))
        if len(near) < _FEWEST_IN_PATCH or not are_wide(xy[near]):
            return []
        found.append((Patch(number, centres, width), near[well_spread(xy[near], _MOST_IN_PATCH)]))
    return found


def hyperparameters_of_average(kernels: Sequence[KernelInAverage]) -> Hyperparameters:
    """Return kernels as hyperparameters: the heaviest, and the mean variance of the nuggets."""
    total = sum(one.weight for one in kernels)
    nugget_m = float(np.sqrt(sum(one.weight * one.nugget_m**2 for one in kernels) / total))
    first = kernels[0]
    return Hyperparameters(
        family_of(first.kernel), first.kernel, nugget_m, first.log_posterior, average=tuple(kernels)
    )


def weights_of(log_posteriors: FloatArray) -> FloatArray:
    """Return the weights (K,) that log posteriors give, which sum to 1; 0 where one would be little."""
    weights = softmax(_POWER * log_posteriors)
    weights[weights < _LEAST_WEIGHT] = 0.0
    normalized: FloatArray = weights / weights.sum()
    return normalized


def with_evidence(weights: FloatArray, log_evidence: FloatArray) -> FloatArray:
    """Return weights (K,) with further evidence of each kernel, to the same power."""
    changed = weights * np.exp(_POWER * (log_evidence - log_evidence.max()))
    normalized: FloatArray = changed / changed.sum()
    return normalized


def lightened(kernels: list[KernelInAverage], n_most: int) -> list[KernelInAverage]:
    """Return the heaviest kernels alone, with weights that sum to 1."""
    kept = kernels[:n_most]
    total = sum(one.weight for one in kept)
    return [one._replace(weight=one.weight / total) for one in kept]


class _Fitted(NamedTuple):
    """Parameters at the greatest posterior, the kernel that they state, the nugget [m], and the log posterior."""

    theta: FloatArray
    kernel: Kernel
    nugget_m: float
    log_posterior: float

    def in_average(self, weight: float, patch: Patch | None) -> KernelInAverage:
        """Return the kernel with its weight, and the patch where it holds."""
        return KernelInAverage(self.kernel, self.nugget_m, self.log_posterior, float(weight), patch)


@dataclass(frozen=True)
class _Lags:
    """Squared lags of all pairs of points: x² + y², x² - y² and 2 x y, each (n (n - 1) / 2,) [m²]."""

    plain: FloatArray
    straight: FloatArray
    oblique: FloatArray

    def scaled(self, p: float, q: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the squared distances in the metric exp(-2 A), and their derivatives by p and q [m²]."""
        r = max(float(np.hypot(p, q)), 1e-9)
        cosine, sine = np.cosh(2.0 * r), np.sinh(2.0 * r)
        along = p * self.straight + q * self.oblique
        squared = np.maximum(cosine * self.plain - sine / r * along, 0.0)
        turning = (2.0 * cosine / r - sine / r**2) / r
        by_p, by_q = (
            2.0 * sine * value / r * self.plain - turning * value * along - sine / r * lag
            for value, lag in ((p, self.straight), (q, self.oblique))
        )
        return squared, by_p, by_q


@dataclass(frozen=True)
class _Posterior:
    """Log posterior of the kernels of some points (n,), with its gradient.

    The parameters are the logarithms of variance and length of every part, p and q, and the logarithm of the nugget's
    variance.
    """

    values: FloatArray
    noise_m2: FloatArray
    trend: FloatArray
    lags: _Lags
    extent_m: float
    nugget_m: float | None

    @classmethod
    def of(
        cls,
        xy: FloatArray,
        values: FloatArray,
        noise_m2: FloatArray,
        *,
        has_plane: bool,
        nugget_m: float | None,
    ) -> "_Posterior":
        """Take places (n, 2) [m], values (n,) and noise variances (n,)."""
        upper = np.triu_indices(len(xy), k=1)
        x, y = (xy[upper[0]] - xy[upper[1]]).T
        extent = max(float(np.ptp(xy, axis=0).max()), 1e-3)
        slopes = (xy - xy.mean(axis=0)) / extent
        trend = np.column_stack([np.ones(len(xy)), slopes]) if has_plane else np.ones((len(xy), 1))
        lags = _Lags(x**2 + y**2, x**2 - y**2, 2.0 * x * y)
        centred = values - trend @ np.linalg.lstsq(trend, values, rcond=None)[0]
        return cls(centred, noise_m2, trend, lags, extent, nugget_m)

    def fit(self, member: Member, about: "_Fitted | None" = None) -> "_Fitted":
        """Climb to the greatest posterior from the better of two lengths, or from a kernel of the site that has others about it."""
        mean, spread = self._prior(member)
        if about is not None:
            mean, spread = about.theta, np.minimum(spread, _LOCAL_SD)
            spread[-3:-1] = _LOCAL_ANISOTROPY_SD
        is_free = np.ones(len(mean), dtype=bool)
        is_free[-3:-1] = member.is_anisotropic
        is_free[-1] = self.nugget_m is None

        def negative(free: FloatArray) -> tuple[float, FloatArray]:
            theta = mean.copy()
            theta[is_free] = free
            value, gradient = self._negative(theta, member)
            off = (theta - mean) / spread
            return value + 0.5 * float(off @ off), (gradient + off / spread)[is_free]

        starts = [mean.copy() for _ in _FIRST_LENGTHS[: 1 if about else None]]
        for start, factor in zip(starts, _FIRST_LENGTHS, strict=False):
            start[1] += np.log(factor)
        first = min((start[is_free] for start in starts), key=lambda start: negative(start)[0])
        limits = [(low, high) for low, high in zip(mean - 5.0 * spread, mean + 5.0 * spread, strict=True)]
        result = minimize(
            negative,
            first,
            jac=True,
            method="L-BFGS-B",
            bounds=[limit for limit, free in zip(limits, is_free, strict=True) if free],
            options={"maxiter": 40 if about is None else 15, "ftol": 1e-6},
        )
        theta = mean.copy()
        theta[is_free] = result.x
        nugget_m = float(np.exp(0.5 * theta[-1])) if self.nugget_m is None else self.nugget_m
        return _Fitted(theta, _kernel(theta, member), nugget_m, -float(result.fun))

    def _prior(self, member: Member) -> tuple[FloatArray, FloatArray]:
        """Return the prior means and standard deviations of the parameters."""
        noise_m2 = float(np.median(self.noise_m2))
        variance_m2 = max(float(np.var(self.values)), noise_m2)
        mean, spread = [], []
        for variance, length, _ in zip(_VARIANCES, _LENGTHS, member.parts, strict=False):
            mean += [np.log(variance * variance_m2), np.log(length * self.extent_m)]
            spread += [_VARIANCE_SD, _LENGTH_SD]
        mean += [0.0, 0.0, np.log(_NUGGET_OVER_NOISE * noise_m2)]
        return np.array(mean), np.array([*spread, _ANISOTROPY_SD, _ANISOTROPY_SD, _NUGGET_SD])

    def _negative(self, theta: FloatArray, member: Member) -> tuple[float, FloatArray]:
        """Return the negative log likelihood and its gradient, ½ tr((Π - Π z zᵀ Π) dV)."""
        squared, by_p, by_q = self.lags.scaled(*theta[-3:-1])
        nugget_m2 = float(np.exp(theta[-1])) if self.nugget_m is None else self.nugget_m**2
        covariance, by_squared, derivatives = np.zeros_like(squared), np.zeros_like(squared), []
        for kind, log_variance, log_length in zip(member.parts, theta[:-3:2], theta[1:-3:2], strict=True):
            variance, length = float(np.exp(log_variance)), float(np.exp(log_length))
            correlation, slope = _correlation_and_slope(kind, squared / length**2)
            covariance += variance * correlation
            # The slope is that by the logarithm of the squared distance.
            by_squared += variance * slope
            derivatives += [(variance * correlation, variance), (-2.0 * variance * slope, 0.0)]
        by_squared /= np.maximum(squared, 1e-12)
        derivatives += [(by_squared * by_p, 0.0), (by_squared * by_q, 0.0)]
        diagonal = sum(np.exp(theta[:-3:2])) + self.noise_m2 + nugget_m2
        solved = _solved(covariance, diagonal, self.values, self.trend)
        if solved is None:
            return 1e25, np.zeros_like(theta)
        negative, slope_by_pairs, trace = solved
        gradient = [slope_by_pairs @ pairs + trace * variance for pairs, variance in derivatives]
        return negative, np.array([*gradient, trace * nugget_m2])


def _correlation_and_slope(kind: type[Stationary], s2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the correlation at squared scaled distances, and its derivative by their logarithm."""
    correlation = kind(1.0, 1.0)._correlation(s2)
    if kind is Exponential:
        return correlation, -0.5 * np.sqrt(s2) * correlation
    if kind is Whittle:
        s = np.maximum(np.sqrt(2.0 * s2), 1e-8)
        return correlation, -0.5 * s**2 * k0(s)
    s = np.sqrt((3.0 if kind is Matern32 else 5.0) * s2)
    growth = 1.0 if kind is Matern32 else (1.0 + s) / 3.0
    return correlation, -0.5 * s**2 * growth * np.exp(-s)


def _solved(
    covariance: FloatArray, diagonal: FloatArray, values: FloatArray, trend: FloatArray
) -> tuple[float, FloatArray, float] | None:
    """Return the negative log likelihood, its slope by the covariance of each pair, and half the trace of that slope.

    None where the covariance is not positive definite in double precision.
    """
    matrix = squareform(covariance, checks=False)
    np.fill_diagonal(matrix, diagonal)
    found = inverse_and_log_determinant(matrix)
    if found is None:
        return None
    inverse, log_determinant = found
    of_trend = inverse @ trend
    information = trend.T @ of_trend
    slope = inverse - of_trend @ np.linalg.solve(information, of_trend.T)
    weights = slope @ values
    n_free = len(values) - trend.shape[1]
    log_determinant += float(np.linalg.slogdet(information)[1])
    negative = 0.5 * float(values @ weights + log_determinant + n_free * np.log(2.0 * np.pi))
    slope -= np.outer(weights, weights)
    return negative, squareform(slope, checks=False), 0.5 * float(np.trace(slope))


def _kernel(theta: FloatArray, member: Member) -> Kernel:
    """Return the kernel of parameters: exp(A) stretches lengths by exp(r) along half the direction of (p, q)."""
    p, q = theta[-3:-1]
    r = float(np.hypot(p, q)) if member.is_anisotropic else 0.0
    anisotropy, angle_deg = float(np.exp(2.0 * r)), float(np.degrees(0.5 * np.arctan2(q, p)))
    parts = [
        kind(float(np.exp(log_variance)), float(np.exp(log_length + r)), anisotropy, angle_deg if r else 0.0)
        for kind, log_variance, log_length in zip(member.parts, theta[:-3:2], theta[1:-3:2], strict=True)
    ]
    return parts[0] if len(parts) == 1 else Sum(*parts)

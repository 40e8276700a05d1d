"""Hyperparameters and kernel selection by marginal likelihood, on at most 640 of the points.

`Term` holds the covariance of all pairs of points and its derivatives by the parameters. `KernelFit` maximizes the marginal
likelihood of one family by them. Where the points do not determine the variance, `with_undetermined_variance` replaces it
by its posterior mean: the likelihood of points that show only their own noise is greatest for a variance of 0, and a map
with that kernel would claim no error. `likeliest` and `comparison` fit several families.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from scipy.spatial.distance import squareform

from survey.core import FloatArray, InputError, IntArray, stream
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.families import KernelFamily, Sum, family_of, kernel_of, parts_of
from survey.reconstruction.gp.kernels import Kernel, Stationary

# Relative step of the derivative of the covariance with respect to a parameter: error 1e-9.
_STEP = 1e-4
# Numbers of parameters of a part of one scaled distance: isotropic and turned.
_N_PLAIN = (2, 4)


@dataclass(frozen=True)
class Term:
    """Covariance of every pair by one part of a sum, and its derivatives by each parameter.

    A derivative is that of the covariances of pairs and that of the variance.
    """

    covariance: FloatArray
    derivatives: list[tuple[FloatArray, float]]


def term_of(part: Kernel, lags_m: FloatArray) -> Term:
    """Return the term of one part of a sum at lags (N, 2) [m]."""
    if isinstance(part, Stationary) and len(part.log_parameters) in _N_PLAIN:
        return _stationary_term(part, lags_m)
    covariance = part.covariance_of_lag(lags_m)
    derivatives = [(covariance, part.variance_m2)]
    for step in _STEP * np.eye(len(part.log_parameters))[1:]:
        above = part.with_log_parameters(part.log_parameters + step)
        below = part.with_log_parameters(part.log_parameters - step)
        change = above.covariance_of_lag(lags_m) - below.covariance_of_lag(lags_m)
        derivatives.append((change / (2 * _STEP), 0.0))
    return Term(covariance, derivatives)


def _stationary_term(part: Stationary, lags_m: FloatArray) -> Term:
    """Return the term of a part of one scaled distance; anisotropy and angle follow from the length by the chain rule."""
    squared = part.squared_along(lags_m)
    covariance = part.covariance_of_squared(squared)
    up, down = (_longer(part, step).covariance_of_squared(squared) for step in (_STEP, -_STEP))
    by_length = (up - down) / (2 * _STEP)
    derivatives = [(covariance, part.variance_m2), (by_length, 0.0)]
    if part.anisotropy != 1.0:
        derivatives += [(one, 0.0) for one in _turned_derivatives(part, lags_m, by_length)]
    return Term(covariance, derivatives)


def _longer(part: Stationary, step: float) -> Stationary:
    """Return a part whose length scale is longer by a step of its logarithm."""
    if part.anisotropy == 1.0:
        return part.with_log_parameters(part.log_parameters + [0.0, step])
    return replace(part, length_scale_m=part.length_scale_m * float(np.exp(step)))


def _turned_derivatives(part: Stationary, lags_m: FloatArray, by_length: FloatArray) -> Iterator[FloatArray]:
    """Yield how the covariance at lags moves with log anisotropy and angle."""
    along, across = part._along_and_across(lags_m)
    wide = np.square(part.anisotropy * across)
    scaled = by_length / np.maximum(np.square(along) + wide, 1e-12)
    yield -scaled * wide
    yield scaled * along * across * (part.anisotropy**2 - 1.0)


N_SEARCHED = 640
"""Most points that a covariance is fitted to."""
LONGEST_SHARE = 1.5
"""Longest landforms over the extent of the points: longer ones are planes, and would take waves that the others need."""
_N_CLUSTERS = 16
# Stretch and directions [deg] of the starts of an anisotropic kernel, and the strongest stretch: the likelihood has several
# maxima over the direction.
_STRETCH, _MOST_STRETCHED = 3.0, 40.0
_ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)


class Patch(NamedTuple):
    """Part of a site where a kernel holds: number of its centre among centres, and widths on either axis [m]."""

    number: int
    centres_m: tuple[tuple[float, float], ...]
    width_m: tuple[float, float]

    def share(self, xy: FloatArray) -> FloatArray:
        """Return the share (M,) of the patch among all at places (M, 2), by normal weights about the centres."""
        scaled = (xy[:, None] - np.array(self.centres_m)) / np.array(self.width_m)
        squared = np.square(scaled).sum(axis=2)
        weights = np.exp(-0.5 * (squared - squared.min(axis=1, keepdims=True)))
        shares: FloatArray = weights[:, self.number] / weights.sum(axis=1)
        return shares


class KernelInAverage(NamedTuple):
    """A kernel, the relief too fine to be mapped [m], the log posterior at its maximum, its weight, and where it holds."""

    kernel: Kernel
    nugget_m: float
    log_posterior: float
    weight: float = 1.0
    patch: Patch | None = None


@dataclass(frozen=True)
class Hyperparameters:
    """A covariance function, the relief too fine to be mapped [m], and the log likelihood that chose them.

    `average`: kernels of an average, the heaviest first; empty for one kernel.
    """

    family: KernelFamily
    kernel: Kernel
    nugget_m: float
    log_likelihood: float
    n_points: float = 1
    average: tuple[KernelInAverage, ...] = ()

    @property
    def kernels(self) -> list[KernelInAverage]:
        """Kernels with their weights, the heaviest first."""
        return list(self.average) or [KernelInAverage(self.kernel, self.nugget_m, self.log_likelihood)]

    @property
    def score(self) -> float:
        """Log likelihood less ``½ P log N`` for P parameters (Schwarz 1978)."""
        n_parameters = len(self.kernel.parameter_names) + 1
        return self.log_likelihood - 0.5 * n_parameters * float(np.log(self.n_points))


def stated_family(config: GaussianProcessConfig) -> str:
    """Return the family that settings state: that of their kernel, or the squared exponential for ``auto``."""
    if config.kernel is not None:
        return family_of(config.kernel)
    return "squared-exponential" if config.family == "auto" else config.family


SharedCovariance = Callable[[IntArray], FloatArray]
"""From the indices of some points (M,) to the covariance (M, M) of the errors that they share [m²]."""


@dataclass(frozen=True)
class KernelFit:
    """Likelihood of a kernel and a nugget, with its gradient; an unknown constant is integrated out."""

    values: FloatArray
    noise_m2: FloatArray
    lags_m: FloatArray
    extent_m: float
    nugget_m: float | None
    shared: tuple[FloatArray, FloatArray] | None = None
    landform_share: float = 0.0

    @classmethod
    def of_few(
        cls,
        xy: FloatArray,
        values: FloatArray,
        noise_m2: FloatArray,
        nugget_m: float | None,
        shared: SharedCovariance | None,
        *,
        n_most: int = N_SEARCHED,
        landform_share: float = 0.0,
    ) -> "KernelFit":
        """Take some of the points; the longest scale has a least share of their extent."""
        part = well_spread(xy, n_most)
        together = None if shared is None else shared(part)
        few = cls.of(xy[part], values[part], noise_m2[part], nugget_m, together)
        return replace(few, landform_share=landform_share)

    @classmethod
    def of(
        cls,
        xy: FloatArray,
        values: FloatArray,
        noise_m2: FloatArray,
        nugget_m: float | None,
        shared: FloatArray | None = None,
    ) -> "KernelFit":
        """Take all points, with the covariance of the errors that they share."""
        pairs = np.triu_indices(len(xy), k=1)
        lags = np.asfortranarray(xy[pairs[0]] - xy[pairs[1]])
        extent = max(float(np.ptp(xy, axis=0).max()), 1e-3)
        together = None if shared is None else (shared[pairs], np.diag(shared))
        return cls(values - values.mean(), noise_m2, lags, extent, nugget_m, together)

    def fit(self, family: KernelFamily, config: GaussianProcessConfig) -> Hyperparameters:
        """Climb to the greatest likelihood of one family, from one start a long and one a short way off."""
        shares = (0.15, 0.04) if config.kernel is None else (0.15,)
        found = [self._climb(family, config, share) for share in shares]
        return max(found, key=lambda one: one.log_likelihood)

    def turned(self, found: Hyperparameters) -> Hyperparameters:
        """Climb from a kernel stretched by 3 along the likeliest of four directions."""
        nugget_m2 = self._nugget_m2(found)
        starts = [_stretched(found.kernel, angle_deg) for angle_deg in _ANGLES_DEG]
        theta = [np.append(start.log_parameters, np.log(nugget_m2)) for start in starts]
        misfits = [self._negative(at, start)[0] for at, start in zip(theta, starts, strict=True)]
        return self._climbed(found.family, starts[int(np.argmin(misfits))], nugget_m2)

    def refined(self, found: Hyperparameters) -> Hyperparameters:
        """Climb on from hyperparameters that were fitted to fewer points."""
        return self._climbed(found.family, found.kernel, self._nugget_m2(found))

    def _nugget_m2(self, found: Hyperparameters) -> float:
        return max(found.nugget_m**2, 1e-6 * self._noise_and_spread[0])

    def counted(self, found: Hyperparameters) -> Hyperparameters:
        """Return a fit with the effective number of its points, (tr K)² / tr K² of their covariance."""
        upper = found.kernel.covariance_of_lag(self.lags_m)
        diagonal = found.kernel.variance_m2 + self.noise_m2 + found.nugget_m**2
        squares = float(diagonal @ diagonal + 2.0 * upper @ upper)
        return replace(found, n_points=float(diagonal.sum() ** 2 / squares))

    @property
    def spread_m2(self) -> float:
        """Variance of the values, at least that of their noise [m²]."""
        return self._noise_and_spread[1]

    def log_likelihood(self, kernel: Kernel, nugget_m: float) -> float:
        """Return the log likelihood of a kernel and a nugget [m]."""
        nugget_m2 = max(nugget_m**2, 1e-6 * self._noise_and_spread[0])
        return -self._negative(np.append(kernel.log_parameters, np.log(nugget_m2)), kernel)[0]

    @property
    def _noise_and_spread(self) -> tuple[float, float]:
        noise = float(np.median(self.noise_m2))
        return noise, max(float(np.var(self.values)), noise)

    def _climb(self, family: KernelFamily, config: GaussianProcessConfig, share: float) -> Hyperparameters:
        noise, spread = self._noise_and_spread
        start = config.kernel or self._start(family, config, share, noise, spread)
        return self._climbed(family, start, 0.25 * noise)

    def _climbed(self, family: KernelFamily, start: Kernel, nugget_m2: float) -> Hyperparameters:
        """Climb from a kernel and the variance of a nugget [m²]."""
        noise, spread = self._noise_and_spread
        theta = np.append(start.log_parameters, np.log(nugget_m2))
        limits = [*(self._limits(n, v) for n, v in zip(start.parameter_names, theta, strict=False))]
        limits.append((np.log(1e-6 * noise), np.log(max(spread, noise))))
        low, high = np.array(limits).T
        result = minimize(
            self._negative,
            np.clip(theta, low, high),
            args=(start,),
            jac=True,
            method="L-BFGS-B",
            bounds=limits,
            options={"maxiter": 60, "ftol": 1e-8},
        )
        nugget = self.nugget_m if self.nugget_m is not None else float(np.exp(0.5 * result.x[-1]))
        return Hyperparameters(
            family, start.with_log_parameters(result.x[:-1]), nugget, -float(result.fun), len(self.values)
        )

    def _start(
        self, family: KernelFamily, config: GaussianProcessConfig, share: float, noise: float, spread: float
    ) -> Kernel:
        """Return the kernel from which to climb, its length a share of the extent unless stated."""
        return kernel_of(
            family,
            config.variance_m2 or spread,
            config.length_scale_m or share * self.extent_m,
            anisotropy=config.anisotropy,
            angle_deg=config.angle_deg,
            shape=config.shape,
            second=(
                config.second_variance_m2 or max(0.01 * spread, noise),
                config.second_length_scale_m or 0.15 * share * self.extent_m,
            ),
        )

    def _limits(self, name: str, value: float) -> tuple[float, float]:
        if "length_scale_m" in name:
            if self.landform_share > 0.0 and name[-1] not in "23":
                low, high = self.landform_share * self.extent_m, LONGEST_SHARE * self.extent_m
                return float(np.log(low)), float(np.log(high))
            # A further part that is longer than half the site is a plane, and would take waves that the others need.
            longest = 0.5 if name[-1] in "23" else 3.0
            return float(np.log(2e-3 * self.extent_m)), float(np.log(longest * self.extent_m))
        if "angle" in name:
            return value - np.pi, value + np.pi
        if "anisotropy" in name:
            # With landforms the length has limits, so it is the longer one of the two directions.
            widest = 1.0 if self.landform_share > 0.0 else _MOST_STRETCHED
            return -float(np.log(widest)), float(np.log(_MOST_STRETCHED))
        return value - np.log(1e4), value + np.log(1e4)

    def _negative(self, theta: FloatArray, kernel: Kernel) -> tuple[float, FloatArray]:
        """Return the negative log likelihood (Eq. 9) and its gradient, ½ tr((K⁻¹ − αα') dK)."""
        candidate = kernel.with_log_parameters(theta[:-1])
        nugget_m2 = self.nugget_m**2 if self.nugget_m is not None else float(np.exp(theta[-1]))
        n = len(self.values)
        terms = [term_of(part, self.lags_m) for part in parts_of(candidate)]
        diagonal = candidate.variance_m2 + self.noise_m2 + nugget_m2
        solved = inverse_and_log_determinant(
            self.covariance_matrix(np.sum([term.covariance for term in terms], axis=0), diagonal)
        )
        if solved is None:
            # Not positive definite in double precision: worse than anything that is.
            return 1e25, np.zeros_like(theta)
        inverse, log_determinant = solved
        ones = inverse.sum(axis=1)
        weights = inverse @ self.values
        weights = weights - ones * (weights.sum() / ones.sum())
        negative = 0.5 * (
            self.values @ weights + log_determinant + np.log(ones.sum()) + n * np.log(2 * np.pi)
        )
        slope = inverse
        slope -= np.outer(weights, weights)
        slope -= np.outer(ones, ones) / ones.sum()
        of_pairs, half_trace = squareform(slope, checks=False), 0.5 * np.trace(slope)
        gradient = [
            (of_pairs @ d_pairs) + half_trace * d_variance
            for term in terms
            for d_pairs, d_variance in term.derivatives
        ]
        of_nugget = 0.0 if self.nugget_m is not None else half_trace * nugget_m2
        by_theta = np.empty_like(theta)
        # L-BFGS-B does not check the length of a gradient and writes beyond a short one; this assignment does.
        by_theta[:] = [*gradient, of_nugget]
        return float(negative), by_theta

    def covariance_matrix(self, covariance: FloatArray, diagonal: FloatArray) -> FloatArray:
        """Return the covariance (n, n) of the values, from that of all pairs and the diagonal."""
        if self.shared is not None:
            covariance, diagonal = covariance + self.shared[0], diagonal + self.shared[1]
        matrix: FloatArray = squareform(covariance, checks=False)
        np.fill_diagonal(matrix, diagonal)
        return matrix


def inverse_and_log_determinant(matrix: FloatArray) -> tuple[FloatArray, float] | None:
    """Return the inverse of a symmetric matrix and its log determinant, None where it is not positive definite."""
    factor, failed = lapack.dpotrf(matrix.T, lower=1, overwrite_a=1)
    if failed:
        return None
    log_determinant = 2.0 * np.log(np.diag(factor)).sum()
    lower, _ = lapack.dpotri(factor, lower=1, overwrite_c=1)
    inverse: FloatArray = squareform(squareform(lower.T, checks=False), checks=False)
    np.fill_diagonal(inverse, np.diag(lower))
    return inverse, log_determinant


def _stretched(kernel: Kernel, angle_deg: float) -> Kernel:
    """Return a sum of isotropic parts stretched by 3 along a direction, their areas of correlation unchanged."""
    parts = [
        replace(
            part,
            length_scale_m=part.length_scale_m * float(np.sqrt(_STRETCH)),
            anisotropy=_STRETCH,
            angle_deg=angle_deg,
        )
        for part in parts_of(kernel)
        if isinstance(part, Stationary)
    ]
    return Sum(*parts)


def well_spread(xy: FloatArray, n_most: int) -> IntArray:
    """Return the indices of some points: half spread at random, half in clusters of neighbours; always the same."""
    if len(xy) < 3:
        raise InputError(f"{len(xy)} points are too few for a covariance; give more, or set fit = false.")
    if len(xy) <= n_most:
        return np.arange(len(xy))
    order = stream(0, "hyperparameters").permutation(len(xy))
    spread, centres = order[: n_most // 2], order[-_N_CLUSTERS:]
    each = n_most // 2 // _N_CLUSTERS
    near = cKDTree(xy).query(xy[centres], k=each)[1].ravel()
    chosen: IntArray = np.unique(np.concatenate([spread, near]))
    return chosen


# Kernels that are likelier than none by less than this are not determined [nats].
_DETERMINED_NATS = 2.0
# Amplitudes over the spread of the values, length scales over the extent of the points, and the share of none.
_AMPLITUDES, _LENGTHS = np.geomspace(1e-3, 1.0, 13), np.geomspace(0.02, 1.0, 6)
_NONE = 1e-6


def with_undetermined_variance(search: KernelFit, found: Hyperparameters) -> Hyperparameters:
    """Return a fit with the posterior mean of its variance, where a variance of 0 is about as likely as the fitted one.

    Amplitudes up to the spread of the values and length scales of 2 % to 100 % of the extent have uniform priors, the
    length scales in their logarithm.
    """
    kernel = found.kernel
    if not isinstance(kernel, Stationary) or kernel.anisotropy != 1.0:
        return found
    spread = search.spread_m2
    none = search.log_likelihood(replace(kernel, variance_m2=_NONE * spread), found.nugget_m)
    if found.log_likelihood - none > _DETERMINED_NATS:
        return found
    variance, length = (
        axis.ravel() for axis in np.meshgrid(spread * _AMPLITUDES**2, search.extent_m * _LENGTHS)
    )
    kernels = [
        replace(kernel, variance_m2=float(one), length_scale_m=float(other))
        for one, other in zip(variance, length, strict=True)
    ]
    logs = np.array([search.log_likelihood(one, found.nugget_m) for one in kernels])
    return replace(found, kernel=_averaged(kernel, variance, length, logs))


def _averaged(kernel: Stationary, variance: FloatArray, length: FloatArray, logs: FloatArray) -> Stationary:
    """Return the kernel with the mean variance, and the mean length scale that goes with it."""
    weights = np.sqrt(variance) * np.exp(logs - logs.max())
    weights /= weights.sum()
    mean = float(weights @ variance)
    log_length = float((weights * variance) @ np.log(length)) / mean
    return replace(kernel, variance_m2=mean, length_scale_m=float(np.exp(log_length)))


CANDIDATES: tuple[KernelFamily, ...] = ("squared-exponential", "matern-3/2", "two-scale", "two-scale-matern")
"""What ``family = "auto"`` chooses from."""
SMOOTH_TO_ROUGH: tuple[KernelFamily, ...] = ("squared-exponential", "matern-5/2", "matern-3/2")
"""Candidates for cells of a prior, which show one scale: the error on rough ground falls slowly with the number of swaths."""

# Least longest scale over the extent of the points, where a landform scale is wanted.
_LANDFORM_SHARE = 0.08
# Families that are tried anisotropic too.
_TURNED: tuple[KernelFamily, ...] = ("two-scale-matern", "two-scale-mixed")
# Least width of the points over their length, by standard deviations, where kernels are tried anisotropic.
_LEAST_WIDTH = 0.5
# Points of the first comparison, and the number of kernels that are fitted to more of them.
_N_FIRST, _N_REFINED = 320, 3


def likeliest(
    xy: FloatArray,
    values: FloatArray,
    noise_m2: FloatArray,
    config: GaussianProcessConfig,
    shared: SharedCovariance | None = None,
    *,
    candidates: tuple[KernelFamily, ...] = CANDIDATES,
) -> Hyperparameters:
    """Fit the families that `config` allows to at most 640 of the points, and return the likeliest.

    Where the points do not determine its variance, the posterior mean of it is returned.

    Half of them come in clusters of neighbours, which determine the short scales and the
    nugget; the others are spread over all, which determines the long scale.

    `xy`, `values`, `noise_m2` (N, 2), (N,) and (N,): places [m], values about their mean and noise variances.
    """
    search = KernelFit.of_few(xy, values, noise_m2, config.nugget_m, shared)
    fitted = [search.fit(family, config) for family in _families(config, candidates)]
    return with_undetermined_variance(search, max(fitted, key=_score))


def with_landforms(
    xy: FloatArray,
    values: FloatArray,
    noise_m2: FloatArray,
    config: GaussianProcessConfig,
    shared: SharedCovariance | None = None,
    *,
    candidates: tuple[KernelFamily, ...],
) -> list[Hyperparameters]:
    """Fit kernels that have a landform scale, isotropic and anisotropic ones, and return them, the likeliest first.

    The longest scale of each is at least a share of the site, so that what lies between the points does not revert to
    the mean within a few metres. Kernels are compared on 320 points, and the best three fitted to 640. The score counts
    correlated points by their effective number. Points along one line, such as a single swath, do not determine a length
    across it: kernels that are fitted to them are isotropic.
    """
    few = comparison(xy, values, noise_m2, config, shared)
    more = comparison(xy, values, noise_m2, config, shared, n_most=N_SEARCHED)
    fitted = [few.fit(family, config) for family in _families(config, candidates)]
    if config.family == "auto" and config.kernel is None and are_wide(xy):
        fitted += [few.turned(found) for found in fitted if found.family in _TURNED]
    first = sorted((few.counted(found) for found in fitted), key=_score, reverse=True)[:_N_REFINED]
    if len(more.values) > len(few.values):
        first = [more.counted(more.refined(found)) for found in first]
    return sorted(first, key=_score, reverse=True)


def comparison(
    xy: FloatArray,
    values: FloatArray,
    noise_m2: FloatArray,
    config: GaussianProcessConfig,
    shared: SharedCovariance | None,
    *,
    n_most: int = _N_FIRST,
) -> KernelFit:
    """Return the likelihood of kernels with a landform scale, on 320 points by default."""
    return KernelFit.of_few(
        xy, values, noise_m2, config.nugget_m, shared, n_most=n_most, landform_share=_LANDFORM_SHARE
    )


def are_wide(xy: FloatArray) -> bool:
    """Return whether points are at least half as wide as they are long."""
    longest, widest = np.linalg.svd(xy - xy.mean(axis=0), compute_uv=False)
    return bool(widest >= _LEAST_WIDTH * longest)


def _score(found: Hyperparameters) -> float:
    return found.score


def _families(
    config: GaussianProcessConfig, candidates: tuple[KernelFamily, ...]
) -> tuple[KernelFamily, ...]:
    return candidates if config.family == "auto" and config.kernel is None else (stated_family(config),)

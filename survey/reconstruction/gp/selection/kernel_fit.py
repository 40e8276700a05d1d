"""Fit of a covariance function to a few hundred points by marginal likelihood."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import lapack
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from scipy.spatial.distance import squareform

from survey.core.arrays import FloatArray, IntArray
from survey.core.errors import InputError
from survey.core.streams import stream
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.covariance.families import KernelFamily, family_of, kernel_of
from survey.reconstruction.gp.covariance.kernel_sum import Sum
from survey.reconstruction.gp.covariance.kernels import Kernel
from survey.reconstruction.gp.covariance.stationary import Stationary
from survey.reconstruction.gp.selection.kernel_terms import parts_of, term_of

N_SEARCHED = 640
"""Most points that a covariance is fitted to."""
LONGEST_SHARE = 1.5
"""Longest landforms over the extent of the points: longer ones are planes, and would take waves that the others need."""
_N_CLUSTERS = 16
# Stretch and directions [deg] of the start of an anisotropic kernel, and the strongest stretch.
_STRETCH, _MOST_STRETCHED = 3.0, 40.0
_ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)


@dataclass(frozen=True)
class Hyperparameters:
    """A covariance function, the relief too fine to be mapped [m], and the log likelihood that chose them."""

    family: KernelFamily
    kernel: Kernel
    nugget_m: float
    log_likelihood: float
    n_points: float = 1

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
        part = _well_spread(xy, n_most)
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
        inverted = _inverted(
            self.covariance_matrix(np.sum([term.covariance for term in terms], axis=0), diagonal)
        )
        if inverted is None:
            # Not positive definite in double precision: worse than anything that is.
            return 1e25, np.zeros_like(theta)
        inverse, log_determinant = inverted
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


def _inverted(matrix: FloatArray) -> tuple[FloatArray, float] | None:
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


def _well_spread(xy: FloatArray, n_most: int) -> IntArray:
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

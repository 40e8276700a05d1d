r"""Choice of the terrain's kernel by the points and by the prior's cells together.

`PlaneResiduals` are the landmarks' heights about a plane, to which the candidates are fitted by marginal likelihood. Points near
one line show how steep landforms are, and hardly how long: length and variance may grow together, and a map with the
likeliest length alone claims too little error where no points lie. `lengths_of` gives the posterior of the longest length
scale, for the average of maps over it: with the other parts of the kernel fixed, values have the covariance
:math:`R + v\,C_\ell`, and one eigendecomposition of C about R for each length ℓ gives the likelihood of every variance v.

The likelihood of 640 points separates kernels where points lie. The evidence of the cells, given the points, separates them
in the gaps (`chosen`): a kernel that reverts to the mean too soon, or smooths across ridges, predicts the wrong cells.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.spatial.distance import squareform
from scipy.special import logsumexp, softmax

from survey.core import Bounds, FloatArray, IntArray
from survey.data import PathError, SurfacePoints
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.families import KernelFamily, Sum, parts_of
from survey.reconstruction.gp.kernels import Kernel, Stationary
from survey.reconstruction.gp.marginal_likelihood import (
    LONGEST_SHARE,
    Hyperparameters,
    KernelFit,
    comparison,
    stated_family,
    with_landforms,
)
from survey.reconstruction.gp.satellite_cells import SatelliteCells, StatedLevel, judge_cells
from survey.reconstruction.joint.normal_equations import TerrainPosterior
from survey.reconstruction.joint.shared_errors import LandmarkErrors, SharedError
from survey.reconstruction.observations import variance_through_slope
from survey.reconstruction.prior import PriorErrors
from survey.reconstruction.prior_likelihood import misfit_log_likelihood

CANDIDATES: tuple[KernelFamily, ...] = ("two-scale-matern", "two-scale-mixed", "three-scale")
"""What ``family = "auto"`` chooses from: landforms are smooth, the relief underfoot is not.

The third scale is for what lies between the two, which landmarks constrain so well that two scales go to these, and gaps
between swaths would be mapped with too small a standard deviation."""

# Standard deviation of the slopes of the plane in a fit of kernels [m/m]: no ground is steeper on the whole.
_LOOSE_SLOPE = 1.0


@dataclass(frozen=True)
class PlaneResiduals:
    """Heights of landmarks about the plane of least squares, with their own and their shared errors.

    `points`: landmarks. `path`: errors of the path that they were seen from. `landmarks`: further errors that
    they share. `config`: hyperparameters, or how they are found.
    """

    points: SurfacePoints
    path: PathError
    landmarks: LandmarkErrors
    config: GaussianProcessConfig

    @cached_property
    def slope(self) -> FloatArray:
        """Slope of the plane at each of the points (N, 2) [m/m]."""
        return np.tile(self._plane[1:], (len(self.points), 1))

    def candidates(self) -> list[Hyperparameters]:
        """Return the stated hyperparameters, or fits of several kernels, the likeliest first."""
        config = self.config
        if not config.fit:
            family = stated_family(config)
            return [Hyperparameters(family, config.stated_kernel(), config.nugget_m or 0.0, 0.0)]
        return with_landforms(*self._given, config, self._shared, candidates=CANDIDATES)

    def lengths(self, found: Hyperparameters) -> list[Hyperparameters]:
        """Return kernels of equally probable lengths of landforms."""
        return lengths_of(self._comparison, found)

    @property
    def _given(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        xy = self.points.xy
        return xy, self.points.z - _columns(xy) @ self._plane, own_variance(self.points, self.slope)

    @cached_property
    def _comparison(self) -> KernelFit:
        return comparison(*self._given, self.config, self._shared)

    @cached_property
    def _rows(self) -> Any:
        return SharedError.full(self.points, self.path, self.slope).rows

    def _shared(self, part: IntArray) -> FloatArray:
        common: FloatArray = self.path.covariance(self._rows[part]) + self.landmarks.covariance(part)
        return common + _of_unknown_slopes(self.points.xy[part])

    @cached_property
    def _plane(self) -> FloatArray:
        """Plane (3,) of least squares: height at the origin, slope to the east and to the north."""
        xy = self.points.xy
        middle = xy.mean(axis=0)
        level, *slope = np.linalg.lstsq(_columns(xy - middle), self.points.z, rcond=None)[0]
        return np.array([level - np.dot(slope, middle), *slope])


def own_variance(points: SurfacePoints, slope: FloatArray) -> FloatArray:
    """Return the variance (N,) of the points' own errors of height, on ground of some slope (N, 2) [m²]."""
    assert points.own_covariance is not None
    return variance_through_slope(points.own_covariance, slope)


def _of_unknown_slopes(xy: FloatArray) -> FloatArray:
    """Return the covariance (M, M) of the heights of a plane whose slopes are unknown [m²].

    The plane that is subtracted before a fit of kernels takes long relief with it; with its slopes unknown, that relief
    does not count as absent.
    """
    from_middle = _LOOSE_SLOPE * (xy - xy.mean(axis=0))
    covariance: FloatArray = from_middle @ from_middle.T
    return covariance


def _columns(xy: FloatArray) -> FloatArray:
    return np.column_stack([np.ones(len(xy)), xy])


# Lengths over the extent of the points, and variances over that of the fit.
_LENGTHS, _VARIANCES = np.geomspace(0.08, LONGEST_SHARE, 8), np.geomspace(1e-3, 1e3, 61)
# Length over the extent that a landform falls short of with a probability of 5 %.
_SHORTEST, _CHANCE = 0.08, 0.05
# Probabilities of lengths below those that are returned: the middles of three equal parts.
_QUANTILES = np.array([1.0, 3.0, 5.0]) / 6.0
# Lengths that differ by a smaller ratio count as one.
_DETERMINED = 1.25


def lengths_of(search: KernelFit, found: Hyperparameters) -> list[Hyperparameters]:
    r"""Return three kernels whose longest length scales are equally probable, each with the mean variance that goes with it.

    The length has the prior density :math:`\ell^{-2} e^{-\lambda / \ell}` of Fuglstad et al. (J. Am. Stat. Assoc. 114,
    2019), with 5 % below 8 % of the extent of the points; the logarithm of the variance is uniform.
    """
    longest, *others = parts_of(found.kernel)
    if not isinstance(longest, Stationary):
        return [found]
    lengths = search.extent_m * _LENGTHS
    logs = _log_likelihoods(search, longest, others, found.nugget_m, lengths)
    rate = -np.log(_CHANCE) * _SHORTEST * search.extent_m
    density = logsumexp(logs, axis=1) - rate / lengths - np.log(lengths)
    mean_variance = longest.variance_m2 * np.exp(
        logsumexp(logs, axis=1, b=_VARIANCES) - logsumexp(logs, axis=1)
    )
    log_length = _quantiles(np.log(lengths), density)
    if log_length[-1] - log_length[0] < np.log(_DETERMINED):
        return [found]
    log_variance = np.interp(log_length, np.log(lengths), np.log(mean_variance))
    return [
        _with_longest(found, longest, others, float(np.exp(length)), float(np.exp(variance)))
        for length, variance in zip(log_length, log_variance, strict=True)
    ]


def _with_longest(
    found: Hyperparameters, longest: Stationary, others: list[Kernel], length_m: float, variance_m2: float
) -> Hyperparameters:
    part = replace(longest, length_scale_m=length_m, variance_m2=variance_m2)
    return replace(found, kernel=Sum(part, *others) if others else part)


def _log_likelihoods(
    search: KernelFit, longest: Stationary, others: list[Kernel], nugget_m: float, lengths_m: FloatArray
) -> FloatArray:
    """Return the log likelihood (L, V) of lengths and of variances, an unknown constant integrated out."""
    pairs = np.sum([part.covariance_of_lag(search.lags_m) for part in others], axis=0) + np.zeros(
        len(search.lags_m)
    )
    diagonal = sum(part.variance_m2 for part in others) + search.noise_m2 + nugget_m**2
    half = cholesky(search.covariance_matrix(pairs, diagonal), lower=True)
    sides = solve_triangular(half, np.column_stack([search.values, np.ones(len(search.values))]), lower=True)
    return np.array([_of_variances(search, longest, float(length), half, sides) for length in lengths_m])


def _of_variances(
    search: KernelFit, longest: Stationary, length_m: float, half: FloatArray, sides: FloatArray
) -> FloatArray:
    """Return the log likelihood (V,) of the variances for one length, up to a constant."""
    shape = replace(longest, length_scale_m=length_m, variance_m2=1.0)
    correlation = squareform(shape.covariance_of_lag(search.lags_m), checks=False)
    np.fill_diagonal(correlation, 1.0)
    whitened = solve_triangular(half, solve_triangular(half, correlation, lower=True).T, lower=True)
    value, vector = np.linalg.eigh(0.5 * (whitened + whitened.T))
    y, ones = (vector.T @ sides).T
    total = 1.0 + longest.variance_m2 * _VARIANCES[:, None] * np.maximum(value, 0.0)
    weight, about = (ones**2 / total).sum(axis=1), (ones * y / total).sum(axis=1)
    misfit = (y**2 / total).sum(axis=1) - about**2 / weight
    likelihood: FloatArray = -0.5 * (misfit + np.log(total).sum(axis=1) + np.log(weight))
    return likelihood


def _quantiles(at: FloatArray, log_density: FloatArray) -> FloatArray:
    """Return the places at which a density, whose logarithm is interpolated, reaches the shares of `_QUANTILES`."""
    fine = np.linspace(at[0], at[-1], 400)
    density = np.exp(np.interp(fine, at, log_density - log_density.max()))
    share = np.cumsum(density) / density.sum()
    return np.interp(_QUANTILES, share, fine)


# Kernels that points make less likely than the best by more than this are not compared.
_WITHIN_NATS = 40.0
# Kernels that points make less likely than the best by more than this are no part of an average, nor are those of a
# probability below the share.
_PROBABLE_NATS, _LEAST_WEIGHT = 3.0, 0.02


@dataclass(frozen=True)
class PointsOnly:
    """Points with the kernels that were fitted to them; the maps from points alone are computed once.

    `points`: landmarks. `bounds` (xmin, ymin, xmax, ymax): extent of the map [m]. `slope` (N, 2): slope of
    the plane through the points at each of them. `candidates`: fits to the points, the best first. `terrain`:
    returns the terrain with a kernel, from the points alone. `lengths`: returns kernels of equally probable
    lengths of landforms for one of the fits.
    """

    points: SurfacePoints
    bounds: Bounds
    slope: FloatArray
    candidates: list[Hyperparameters]
    terrain: Callable[[Hyperparameters], TerrainPosterior]
    lengths: Callable[[Hyperparameters], list[Hyperparameters]]


def probable(
    alone: PointsOnly, found: Hyperparameters, cells: SatelliteCells | None
) -> tuple[list[Hyperparameters], FloatArray]:
    """Return the kernels that points and cells leave probable, and their probabilities (K,).

    Each of the likeliest fits stands for kernels of several lengths of landforms.
    """
    least = alone.candidates[0].score - _PROBABLE_NATS
    fits = [one for one in alone.candidates if one is found or one.score >= least]
    kernels = [one for fit in fits for one in alone.lengths(fit)]
    logs = np.array([one.score for one in kernels])
    if cells is not None:
        logs += [
            misfit_log_likelihood(cells.misfits(*alone.terrain(one).cell_means(cells))) for one in kernels
        ]
    weights = softmax(logs)
    kept = np.flatnonzero(weights >= _LEAST_WEIGHT)
    return [kernels[k] for k in kept], weights[kept] / weights[kept].sum()


class ChosenKernel(NamedTuple):
    """Hyperparameters, the cells with the sizes of their errors, and conflicts of prior and points."""

    hyperparameters: Hyperparameters
    cells: SatelliteCells
    conflicts: tuple[str, ...]
    stated: StatedLevel | None = None

    @property
    def score(self) -> float:
        """Score of the points and log evidence of the cells."""
        return self.hyperparameters.score + self.cells.sizes.log_evidence


def choose_kernel(alone: PointsOnly, cells: SatelliteCells, errors: PriorErrors) -> ChosenKernel:
    """Return the kernel of the best score of points and cells."""
    least = alone.candidates[0].score - _WITHIN_NATS
    compared = [one for one in alone.candidates if one.score >= least]
    return max((_judge(found, cells, errors, alone) for found in compared), key=lambda one: one.score)


def _judge(
    found: Hyperparameters, cells: SatelliteCells, errors: PriorErrors, alone: PointsOnly
) -> ChosenKernel:
    """Estimate the sizes of the cells' errors from a kernel's map."""
    judged = judge_cells(cells, errors, *alone.terrain(found).cell_means(cells))
    return ChosenKernel(found, judged.cells, judged.conflicts, judged.stated)

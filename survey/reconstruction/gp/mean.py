"""Mean functions of the terrain, and prior elevation models as such: their interpolation, noise and estimated errors.

`Mean` is the interface; a mean is a constant, a function or an elevation model. `prior_error_kernel` is the covariance of an
elevation model's noise between its cells. `estimated_prior` estimates offset, tilt and horizontal shift of the
elevation model by generalized least squares from the points, and subtracts them.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.spatial import Delaunay, QhullError

from survey.core import BoolArray, FloatArray, InputError
from survey.data import Dem, SurfacePoints
from survey.reconstruction.gp.families import Sum, parts_of
from survey.reconstruction.gp.kernels import Kernel, SquaredExponential
from survey.reconstruction.prior import PriorErrors
from survey.reconstruction.prior_likelihood import (
    ErrorSizes,
    Innovations,
    Level,
    conflicts,
    level,
    likeliest_sizes,
)

# Half the arm of the central difference that gives a mean's slope [m].
_ARM_M = 0.5


class Mean(ABC):
    """The expected surface."""

    @abstractmethod
    def at(self, xy: FloatArray) -> FloatArray:
        """Return the expected heights at the places (N, 2), as (N,) [m].

        Parameters
        ----------
        xy : (N, 2) ndarray
            Easting and northing [m].

        Returns
        -------
        (N,) ndarray
            Height [m].
        """

    def covers(self, xy: FloatArray) -> BoolArray:
        """Return at which places (N, 2) the mean is defined, as (N,); everywhere unless overridden.

        Parameters
        ----------
        xy : (N, 2) ndarray
            Easting and northing [m].

        Returns
        -------
        (N,) ndarray of bool
            True where the mean is defined.
        """
        return np.ones(len(xy), dtype=bool)

    def gradient(self, xy: FloatArray) -> FloatArray:
        """Return the slope (N, 2) to the east and to the north [m/m], by differences over a metre.

        Parameters
        ----------
        xy : (N, 2) ndarray
            Easting and northing [m].

        Returns
        -------
        (N, 2) ndarray
            Slopes to the east and to the north [m/m].
        """
        arms = _ARM_M * np.eye(2)
        return np.stack([(self.at(xy + arm) - self.at(xy - arm)) / (2 * _ARM_M) for arm in arms], axis=-1)


@dataclass(frozen=True)
class ConstantMean(Mean):
    """A horizontal plane at a known height [m].

    `value_m`: height of the plane [m].

    >>> ConstantMean(3.0).at(np.zeros((2, 2)))
    array([3., 3.])
    """

    value_m: float

    def at(self, xy: FloatArray) -> FloatArray:
        """Return the height for every place."""
        return np.full(len(xy), self.value_m)


@dataclass(frozen=True)
class FunctionMean(Mean):
    """Any function of places (N, 2) that returns heights (N,) [m].

    `function`: takes places (N, 2) [m] and returns heights (N,) [m].

    >>> FunctionMean(lambda xy: xy[:, 0]).at(np.array([[4.0, 0.0]]))
    array([4.])
    """

    function: Callable[[FloatArray], FloatArray]

    def at(self, xy: FloatArray) -> FloatArray:
        """Return the function's heights; refuse what is no height for every place."""
        heights = np.asarray(self.function(xy), dtype=np.float64)
        if heights.shape != (len(xy),) or not np.isfinite(heights).all():
            raise InputError(
                f"the mean function returned the shape {heights.shape} or values that are not finite for {len(xy)} "
                "places; it must give one finite height for each."
            )
        return heights


@dataclass(frozen=True)
class DemMean(Mean):
    """A coarse elevation model, read between its cell centres.

    `dem`: the prior. `interpolation`: between the four nearest centres, or in the triangles between centres
    as the glacier paper has it. Within the outer half cell both go on linearly.

    >>> from survey.data.grid import Grid
    >>> prior = Dem.on(Grid((0.0, 0.0, 2.0, 2.0), 1.0), np.arange(9.0).reshape(3, 3))
    >>> DemMean(prior).at(np.array([[0.5, 2.0]]))
    array([0.5])
    """

    dem: Dem
    interpolation: Literal["bilinear", "delaunay"] = "bilinear"

    def gradient(self, xy: FloatArray) -> FloatArray:
        """Return the slope (N, 2); within an arm of the prior's rim that of the nearest inner place.

        Beside a void it is that towards the side with heights, and 0 where neither side has them.
        """
        xmin, ymin, xmax, ymax = self.dem.bounds
        inner = np.clip(xy, [xmin + _ARM_M, ymin + _ARM_M], [xmax - _ARM_M, ymax - _ARM_M])
        inner = np.where(self.covers(inner)[:, None], inner, xy)
        return np.stack([self._slope(inner, arm) for arm in _ARM_M * np.eye(2)], axis=-1)

    def _slope(self, xy: FloatArray, arm: FloatArray) -> FloatArray:
        """Return the slope along an arm (N,) by the ends of it that have heights."""
        ahead, behind = self.covers(xy + arm), self.covers(xy - arm)
        rise = self.at(np.where(ahead[:, None], xy + arm, xy)) - self.at(
            np.where(behind[:, None], xy - arm, xy)
        )
        n_arms = ahead.astype(np.float64) + behind
        return rise / (_ARM_M * np.maximum(n_arms, 1.0))

    def covers(self, xy: FloatArray) -> BoolArray:
        """Return at which places (N, 2) the prior has a height, as (N,)."""
        return np.isfinite(self.dem.at(xy))

    def at(self, xy: FloatArray) -> FloatArray:
        """Return the prior's heights [m]."""
        heights = self.dem.at(xy)
        if self.interpolation == "delaunay":
            triangular = _triangles(self.dem)(xy)
            heights = np.where(np.isfinite(triangular), triangular, heights)
        missing = ~np.isfinite(heights)
        if missing.any():
            where = xy[missing][0]
            raise InputError(
                f"the prior does not cover {int(missing.sum())} of {len(xy)} places, the first at "
                f"({where[0]:.1f}, {where[1]:.1f}); take a prior that covers the grid and the points, or a smaller grid."
            )
        return heights


def _triangles(dem: Dem) -> Any:
    known = np.isfinite(dem.elevation).ravel()
    try:
        mesh = Delaunay(dem.xy[known])
    except QhullError as error:
        raise InputError("the prior's valid cells lie on one line; give a prior of an area.") from error
    from scipy.interpolate import LinearNDInterpolator

    return LinearNDInterpolator(mesh, dem.elevation.ravel()[known])


def prior_error_kernel(cell_m: float, sigma_m: float) -> Kernel:
    r"""Return the covariance of the noise of a coarse model read bilinearly between its cells.

    Independent noise of σ per cell, spread by the bilinear weights w, has on average over
    the cell the variance and the correlation of a cubic spline,

    .. math::  \overline{\sum_c w_c^2} = (2/3)^2, \qquad
               \rho(h) \approx \exp(-h^2 / 2 l^2), \quad l = c / \sqrt 3

    with the cell's width c; l is the standard deviation of the spline.

    `cell_m`: width of a cell [m]. `sigma_m`: standard deviation of a cell's noise [m].

    The relief within a cell, which its mean hides, is not in it: the kernel that is
    fitted to the points about the prior has it.

    >>> prior_error_kernel(75.0, 1.5).variance_m2
    1.0
    """
    return SquaredExponential((2.0 / 3.0 * sigma_m) ** 2, float(cell_m / np.sqrt(3.0)))


def with_prior_error(kernel: Kernel, cell_m: float, sigma_m: float) -> Sum:
    """Return the terrain's kernel with that of the prior's own error beside it."""
    return Sum(*parts_of(kernel), prior_error_kernel(cell_m, sigma_m))


# Fewer cells with points than these determine no errors of the prior.
_LEAST_CELLS = 6


class EstimatedPrior(NamedTuple):
    """A prior less its estimated errors, and the record of these.

    `dem`: the corrected prior. `facts`: estimated errors with their standard deviations, and conflicts of
    prior and points.
    """

    dem: Dem
    facts: dict[str, Any]


def estimated_prior(prior: Dem, points: SurfacePoints, errors: PriorErrors) -> EstimatedPrior:
    """Return the prior less the errors that the points show: offset, tilt, and horizontal shift through its slope.

    In each cell of the prior the mean difference between prior and points is one measurement of its error. Cells without
    points are corrected by what all cells have in common.

    Offset, tilt and shift are taken as constant over the points; a prior of many tiles has one for each.
    """
    mean = DemMean(prior)
    here = mean.covers(points.xy)
    xy, difference = points.xy[here], mean.at(points.xy[here]) - points.z[here]
    differing = _by_cell(prior, xy, difference)
    if len(differing.value_m) < _LEAST_CELLS:
        return EstimatedPrior(prior, {"prior_conflicts": []})
    middle = xy.mean(axis=0)
    rows = _rows(mean, differing.centre, middle)
    sizes, found, used_sigma = _sized(differing, rows, errors)
    value, std = _unknowns(differing, rows, used_sigma, sizes)
    total = (
        differing.covariance
        + (rows * used_sigma) @ (rows * used_sigma).T
        + sizes.covariance(differing.centre)
    )
    found_conflicts = conflicts(found, differing._replace(covariance=total), sizes.white_m, errors.white)
    every = prior.xy
    error_m = _rows(mean, every, middle) @ value
    dem = replace(prior, elevation=prior.elevation - error_m.reshape(prior.shape))
    facts: dict[str, Any] = {
        "satellite_sigma_m": sizes.white_m,
        "satellite_correlated_sigma_m": sizes.correlated_m,
        "prior_conflicts": list(found_conflicts),
    }
    for name, one, spread in zip(_NAMES, value, std, strict=True):
        facts |= {f"satellite_{name}": float(one), f"satellite_{name}_sigma": float(spread)}
    return EstimatedPrior(dem, facts)


_NAMES = ("offset_m", "tilt_east_m_per_km", "tilt_north_m_per_km", "shift_east_m", "shift_north_m")


def _by_cell(prior: Dem, xy: FloatArray, difference: FloatArray) -> Innovations:
    """Return the mean difference of the points in each cell, with the variance of that mean."""
    column = np.floor((xy[:, 0] - prior.bounds[0]) / prior.step_m).astype(np.int64)
    row = np.floor((prior.bounds[3] - xy[:, 1]) / prior.step_m).astype(np.int64)
    _, cell, count = np.unique(row * prior.shape[1] + column, return_inverse=True, return_counts=True)
    mean = np.bincount(cell, difference) / count
    square = np.bincount(cell, (difference - mean[cell]) ** 2)
    pooled = float(square.sum() / max(len(xy) - len(count), 1))
    centre = np.column_stack([np.bincount(cell, axis) / count for axis in xy.T])
    return Innovations(centre, mean, np.diag(pooled / count + 1e-6))


def _rows(mean: DemMean, xy: FloatArray, middle: FloatArray) -> FloatArray:
    """Return what offset, tilt and shift of 1 m, 1 m/km and 1 m add to the prior at places (N, 5) [m]."""
    slope = np.zeros((len(xy), 2))
    covered = mean.covers(xy)
    slope[covered] = mean.gradient(xy[covered])
    return np.column_stack([np.ones(len(xy)), (xy - middle) / 1000.0, -slope])


def _sized(
    differing: Innovations, rows: FloatArray, errors: PriorErrors
) -> tuple[ErrorSizes, Level, FloatArray]:
    """Return the sizes of the cells' errors, the level of the prior, and the standard deviations of the unknowns."""
    tilt, shift = errors.tilt_sigma_m_per_km, errors.shift_sigma_m
    others = np.array([tilt, tilt, shift, shift])
    scaled = rows[:, 1:] * others
    known = differing._replace(
        covariance=differing.covariance + scaled @ scaled.T, level_sigma_m=errors.level_sigma_m
    )
    sizes = likeliest_sizes(known, errors)
    own = known._replace(covariance=known.covariance + sizes.covariance(differing.centre))
    found = level(own, errors.level_sigma_m)
    level_m = errors.level_sigma_m * sizes.level_factor
    if found.is_conflict:
        level_m = 10.0 * abs(found.offset_m)
        sizes = likeliest_sizes(known._replace(level_sigma_m=level_m), errors._replace(level_log_sd=0.0))
    return sizes, found, np.r_[level_m, others]


def _unknowns(
    differing: Innovations, rows: FloatArray, sigma: FloatArray, sizes: ErrorSizes
) -> tuple[FloatArray, FloatArray]:
    """Return the estimates (5,) and their standard deviations, by generalized least squares with their priors."""
    noise = differing.covariance + sizes.covariance(differing.centre)
    scaled = rows * sigma
    weighted = np.linalg.solve(noise, np.column_stack([scaled, differing.value_m]))
    covariance = np.linalg.inv(np.eye(len(sigma)) + scaled.T @ weighted[:, :-1])
    return sigma * (covariance @ (scaled.T @ weighted[:, -1])), sigma * np.sqrt(np.diag(covariance))

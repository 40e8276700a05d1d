"""Errors of a prior that a map is built around: offset, tilt and shift estimated from the points."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from survey.core.arrays import FloatArray
from survey.data.dem import Dem
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.gp.mean import DemMean
from survey.reconstruction.prior.conflict import Level, conflicts, level
from survey.reconstruction.prior.error_sizes import ErrorSizes, Innovations, likeliest_sizes
from survey.reconstruction.prior.products import PriorErrors

# Fewer cells with points than these determine no errors of the prior.
_LEAST_CELLS = 6


class EstimatedPrior(NamedTuple):
    """A prior less its estimated errors, and the record of these.

    Parameters
    ----------
    dem : Dem
        The corrected prior.
    facts : dict
        Estimated errors with their standard deviations, and conflicts of prior and points.
    """

    dem: Dem
    facts: dict[str, Any]


def estimated_prior(prior: Dem, points: SurfacePoints, errors: PriorErrors) -> EstimatedPrior:
    """Return the prior less the errors that the points show: offset, tilt, and horizontal shift through its slope.

    In each cell of the prior the mean difference between prior and points is one measurement of its error. Cells without
    points are corrected by what all cells have in common.

    Parameters
    ----------
    prior : Dem
        Coarse elevations, in the points' CRS.
    points : SurfacePoints
        Measured points; those beyond the prior are left out.
    errors : PriorErrors
        Error model of the prior.

    Returns
    -------
    EstimatedPrior
        The corrected prior; the same one where fewer than six of its cells hold points.

    Notes
    -----
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
    said = conflicts(found, differing._replace(covariance=total), sizes.white_m, errors.white)
    every = prior.xy
    wrong = _rows(mean, every, middle) @ value
    dem = replace(prior, elevation=prior.elevation - wrong.reshape(prior.shape))
    facts: dict[str, Any] = {
        "satellite_sigma_m": sizes.white_m,
        "satellite_correlated_sigma_m": sizes.correlated_m,
        "prior_conflicts": list(said),
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

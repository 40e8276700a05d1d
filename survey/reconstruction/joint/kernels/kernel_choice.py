"""Choice of the terrain's kernel by points and by the prior's cells together.

The likelihood of 640 points separates kernels where points lie; the evidence of the cells, given the points, separates
them in the gaps: a kernel that reverts to the mean too soon, or smooths across ridges, predicts the wrong cells.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import softmax

from survey.core.arrays import Bounds, FloatArray
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.gp.selection.kernel_fit import Hyperparameters
from survey.reconstruction.joint.satellite_cells import SatelliteCells
from survey.reconstruction.joint.terrain_posterior import TerrainPosterior
from survey.reconstruction.prior.conflict import Level, conflicts, level, misfit_log_likelihood
from survey.reconstruction.prior.error_sizes import Innovations, likeliest_sizes
from survey.reconstruction.prior.products import PriorErrors

# Kernels that points make less likely than the best by more than this are not compared.
_WITHIN_NATS = 40.0
# Kernels that points make less likely than the best by more than this are no part of an average, nor are those of a
# probability below the share.
_PROBABLE_NATS, _LEAST_WEIGHT = 3.0, 0.02
# The level of a prior that contradicts the points has this standard deviation, in offsets. Its stated level is left out
# where it is less probable than the share.
_FREE_LEVEL, _LEAST_LEVEL = 10.0, 0.005


@dataclass(frozen=True)
class PointsOnly:
    """Points with the kernels that were fitted to them; the maps from points alone are computed once.

    Parameters
    ----------
    points : SurfacePoints
        Landmarks.
    bounds : (xmin, ymin, xmax, ymax)
        Extent of the map [m].
    slope : (N, 2) ndarray
        Slope of the plane through the points at each of them.
    candidates : list of Hyperparameters
        Fits to the points, the best first.
    terrain : callable
        Returns the terrain with a kernel, from the points alone.
    lengths : callable
        Returns kernels of equally probable lengths of landforms for one of the fits.
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

    Parameters
    ----------
    alone : PointsOnly
        Fits to the points.
    found : Hyperparameters
        The fit that the map is made with.
    cells : SatelliteCells, optional
        Cells of the prior, with the sizes of their errors.
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


class StatedLevel(NamedTuple):
    """Cells whose level contradicts the points, as their error model has it, and the probability that it holds."""

    cells: SatelliteCells
    probability: float


class ChosenKernel(NamedTuple):
    """Hyperparameters, the cells with the sizes of their errors, and conflicts of prior and points."""

    found: Hyperparameters
    cells: SatelliteCells
    conflicts: tuple[str, ...]
    stated: StatedLevel | None = None

    @property
    def score(self) -> float:
        """Score of the points and log evidence of the cells."""
        return self.found.score + self.cells.sizes.log_evidence


def chosen(alone: PointsOnly, cells: SatelliteCells, errors: PriorErrors) -> ChosenKernel:
    """Return the kernel of the best score of points and cells.

    Parameters
    ----------
    alone : PointsOnly
        Fits to the points.
    cells : SatelliteCells
        Cells of the prior, without the sizes of their errors.
    errors : PriorErrors
        Error model of the prior.
    """
    least = alone.candidates[0].score - _WITHIN_NATS
    compared = [one for one in alone.candidates if one.score >= least]
    return max((_judged(found, cells, errors, alone) for found in compared), key=lambda one: one.score)


def _judged(
    found: Hyperparameters, cells: SatelliteCells, errors: PriorErrors, alone: PointsOnly
) -> ChosenKernel:
    """Estimate the sizes of the cells' errors from a kernel's map, with a free level where prior and points disagree."""
    expected, covariance = alone.terrain(found).cell_means(cells)
    innovations = cells.innovations(expected, covariance)
    sized, stated = cells.with_sizes(likeliest_sizes(innovations, errors)), None
    height = _level(innovations, sized, errors)
    if height.is_conflict:
        free = cells.with_free_level(_FREE_LEVEL * abs(height.offset_m))
        innovations, exact = free.innovations(expected, covariance), errors._replace(level_log_sd=0.0)
        sized = free.with_sizes(likeliest_sizes(innovations, exact))
        probability = _level(innovations, sized, errors).probability
        if probability >= _LEAST_LEVEL:
            stated = StatedLevel(cells.with_sizes(sized.sizes), probability)
    total = innovations._replace(covariance=innovations.with_level + sized.covariance)
    used = 0.0 if stated is None else stated.probability
    found_conflicts = conflicts(height, total, sized.sizes.white_m, errors.white, used)
    return ChosenKernel(found, sized, found_conflicts, stated)


def _level(innovations: Innovations, cells: SatelliteCells, errors: PriorErrors) -> Level:
    """Return the offset of the cells from the points, with the errors that the cells have in their sizes."""
    own = innovations._replace(covariance=innovations.covariance + cells.covariance)
    return level(own, errors.level_sigma_m)

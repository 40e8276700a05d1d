"""Choice of the terrain's kernel by points and by the prior's cells together.

The likelihood of 640 points separates kernels where points lie; the evidence of the cells, given the points, separates
them in the gaps: a kernel that reverts to the mean too soon, or smooths across ridges, predicts the wrong cells.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from survey.core.arrays import Bounds, FloatArray
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.gp.selection.kernel_fit import Hyperparameters
from survey.reconstruction.joint.satellite_cells import SatelliteCells
from survey.reconstruction.joint.solution import JointSolution
from survey.reconstruction.prior.conflict import conflicts, level
from survey.reconstruction.prior.error_sizes import likeliest_sizes
from survey.reconstruction.prior.products import PriorErrors

# Kernels that points make less likely than the best by more than this are not compared.
_WITHIN_NATS = 40.0
# The level of a prior that contradicts the points has this standard deviation, in offsets.
_FREE_LEVEL = 10.0


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
    solve : callable
        Solves for terrain and path from points, bounds, hyperparameters and slope.
    """

    points: SurfacePoints
    bounds: Bounds
    slope: FloatArray
    candidates: list[Hyperparameters]
    solve: Callable[[SurfacePoints, Bounds, Hyperparameters, FloatArray], JointSolution]
    solutions: dict[int, JointSolution] = field(default_factory=dict)

    def solution(self, found: Hyperparameters) -> JointSolution:
        """Return the map of a candidate from the points alone."""
        place = self.candidates.index(found)
        if place not in self.solutions:
            self.solutions[place] = self.solve(self.points, self.bounds, found, self.slope)
        return self.solutions[place]


class ChosenKernel(NamedTuple):
    """Hyperparameters, the cells with the sizes of their errors, and conflicts of prior and points."""

    found: Hyperparameters
    cells: SatelliteCells
    conflicts: tuple[str, ...]

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
    expected, covariance = alone.solution(found).cell_means(cells)
    innovations = cells.innovations(expected, covariance)
    sized = cells.with_sizes(likeliest_sizes(innovations, errors))
    own = innovations._replace(covariance=innovations.covariance + sized.covariance)
    height = level(own, errors.level_sigma_m)
    if height.is_conflict:
        free = cells.with_free_level(_FREE_LEVEL * abs(height.offset_m))
        innovations, exact = free.innovations(expected, covariance), errors._replace(level_log_sd=0.0)
        sized = free.with_sizes(likeliest_sizes(innovations, exact))
    total = innovations._replace(covariance=innovations.with_level + sized.covariance)
    found_conflicts = conflicts(height, total, sized.sizes.white_m, errors.white)
    return ChosenKernel(found, sized, found_conflicts)

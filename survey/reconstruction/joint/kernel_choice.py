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
from survey.reconstruction.prior.conflict import Level, conflicts, level
from survey.reconstruction.prior.error_sizes import Innovations, likeliest_sizes
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
    height, sized = _level(cells, errors, expected, covariance)
    if height.is_conflict:
        sized = cells.with_free_level(_FREE_LEVEL * abs(height.offset_m))
        sized = sized.with_sizes(likeliest_sizes(sized.innovations(expected, covariance), errors))
    innovations = sized.innovations(expected, covariance)
    total = innovations._replace(covariance=innovations.covariance + sized.covariance)
    found_conflicts = conflicts(height, total, sized.sizes.white_m, errors.white.median_m)
    return ChosenKernel(found, sized, found_conflicts)


def _level(
    cells: SatelliteCells, errors: PriorErrors, expected: FloatArray, covariance: FloatArray
) -> tuple[Level, SatelliteCells]:
    """Return the offset of the cells from the points, and the cells with the sizes of their errors."""
    sized = cells.with_sizes(likeliest_sizes(cells.innovations(expected, covariance), errors))
    free = cells.with_free_level(1.0)
    level_less = SatelliteCells(
        free.centre, free.sides, free.height, tuple(one for one in free.common[1:]), sized.sizes
    ).innovations(expected, covariance)
    own = Innovations(level_less.centre, level_less.value_m, level_less.covariance + sized.covariance)
    return level(own, errors.level_sigma_m), sized

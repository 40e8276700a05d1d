"""Map of the joint estimate from equations that were eliminated segment by segment."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from live.solve.segment_elimination import SegmentElimination
from survey.core.arrays import FloatArray
from survey.data.grid import Grid
from survey.data.path_error import PathError
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.joint.normal_equations import JointPosterior, JointSystem


@dataclass(frozen=True)
class _DenseFactor:
    """Cholesky factor of a matrix, to solve with."""

    factor: tuple[FloatArray, bool]

    def solve(self, sides: FloatArray) -> FloatArray:
        """Return the solutions of one or several right-hand sides."""
        solved: FloatArray = cho_solve(self.factor, sides, check_finite=False)
        return solved


def segment_map(
    system: JointSystem, path: PathError, points: SurfacePoints, grid: Grid, nugget_m: float
) -> tuple[FloatArray, FloatArray]:
    """Return height and standard deviation (H, W) [m] on a grid, as one solve of the joint estimate gives them.

    Parameters
    ----------
    system : JointSystem
        Equations of the points, without a satellite's cells.
    path : PathError
        Errors of the path that the points were seen from.
    points : SurfacePoints
        That name their keyframes.
    grid : Grid
        Nodes of the map.
    nugget_m : float
        Standard deviation of relief too fine to be mapped [m].

    Returns
    -------
    tuple of ndarray
        Equal to those of `TerrainPosterior.fields` but for the error of interpolation within segments.

    Raises
    ------
    InputError
        Points that name no keyframe, or standard deviations too small to be solved with.
    """
    assert points.keyframe is not None
    elimination = SegmentElimination.of(system, path, points.keyframe)
    equations = elimination.equations()
    factor = _DenseFactor(cho_factor(equations.shared, lower=True, check_finite=False))
    posterior = JointPosterior.solved(system.basis, system.strengths, equations, factor)
    first = int(np.searchsorted(elimination.order.knots, system.shared.rows.shape[1]))
    finer_m2 = system.tail_m2 + nugget_m**2
    return posterior.terrain(system.trend, first, system.datum_m, finer_m2).fields(grid)

"""Map of a joint estimate with its test by swaths that were left out, and the posterior of its error."""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from survey.core.arrays import FloatArray
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.reconstruction.base import CHECK, CLAIM, Reconstruction
from survey.reconstruction.beyond_points import widened_beyond
from survey.reconstruction.checks.predictive import PredictiveCheck
from survey.reconstruction.checks.rmse_claim import RmseClaim, sampled_nodes
from survey.reconstruction.joint.left_out import check_by_swaths
from survey.reconstruction.joint.solution import JointMap, JointSolution


def checked_map(solution: JointSolution, grid: Grid, area: SurveyArea | None, *, is_tested: bool) -> JointMap:
    """Return the map on a grid, its standard deviation widened where swaths that were left out contradict it.

    Parameters
    ----------
    solution : JointSolution
        Estimate of map and path.
    grid : Grid
        Nodes of the map.
    area : SurveyArea, optional
        Ground of which the error is claimed; the grid by default.
    is_tested : bool
        Whether to leave swaths out.
    """
    mapped = solution.on(grid)
    check = check_by_swaths(solution) if is_tested else None
    result = mapped.reconstruction if check is None else _widened(mapped.reconstruction, check, solution)
    if is_tested and solution.cells is None:
        result = widened_beyond(result, solution.points.xy, solution.points.z, area)
    claim = _claim(solution, result, area)
    if check is not None:
        claim = replace(claim, untested_share=_untested_share(solution, result, check, area))
    facts: dict[str, Any] = {} if check is None else {CHECK: check.facts()}
    diagnostics = {**result.diagnostics, **facts, CLAIM: claim.facts()}
    return mapped._replace(reconstruction=replace(result, diagnostics=diagnostics))


def _widened(result: Reconstruction, check: PredictiveCheck, solution: JointSolution) -> Reconstruction:
    """Return the map with the standard deviations that the check leaves standing."""
    if not check.contradicts:
        return result
    grid = result.mean.grid()
    distance = np.asarray(cKDTree(solution.points.xy).query(grid.xy)[0], dtype=np.float64)
    std: FloatArray = result.std.elevation * check.factor_at(distance).reshape(grid.shape)
    return replace(result, std=Dem.on(grid, std, result.std.vertical_datum))


def _untested_share(
    solution: JointSolution, result: Reconstruction, check: PredictiveCheck, area: SurveyArea | None
) -> float:
    """Return the share of the ground that lies farther from all points than the farthest third of those left out."""
    xy = result.mean.grid().xy
    inside = np.ones(len(xy), dtype=bool) if area is None else area.contains(xy)
    distance = np.asarray(cKDTree(solution.points.xy).query(xy[inside])[0], dtype=np.float64)
    return float(np.mean(distance > max(check.distance_m))) if inside.any() else 0.0


def _claim(solution: JointSolution, result: Reconstruction, area: SurveyArea | None) -> RmseClaim:
    grid = result.mean.grid()
    inside = np.ones(grid.shape, dtype=bool)
    if area is not None:
        inside = area.contains(grid.xy).reshape(grid.shape)
    rows = sampled_nodes(inside if inside.any() else np.ones_like(inside))
    return RmseClaim.of(solution.terrain.covariance(grid.xy[rows]), result.std.elevation.ravel()[rows])

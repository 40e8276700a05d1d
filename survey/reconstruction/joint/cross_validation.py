r"""Cross-validation of a joint estimate by leaving out one swath at a time, and the map with its test and claim.

`swaths_of` divides a drive into swaths by keyframes and headings. With the rows H of a block, its posterior covariance
``P = H C Hᵀ`` given all points, its noise T and its residuals r, the estimate without the block errs at the block by

.. math::  e = T (T - P)^{-1} r, \qquad \operatorname{cov} e = T (T - P)^{-1} T

(Sherman, Morrison and Woodbury), so that one solve of all points suffices. Hyperparameters are those of all points.
`checked_map` widens the standard deviation of the map where swaths that were left out contradict it, and states the
posterior of its error.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.spatial import cKDTree

from survey.core import FloatArray, IntArray, stream
from survey.data import Dem, Grid, SurfacePoints, SurveyArea
from survey.reconstruction.beyond_points import widened_beyond
from survey.reconstruction.checks import HeldOut, HeldOutGroups, PredictiveCheck, RmseClaim, sampled_nodes
from survey.reconstruction.gp.marginal_likelihood import Hyperparameters
from survey.reconstruction.joint.normal_equations import TerrainPosterior
from survey.reconstruction.joint.solution import JointMap, JointSolution, MapAverage
from survey.reconstruction.terrain_map import CHECK, CLAIM, Reconstruction

# A swath ends where the heading has turned by more than this from that of its beginning [rad].
_TURN_RAD = np.radians(50.0)
# A swath is left out in pieces of at most this share of all points, and of at most so many points.
_LARGEST_SHARE, _LARGEST_PIECE = 0.3, 1000
# Runs with fewer points are turns, and are never left out.
_N_LEAST = 15


class Swaths(NamedTuple):
    """Numbers of the swath from which points were seen (N,), -1 for points of short runs; and whether some are parts."""

    number: IntArray
    are_parts: bool


def swaths_of(points: SurfacePoints) -> Swaths:
    """Return the swath from which each point was seen.

    Points are ordered by their keyframes. A swath is a run without a turn; runs that hold more than three
    tenths of all points, or more than 1,000, are cut into equal parts.

    >>> heading = np.repeat([0.0, 1.57, 3.14], [40, 2, 40])
    >>> line = SurfacePoints(
    ...     np.zeros((82, 3)), covariance=np.tile(np.eye(3), (82, 1, 1)), own_covariance=np.tile(np.eye(3), (82, 1, 1)),
    ...     keyframe=np.arange(82.0), heading_rad=heading, body=np.zeros((82, 3)), crs="EPSG:32608")
    >>> np.unique(swaths_of(line).number, return_counts=True)[1].tolist()
    [2, 20, 20, 20, 20]
    """
    assert points.keyframe is not None
    assert points.heading_rad is not None
    order = np.argsort(points.keyframe, kind="stable")
    swath = np.full(len(points), -1, dtype=np.int64)
    n_swaths, are_parts = 0, False
    for run in _runs(points.heading_rad[order]):
        rows = order[run]
        if len(rows) < _N_LEAST:
            continue
        most = min(max(_LARGEST_SHARE * len(points), _N_LEAST), _LARGEST_PIECE)
        n_pieces = int(np.ceil(len(rows) / most))
        are_parts |= n_pieces > 1
        for piece in np.array_split(rows, n_pieces):
            swath[piece] = n_swaths
            n_swaths += 1
    return Swaths(swath, are_parts)


def groups_of(xy: FloatArray, most: int) -> list[IntArray]:
    """Return the rows of groups of neighbours, by halving the points along their longer extent.

    `xy` (N, 2): places [m].

    >>> [rows.tolist() for rows in groups_of(np.array([[0.0, 0.0], [9.0, 0.0], [1.0, 0.0], [8.0, 0.0]]), 2)]
    [[0, 2], [3, 1]]
    """
    found, waiting = [], [np.arange(len(xy))]
    while waiting:
        rows = waiting.pop()
        if len(rows) <= most:
            found.append(rows)
            continue
        axis = int(np.argmax(np.ptp(xy[rows], axis=0)))
        rows = rows[np.argsort(xy[rows, axis], kind="stable")]
        waiting += [rows[len(rows) // 2 :], rows[: len(rows) // 2]]
    return found


def _runs(heading_rad: FloatArray) -> list[slice]:
    """Return runs of headings that stay within a turn of that at their beginning."""
    starts, first = [0], heading_rad[0]
    for k, heading in enumerate(heading_rad):
        if abs((heading - first + np.pi) % (2.0 * np.pi) - np.pi) > _TURN_RAD:
            starts.append(k)
            first = heading
    return [slice(a, b) for a, b in zip(starts, [*starts[1:], len(heading_rad)], strict=True)]


# Points that are left out in total.
_MOST_POINTS = 2000
# Points whose errors are averaged, and groups of a swath.
_GROUP, _MOST_GROUPS = 12, 100
# Share of the noise that is left to a direction in which only the block itself is informative.
_LEAST_SHARE = 1e-9


class _Block(NamedTuple):
    """Rows, errors and variances of one block (N_B,); means of groups of it, and what their covariance with other blocks needs."""

    rows: IntArray
    error_m: FloatArray
    variance_m2: FloatArray
    averages: FloatArray
    own_m2: FloatArray
    waves: FloatArray
    seen_waves: FloatArray
    shared: FloatArray
    seen_shared: FloatArray

    def with_other(self, other: "_Block") -> FloatArray:
        """Return the covariance of the group means' errors with those of another block."""
        return -(self.waves @ other.seen_waves + self.shared @ other.seen_shared)


def check_by_swaths(solution: JointSolution) -> PredictiveCheck | None:
    """Test the joint estimate by leaving out one swath at a time; None where the drive has fewer than two."""
    held_out = held_out_swaths(solution)
    return None if held_out is None else PredictiveCheck.of(held_out)


def held_out_swaths(solution: JointSolution) -> HeldOut | None:
    """Predict swaths that are left out one at a time; None where the drive has fewer than two."""
    if solution.average is not None:
        return solution.average.held_out
    swaths = swaths_of(solution.points)
    blocks = _choose(swaths.number)
    if len(blocks) < 2:
        return None
    solved = [_solve_block(solution, rows) for rows in blocks]
    rows = np.concatenate([block.rows for block in solved])
    relief_m2 = solution.tail_m2 + solution.hyperparameters.nugget_m**2
    variance = np.concatenate([block.variance_m2 for block in solved]) + relief_m2
    distance = np.concatenate([_distance_to_others(solution.points.xy, block.rows) for block in solved])
    error = np.concatenate([block.error_m for block in solved])
    noise = solution.noise_m2[rows] - solution.hyperparameters.nugget_m**2
    averages = block_diag(*(block.averages for block in solved))
    covariance = np.block([[a.own_m2 if a is b else a.with_other(b) for b in solved] for a in solved])
    own = averages**2 @ noise
    predicted = np.maximum(np.diag(covariance) - own, 0.0)
    groups = HeldOutGroups(averages @ error, predicted, own, averages @ distance, covariance)
    kind = "parts of swaths" if swaths.are_parts else "swaths"
    return HeldOut(kind, len(solved), error, variance, noise, distance, groups)


def averaged(
    solutions: Iterable[tuple[Hyperparameters, JointSolution]],
    found: Hyperparameters,
    rivals: list[Hyperparameters],
    weights: FloatArray,
) -> MapAverage:
    """Return maps with all probable kernels, and the swaths that they predict together.

    `solutions`: coarse solutions with the kernel that was found and all rivals. `weights` (K,): probabilities of the
    rivals.
    """
    maps: dict[Hyperparameters, TerrainPosterior] = {}
    left_out: dict[Hyperparameters, HeldOut | None] = {}
    for one, solution in solutions:
        maps[one] = solution.terrain
        if one in rivals:
            left_out[one] = held_out_swaths(solution)
    predicted = [held_out for one in rivals if (held_out := left_out[one]) is not None]
    held_out = HeldOut.mixture(predicted, weights) if predicted else None
    return MapAverage(maps[found], tuple(maps[one] for one in rivals), weights, held_out)


def _choose(swath: IntArray) -> list[IntArray]:
    """Return the rows of swaths to leave out, the same ones always, up to the number of points that can be left out."""
    names, counts = np.unique(swath[swath >= 0], return_counts=True)
    order = stream(0, "swaths left out").permutation(len(names))
    total = np.cumsum(counts[order])
    taken = order[(total <= _MOST_POINTS) | (np.arange(len(order)) < 2)]
    return [np.flatnonzero(swath == names[k]) for k in np.sort(taken)]


def _solve_block(solution: JointSolution, rows: IntArray) -> _Block:
    """Return errors and covariance of one block, predicted without it."""
    posterior, points = solution.posterior, solution.points
    noise = solution.total_m2[rows]
    shared = solution.rows[rows]
    waves = solution.terrain.waves_at(points.xy[rows]) - shared @ posterior.reach
    seen = posterior.seen(waves)
    known = waves @ seen + _known_shared(posterior.factor, shared)
    residual = solution.residual_m[rows]
    half = np.sqrt(noise)
    left = np.eye(len(rows)) - 0.5 * (known + known.T) / np.outer(half, half)
    left[np.diag_indices(len(rows))] += _LEAST_SHARE
    factor = cho_factor(left, lower=True, check_finite=False)
    # Whitened by the noise, the error is (1 - P)⁻¹ r and its covariance (1 - P)⁻¹.
    covariance = cho_solve(factor, np.eye(len(rows)))
    error = half * cho_solve(factor, residual / half)
    averages = _averages(points.xy[rows])
    reach = (averages * half) @ covariance / half
    variance = noise * np.diag(covariance) - noise
    rest = solution.noise_m2[rows] + solution.tail_m2 - noise
    shared_reach = np.asarray((shared.T @ reach.T).T)
    own = (reach * noise) @ averages.T + (averages * rest) @ averages.T
    return _Block(
        rows,
        error,
        np.maximum(variance, 0.0),
        averages,
        own,
        reach @ waves,
        seen @ reach.T,
        shared_reach,
        posterior.factor.solve(np.ascontiguousarray(shared_reach.T)),
    )


def _averages(xy: FloatArray) -> FloatArray:
    """Return the weights (K, N) of means over groups of neighbours."""
    groups = groups_of(xy, max(_GROUP, int(np.ceil(2.0 * len(xy) / _MOST_GROUPS))))
    weights = np.zeros((len(groups), len(xy)))
    for k, rows in enumerate(groups):
        weights[k, rows] = 1.0 / len(rows)
    return weights


def _known_shared(factor: Any, rows: Any) -> FloatArray:
    """Return ``U G⁻¹ Uᵀ`` (N, N) for sparse rows U (N, S), by the few columns that they touch."""
    touched = np.unique(rows.indices)
    columns = np.zeros((rows.shape[1], len(touched)))
    columns[touched, np.arange(len(touched))] = 1.0
    part = rows[:, touched]
    covariance: FloatArray = part @ (part @ factor.solve(columns)[touched]).T
    return covariance


def _distance_to_others(xy: FloatArray, rows: IntArray) -> FloatArray:
    others = np.ones(len(xy), dtype=bool)
    others[rows] = False
    return np.asarray(cKDTree(xy[others]).query(xy[rows])[0], dtype=np.float64)


def checked_map(solution: JointSolution, grid: Grid, area: SurveyArea | None, *, is_tested: bool) -> JointMap:
    """Return the map on a grid, its standard deviation widened where swaths that were left out contradict it."""
    mapped = solution.on(grid)
    check = check_by_swaths(solution) if is_tested else None
    result = mapped.reconstruction if check is None else _widen(mapped.reconstruction, check, solution)
    if is_tested and solution.cells is None:
        result = widened_beyond(result, solution.points.xy, solution.points.z, area)
    claim = _claim(solution, result, area)
    if check is not None:
        claim = replace(claim, untested_share=_untested_share(solution, result, check, area))
    facts: dict[str, Any] = {} if check is None else {CHECK: check.facts()}
    diagnostics = {**result.diagnostics, **facts, CLAIM: claim.facts()}
    return mapped._replace(reconstruction=replace(result, diagnostics=diagnostics))


def _widen(result: Reconstruction, check: PredictiveCheck, solution: JointSolution) -> Reconstruction:
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

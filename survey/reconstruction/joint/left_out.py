r"""Predictions of swaths of points by a joint estimate that leaves them out, from the one solve of all points.

With the rows H of a block, its posterior covariance ``P = H C Hᵀ`` given all points, its noise T and its
residuals r, the estimate without the block errs at the block by

.. math::  e = T (T - P)^{-1} r, \qquad \operatorname{cov} e = T (T - P)^{-1} T

(Sherman, Morrison and Woodbury). Hyperparameters are those of all points.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.spatial import cKDTree

from survey.core.arrays import FloatArray, IntArray
from survey.core.streams import stream
from survey.reconstruction.checks.predictive import HeldOut, HeldOutGroups, PredictiveCheck
from survey.reconstruction.checks.swaths import groups_of, swaths_of
from survey.reconstruction.joint.solution import JointSolution

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
    """Test the joint estimate by leaving out one swath at a time; None where the drive has fewer than two.

    Parameters
    ----------
    solution : JointSolution
        Estimate from all points.

    Returns
    -------
    PredictiveCheck or None
        Of about 2,000 points at most.
    """
    held_out = held_out_swaths(solution)
    return None if held_out is None else PredictiveCheck.of(held_out)


def held_out_swaths(solution: JointSolution) -> HeldOut | None:
    """Predict swaths that are left out one at a time; None where the drive has fewer than two.

    Parameters
    ----------
    solution : JointSolution
        Estimate from all points.

    Returns
    -------
    HeldOut or None
        Errors and their claimed covariance, averaged over kernels as the map is.
    """
    if solution.average is not None:
        return solution.average.held_out
    swaths = swaths_of(solution.points)
    blocks = _chosen(swaths.number)
    if len(blocks) < 2:
        return None
    solved = [_solved(solution, rows) for rows in blocks]
    rows = np.concatenate([block.rows for block in solved])
    relief_m2 = solution.tail_m2 + solution.found.nugget_m**2
    variance = np.concatenate([block.variance_m2 for block in solved]) + relief_m2
    distance = np.concatenate([_distance_to_others(solution.points.xy, block.rows) for block in solved])
    error = np.concatenate([block.error_m for block in solved])
    noise = solution.noise_m2[rows] - solution.found.nugget_m**2
    averages = block_diag(*(block.averages for block in solved))
    covariance = np.block([[a.own_m2 if a is b else a.with_other(b) for b in solved] for a in solved])
    own = averages**2 @ noise
    predicted = np.maximum(np.diag(covariance) - own, 0.0)
    groups = HeldOutGroups(averages @ error, predicted, own, averages @ distance, covariance)
    kind = "parts of swaths" if swaths.are_parts else "swaths"
    return HeldOut(kind, len(solved), error, variance, noise, distance, groups)


def _chosen(swath: IntArray) -> list[IntArray]:
    """Return the rows of swaths to leave out, the same ones always, up to the number of points that can be left out."""
    names, counts = np.unique(swath[swath >= 0], return_counts=True)
    order = stream(0, "swaths left out").permutation(len(names))
    total = np.cumsum(counts[order])
    taken = order[(total <= _MOST_POINTS) | (np.arange(len(order)) < 2)]
    return [np.flatnonzero(swath == names[k]) for k in np.sort(taken)]


def _solved(solution: JointSolution, rows: IntArray) -> _Block:
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

r"""Predictions of swaths of points by a joint estimate that leaves them out, from the one solve of all points.

With the rows H of a block, its posterior covariance ``P = H C Hᵀ`` given all points, its noise T and its
residuals r, the estimate without the block errs at the block by

.. math::  e = T (T - P)^{-1} r, \qquad \operatorname{cov} e = T (T - P)^{-1} T

(Sherman, Morrison and Woodbury). Hyperparameters are those of all points.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial import cKDTree

from survey.core.arrays import FloatArray, IntArray
from survey.core.streams import stream
from survey.reconstruction.checks.predictive import HeldOut, PredictiveCheck
from survey.reconstruction.checks.swaths import swaths_of
from survey.reconstruction.joint.joint_solve import waves_at
from survey.reconstruction.joint.solution import JointSolution

# Points that are left out in total, and points of a swath whose errors are held against each other.
_MOST_POINTS = 2000
_N_TESTED = 60
# Share of the noise that is left to a direction in which only the block itself is informative.
_LEAST_SHARE = 1e-9


class _Block(NamedTuple):
    """Rows of one block: errors and variances (N_B,), tested rows, and what their covariance with other blocks needs."""

    rows: IntArray
    error_m: FloatArray
    variance_m2: FloatArray
    tested: IntArray
    own_m2: FloatArray
    waves: FloatArray
    seen_waves: FloatArray
    shared: FloatArray
    seen_shared: FloatArray

    def with_other(self, other: "_Block") -> FloatArray:
        """Return the covariance of the tested errors with those of another block."""
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
        Errors and their claimed covariance.
    """
    swaths = swaths_of(solution.points)
    blocks = _chosen(swaths.number)
    if len(blocks) < 2:
        return None
    solved = [_solved(solution, rows, number) for number, rows in enumerate(blocks)]
    rows = np.concatenate([block.rows for block in solved])
    starts = np.cumsum([0, *(len(block.rows) for block in solved[:-1])])
    part = np.concatenate([start + block.tested for start, block in zip(starts, solved, strict=True)])
    distances = [_distance_to_others(solution.points.xy, block.rows) for block in solved]
    own_m2 = solution.noise_m2[rows] - solution.found.nugget_m**2
    return HeldOut(
        "parts of swaths" if swaths.are_parts else "swaths",
        len(solved),
        np.concatenate([block.error_m for block in solved]),
        np.concatenate([block.variance_m2 for block in solved])
        + solution.tail_m2
        + solution.found.nugget_m**2,
        own_m2,
        np.concatenate(distances),
        part,
        np.block([[a.own_m2 if a is b else a.with_other(b) for b in solved] for a in solved]),
    )


def _chosen(swath: IntArray) -> list[IntArray]:
    """Return the rows of swaths to leave out, the same ones always, up to the number of points that can be left out."""
    names, counts = np.unique(swath[swath >= 0], return_counts=True)
    order = stream(0, "swaths left out").permutation(len(names))
    total = np.cumsum(counts[order])
    taken = order[(total <= _MOST_POINTS) | (np.arange(len(order)) < 2)]
    return [np.flatnonzero(swath == names[k]) for k in np.sort(taken)]


def _solved(solution: JointSolution, rows: IntArray, number: int) -> _Block:
    """Return errors and covariance of one block, predicted without it."""
    posterior, points = solution.posterior, solution.points
    noise = solution.total_m2[rows]
    shared = solution.rows[rows]
    waves = waves_at(points.xy[rows], solution.basis, posterior.weights.amplitudes) - shared @ posterior.reach
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
    rng = stream(0, "points tested", number)
    tested = np.sort(rng.permutation(len(rows))[:_N_TESTED])
    reach = (half[tested, None] * covariance[tested]) / half
    variance = noise * np.diag(covariance) - noise
    shared_reach = np.asarray((shared.T @ reach.T).T)
    own = covariance[np.ix_(tested, tested)] * np.outer(half[tested], half[tested])
    own[np.diag_indices(len(tested))] += (solution.noise_m2[rows] + solution.tail_m2 - noise)[tested]
    return _Block(
        rows,
        error,
        np.maximum(variance, 0.0),
        tested,
        own,
        reach @ waves,
        seen @ reach.T,
        shared_reach,
        posterior.factor.solve(np.ascontiguousarray(shared_reach.T)),
    )


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

"""Predictions of swaths from one solve, against solving again without them."""

from dataclasses import replace

import numpy as np
import pytest

from survey.data.path_error import PathError
from survey.data.surface_points import SurfacePoints
from survey.reconstruction import GaussianProcessConfig
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.reconstruction.joint.normal_equations import waves_at
from survey.reconstruction.joint.solution import (
    JointSolution,
    _solve_block,
    check_by_swaths,
    checked_map,
    held_out_swaths,
)
from tests.survey.reconstruction.joint.test_joint_map import GRID, KNOWN, TWO_M, cells_of, hill, path_error


def two_swaths(n: int = 160, lift_m: float = 0.0, seed: int = 1) -> SurfacePoints:
    """Landmarks beside a line to the east and one back to the west, the second lifted."""
    rng = np.random.default_rng(seed)
    keyframe = np.sort(rng.uniform(0.0, 5.0, n))
    back = keyframe > 2.5
    along = np.where(back, 190.0 - 72.0 * (keyframe - 2.5), 10.0 + 72.0 * keyframe)
    body = np.column_stack([along, np.where(back, 150.0, 50.0), np.zeros(n)])
    xy = body[:, :2] + np.column_stack([rng.uniform(-5.0, 5.0, n), rng.uniform(-45.0, 45.0, n)])
    body[:, 2] = hill(body[:, :2])
    z = hill(xy) + np.where(back, lift_m, 0.0) + 0.04 * rng.standard_normal(n)
    own = np.tile(np.diag([1e-6, 1e-6, 0.04**2]), (n, 1, 1))
    return SurfacePoints(
        np.column_stack([xy, z]),
        covariance=own + np.eye(3),
        crs=GRID.crs,
        own_covariance=own,
        keyframe=keyframe,
        heading_rad=np.where(back, np.pi, 0.0),
        body=body,
    )


def solution_of(points: SurfacePoints, path: PathError) -> JointSolution:
    return JointTerrain(path, cells_of(hill), KNOWN, TWO_M).solve(points, GRID.bounds)


def test_a_swath_is_predicted_as_by_an_estimate_without_it():
    points = two_swaths()
    solution = JointTerrain(path_error(0.3, 0.5), None, KNOWN, TWO_M).solve(points, GRID.bounds)
    rows = np.flatnonzero(points.keyframe <= 1.2)
    block = _solve_block(solution, rows)
    others = np.setdiff1d(np.arange(len(points)), rows)
    waves = waves_at(points.xy, solution.basis, solution.posterior.weights.amplitudes)
    design = np.hstack([waves, solution.rows.toarray()])
    n_waves, n_path = waves.shape[1], solution.shared.rows.shape[1]
    prior = np.zeros((design.shape[1],) * 2)
    prior[:n_waves, :n_waves] = np.eye(n_waves)
    prior[n_waves : n_waves + n_path, n_waves : n_waves + n_path] = solution.path.information.toarray()
    own = n_waves + n_path + solution.trend.n_columns + np.arange(len(solution.landmarks.sigma))
    prior[own, own] = solution.landmarks.sigma**-2.0
    weighted = design[others] / solution.total_m2[others, None]
    covariance = np.linalg.inv(prior + design[others].T @ weighted)
    estimate = covariance @ (weighted.T @ (points.z[others] - solution.datum_m))
    error = points.z[rows] - solution.datum_m - design[rows] @ estimate
    variance = np.einsum("ij,jk,ik->i", design[rows], covariance, design[rows])
    assert block.error_m == pytest.approx(error, abs=1e-5)
    assert block.variance_m2 == pytest.approx(variance, rel=1e-4)
    whole = design[rows] @ covariance @ design[rows].T + np.diag((solution.noise_m2 + solution.tail_m2)[rows])
    assert block.own_m2 == pytest.approx(block.averages @ whole @ block.averages.T, rel=1e-4, abs=1e-9)


def test_an_honest_estimate_is_not_contradicted():
    check = check_by_swaths(solution_of(two_swaths(), path_error(0.3, 0.5)))
    assert check is not None
    assert not check.contradicts
    assert check.n_blocks >= 2


def test_a_prediction_claims_what_an_unknown_kernel_leaves_open_as_the_map_does():
    solution = JointTerrain(path_error(0.01), joint=TWO_M).solve(two_swaths(80), GRID.bounds)
    assert solution.average is not None
    averaged, single = (held_out_swaths(one) for one in (solution, replace(solution, average=None)))
    assert averaged.sigma_m.mean() > 1.03 * single.sigma_m.mean()
    assert averaged.groups.variance_m2.mean() > 1.03**2 * single.groups.variance_m2.mean()


def test_swaths_that_disagree_by_more_than_the_path_can_err_contradict_the_map():
    points, stiff = two_swaths(lift_m=0.6), path_error(0.02)
    check = check_by_swaths(solution_of(points, stiff))
    assert check is not None
    assert check.contradicts
    fitted = GaussianProcessConfig(**{**dict(KNOWN), "calibrate": True})
    model = JointTerrain(stiff, cells_of(hill), fitted, TWO_M)
    checked, plain = (
        replace(model, config=config).map(points, GRID).reconstruction for config in (fitted, KNOWN)
    )
    assert plain.check is None
    assert checked.check is not None
    assert checked.check.contradicts
    assert (checked.std.elevation >= plain.std.elevation).all()
    assert checked.std.elevation.max() > 1.2 * plain.std.elevation.max()
    assert checked.claim.absolute.upper_m > plain.claim.absolute.upper_m


def test_ground_far_from_a_single_swath_counts_as_untested():
    both = two_swaths(400)
    single = both.select(np.flatnonzero(both.keyframe <= 2.5))
    shares = [
        checked_map(
            solution_of(points, path_error(0.3, 0.5)), GRID, None, is_tested=True
        ).reconstruction.claim.untested_share
        for points in (single, both)
    ]
    assert shares[0] > 0.3
    assert shares[1] < 0.05

"""Fusion of the paths of several drives by the places that they share."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import sparse

from survey.core.arrays import FloatArray, IntArray
from survey.core.errors import InputError
from survey.data.path_error import POSE, PathError
from survey.data.sensors.drive_ties import DriveTies
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.reconstruction.joint.drives import SeveralDrives
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.pose_constraints import PoseConstraints, gate_constraints, pose_jacobian


def tie_drives(
    drives: SeveralDrives,
    paths: Sequence[Trajectory],
    ties: DriveTies,
    config: LocalizationConfig | None = None,
) -> SeveralDrives:
    r"""Correct the errors of several paths by the places that the drives share.

    A tie that finds body j of one drive at o from body i of another, for estimated positions p̃ with errors e and the
    heading's error ψ,

    .. math::  \tilde p_j - \tilde p_i - o = e_j - e_i - \psi_i \, (z \times o)

    is a linear measurement of the errors of both paths. Ties that contradict all others are left out by the gate of
    the smoother.

    Parameters
    ----------
    drives : SeveralDrives
        Landmarks of all drives, with the errors of their paths.
    paths : sequence of Trajectory
        Path of each drive, as its landmarks were seen from.
    ties : DriveTies
        Places that drives share.
    config : LocalizationConfig, optional
        For its gate of ties.

    Returns
    -------
    SeveralDrives
        Landmarks moved by the estimated errors, and the posterior of these; both are those given where no tie is left.

    Raises
    ------
    InputError
        The errors of the paths are unknown, ties name a drive that is not there, or landmarks name no keyframe.
    """
    if drives.path is None:
        raise InputError(
            "drives are tied by the errors of their paths; localize again, or leave the ties out."
        )
    if int(ties.second.max()) >= len(paths):
        raise InputError(
            f"ties name drive {int(ties.second.max())}, and there are {len(paths)} drives; take the ties of these."
        )
    gate = (config or LocalizationConfig()).tie_gate
    at_rest = np.zeros(drives.path.n_unknowns)
    constraints = gate_constraints(_constraints(drives, drives.path, paths, ties), drives.path, at_rest, gate)
    return _updated(drives, drives.path, constraints) if len(constraints) else drives


def _updated(drives: SeveralDrives, error: PathError, constraints: PoseConstraints) -> SeveralDrives:
    """Return the drives after a measurement of the errors of their paths."""
    weighted = np.linalg.solve(constraints.noise, constraints.rows.toarray())
    added = sparse.csr_array(constraints.rows.T @ sparse.csr_array(weighted))
    tied = replace(error, information=sparse.csr_array(error.information + 0.5 * (added + added.T)))
    found = tied.solve(weighted.T @ constraints.value)
    shift = found[: len(tied) * tied.n_states].reshape(len(tied), tied.n_states)[:, :3]
    return drives._replace(points=_moved(drives.points, tied, found), path=tied, shift=shift)


def _constraints(
    drives: SeveralDrives, error: PathError, paths: Sequence[Trajectory], ties: DriveTies
) -> PoseConstraints:
    """Return the equations of ties for the errors of the paths."""
    first, second = ties.first.astype(np.int64), ties.second.astype(np.int64)
    moved = _positions(paths, second, ties.second_s) - _positions(paths, first, ties.time_s)
    by_second = np.tile(np.eye(3, POSE), (len(ties), 1, 1))
    by_first = by_second.copy()
    by_first[:, :, 3] = np.cross([0.0, 0.0, 1.0], ties.offset)
    rows = _rows(error, _keyframes(drives, second, ties.second_s), by_second)
    rows = rows - _rows(error, _keyframes(drives, first, ties.time_s), by_first)
    noise = np.asarray(sparse.block_diag(list(ties.covariance)).toarray())
    return PoseConstraints(sparse.csr_array(rows), (moved - ties.offset).ravel(), noise)


def _keyframes(drives: SeveralDrives, drive: IntArray, time_s: FloatArray) -> FloatArray:
    """Return places among the keyframes of all drives, from times on the clock of each drive."""
    counts = np.cumsum([0, *(len(times) for times in drives.time_s)])
    found = np.empty(len(drive))
    for k, times in enumerate(drives.time_s):
        found[drive == k] = counts[k] + np.interp(time_s[drive == k], times, np.arange(len(times)))
    return found


def _rows(error: PathError, keyframe: FloatArray, by_pose: FloatArray) -> sparse.csr_array:
    """Return three rows for each keyframe, from derivatives (N, 3, 6) by its pose."""
    rows: sparse.csr_array = error.rows(np.repeat(keyframe, 3), by_pose.reshape(-1, POSE))
    return rows


def _positions(paths: Sequence[Trajectory], drive: IntArray, time_s: FloatArray) -> FloatArray:
    """Return the estimated positions (N, 3) [m] of drives at times."""
    found = np.empty((len(drive), 3))
    for k, path in enumerate(paths):
        here = drive == k
        for axis in range(3):
            found[here, axis] = np.interp(time_s[here], path.time_s, path.position[:, axis])
    return found


def _moved(points: SurfacePoints, error: PathError, estimate: FloatArray) -> SurfacePoints:
    """Return landmarks less the estimated errors of their poses, with the covariance that is left."""
    keyframe, body, heading_rad = points.keyframe, points.body, points.heading_rad
    if points.own_covariance is None or keyframe is None or body is None or heading_rad is None:
        raise InputError("the points do not name the keyframes that they were seen from; localize again.")
    level = np.zeros_like(heading_rad)
    jacobian = pose_jacobian(points.xyz - body, np.column_stack([level, level, heading_rad]))
    shared = jacobian @ error.pose_covariance(keyframe) @ jacobian.transpose(0, 2, 1)
    shift = (_rows(error, keyframe, jacobian) @ estimate).reshape(-1, 3)
    places = np.tile(np.eye(3, POSE), (len(points), 1, 1))
    body_shift = (_rows(error, keyframe, places) @ estimate).reshape(-1, 3)
    return replace(
        points,
        xyz=points.xyz - shift,
        covariance=points.own_covariance + 0.5 * (shared + shared.transpose(0, 2, 1)),
        body=body - body_shift,
        origins=None if points.origins is None else points.origins - body_shift,
    )

"""Pose constraints: stakes, loop closures and places that several drives share.

`pose_constraints` gives the linear equations of stakes and loop closures for the errors of one path, and `gate_constraints`
leaves out those that contradict all others (leave-one-out χ² test). `tie_drives` applies the constraints between several
drives to the errors of their paths, and moves their landmarks.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import sparse

from survey import InputError, SurfacePoints, Trajectory
from survey.core import FloatArray, IntArray
from survey.data.path_error import POSE, PathError
from survey.data.recording import OdometryRecording
from survey.data.sensors.odometry import DriveTies
from survey.data.sensors.stakes import Stakes
from survey.reconstruction.joint.drives import SeveralDrives
from vision_slam.attitude import rotations, turned
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.normal_equations import PER_NODE, BlockTridiagonal


@dataclass(frozen=True)
class PoseConstraints:
    """M constraints of three rows each: sparse ``rows`` (3 M, unknowns), ``value`` (3 M,) and ``noise`` (3 M, 3 M)."""

    rows: Any
    value: FloatArray
    noise: FloatArray

    def __len__(self) -> int:
        return len(self.value) // 3

    def without(self, which: int) -> "PoseConstraints":
        """Return all but one."""
        keep = np.ones(len(self.value), dtype=bool)
        keep[3 * which : 3 * which + 3] = False
        return PoseConstraints(self.rows[keep], self.value[keep], self.noise[np.ix_(keep, keep)])


def pose_constraints(
    recording: OdometryRecording,
    dead_reckoned: FloatArray,
    node_time_s: FloatArray,
    n_unknowns: int,
    config: LocalizationConfig,
) -> PoseConstraints:
    r"""Return the equations of stakes and loop closures for the errors of the path.

    A stake at p, seen at the offset o from the pose: p̃ + R̃ o − p = e + ∂(R o) · (ψ, θ, φ).
    A closure that finds pose j at o from pose i: p̃_j − p̃_i − R̃_i o = e_j − e_i − ∂(R o) · (ψ, θ, φ)_i.
    All sightings of a stake share the error of its survey, and all sightings between two nodes what the path errs
    beyond its interpolation between them.
    """
    place = _Place(recording, dead_reckoned, node_time_s, n_unknowns)
    rows, value, noise = [sparse.csr_array((0, n_unknowns))], [np.zeros(0)], [np.zeros((0, 3, 3))]
    shared = np.zeros((0, 0))
    seen, stakes, closures = recording.stake_sightings, recording.stakes, recording.loop_closures
    if seen is not None and stakes is not None:
        arm, spread = place.arm(seen.time_s, seen.offset, seen.covariance)
        rows.append(place.rows(seen.time_s, arm, 1.0) - place.motion_rows(stakes, seen.index))
        value.append((place.position(seen.time_s) + arm - stakes.position[seen.index]).ravel())
        noise.append(spread)
        shared = _of_survey(seen.index, stakes.sigma_m) + place.between_nodes(seen.time_s, config)
    if closures is not None:
        arm, spread = place.arm(closures.earlier_s, closures.offset, closures.covariance)
        still = np.zeros_like(arm)
        rows.append(place.rows(closures.time_s, still, 1.0) - place.rows(closures.earlier_s, arm, 1.0))
        moved = place.position(closures.time_s) - place.position(closures.earlier_s)
        value.append((moved - arm).ravel())
        noise.append(spread)
    return PoseConstraints(
        sparse.csr_array(sparse.vstack(rows)), np.concatenate(value), _noise(np.concatenate(noise), shared)
    )


def _noise(own: FloatArray, shared: FloatArray) -> FloatArray:
    """Return the covariance (3 M, 3 M) of constraints: their own (M, 3, 3), and that which the first of them share."""
    if not len(own):
        return np.zeros((0, 0))
    noise = np.asarray(sparse.block_diag(list(own)).toarray())
    noise[: len(shared), : len(shared)] += shared
    return noise


def _of_survey(stake: IntArray, sigma_m: FloatArray) -> FloatArray:
    """Return the covariance (3 N, 3 N) of sightings of stakes by the errors of their survey."""
    covariance: FloatArray = np.kron((stake[:, None] == stake) * sigma_m[stake] ** 2, np.eye(3))
    return covariance


def gate_constraints(
    constraints: PoseConstraints, chain: BlockTridiagonal | PathError, estimate: FloatArray, gate: float
) -> PoseConstraints:
    r"""Remove, worst first, every constraint that contradicts all other constraints and sensors.

    Each is predicted without itself: with S = H Σ Hᵀ + R over all constraints, y their
    innovations and i the rows of one, its leave-one-out innovation is
    ``([S⁻¹]_ii)⁻¹ [S⁻¹ y]_i`` with the covariance ``([S⁻¹]_ii)⁻¹``; its squared length in
    standard deviations is χ² with three degrees of freedom.
    """
    while len(constraints):
        seen = chain.solve(constraints.rows.T.toarray())
        precision = np.linalg.inv(constraints.rows @ seen + constraints.noise)
        weighted = precision @ (constraints.value - constraints.rows @ estimate)
        blocks = [slice(3 * i, 3 * i + 3) for i in range(len(constraints))]
        squared = [float(weighted[b] @ np.linalg.solve(precision[b, b], weighted[b])) for b in blocks]
        worst = int(np.argmax(squared))
        if squared[worst] <= gate:
            break
        constraints = constraints.without(worst)
    return constraints


@dataclass(frozen=True)
class _Place:
    """Interpolation of the dead-reckoned path between poses, and of the unknowns between nodes."""

    recording: OdometryRecording
    dead_reckoned: FloatArray
    node_time_s: FloatArray
    n_unknowns: int

    def position(self, time_s: FloatArray) -> FloatArray:
        times = self._times
        return np.column_stack([np.interp(time_s, times, column) for column in self.dead_reckoned.T])

    def arm(
        self, time_s: FloatArray, offset: FloatArray, covariance: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return offsets (M, 3) and their covariances, turned into the world."""
        rotation = rotations(self._attitude(time_s))
        arm = np.einsum("nij,nj->ni", rotation, offset)
        return arm, rotation @ covariance @ rotation.transpose(0, 2, 1)

    def rows(self, time_s: FloatArray, arm: FloatArray, sign: float) -> Any:
        """Return the rows (3 M, unknowns) of the place of arms (M, 3) held out from the poses."""
        keyframe = np.interp(time_s, self.node_time_s, np.arange(len(self.node_time_s), dtype=np.float64))
        by_pose = sign * pose_jacobian(arm, self._attitude(time_s))
        # The information is not needed to lay out rows.
        layout = PathError(self.node_time_s, sparse.csr_array((self.n_unknowns,) * 2), PER_NODE)
        return layout.rows(np.repeat(keyframe, 3), by_pose.reshape(-1, POSE))

    def motion_rows(self, stakes: Stakes, index: IntArray) -> Any:
        """Return the rows (3 N, unknowns) of how far stakes had moved, when they were surveyed, by the ice's motion."""
        motion, shape = self.recording.ice_motion, (3 * len(index), self.n_unknowns)
        if motion is None or stakes.time_s is None:
            return sparse.csr_array(shape)
        moved = motion.derivatives(stakes.position[:, :2], stakes.time_s)[index].reshape(shape[0], -1)
        before = sparse.csr_array((shape[0], PER_NODE * len(self.node_time_s)))
        behind = sparse.csr_array((shape[0], shape[1] - before.shape[1] - moved.shape[1]))
        blocks: Any = [before, sparse.csr_array(moved), behind]
        return sparse.csr_array(sparse.hstack(blocks))

    def between_nodes(self, time_s: FloatArray, config: LocalizationConfig) -> FloatArray:
        """Return the covariance (3 N, 3 N) of the path's error at some times beyond its interpolation between nodes.

        The random error of the steps is a Brownian bridge in all directions, that of their scale one along the way.
        """
        nodes, travel = (
            self.node_time_s,
            np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(self.dead_reckoned, axis=0), axis=1))],
        )
        at, ends = np.interp(time_s, self._times, travel), np.interp(nodes, self._times, travel)
        index = np.clip(np.searchsorted(nodes, time_s, side="right") - 1, 0, len(nodes) - 2)
        since, length = at - ends[index], np.maximum(np.diff(ends)[index], 1e-9)
        bridge = np.minimum.outer(since, since) - np.outer(since, since) / length
        bridge *= index[:, None] == index
        ahead = rotations(self._attitude(time_s))[:, :, 0]
        wander = 2.0 * config.scale_wander_m * config.scale_wander_sigma**2
        along = np.einsum("ij,ia,jb->iajb", wander * bridge, ahead, ahead).reshape(3 * len(at), 3 * len(at))
        covariance: FloatArray = np.kron(config.step_sigma_m**2 * bridge, np.eye(3)) + along
        return covariance

    def _attitude(self, time_s: FloatArray) -> FloatArray:
        odometry = self.recording.odometry
        index = np.clip(np.searchsorted(odometry.time_s, time_s), 0, len(odometry.time_s) - 1)
        before: IntArray = np.maximum(index - 1, 0)
        nearer = np.abs(odometry.time_s[before] - time_s) < np.abs(odometry.time_s[index] - time_s)
        attitude: FloatArray = odometry.attitude_rad[np.where(nearer, before, index)]
        return attitude

    @property
    def _times(self) -> FloatArray:
        return self.recording.odometry.time_s


def pose_jacobian(arm: FloatArray, attitude_rad: FloatArray) -> FloatArray:
    """Return the derivatives (M, 3, 6) of places at arms (M, 3) from poses by position, yaw, pitch and roll."""
    by_yaw, by_pitch = turned(arm, attitude_rad[:, 2])
    by_roll = np.cross(rotations(attitude_rad)[:, :, 0], arm)
    identity = np.broadcast_to(np.eye(3), (len(arm), 3, 3))
    return np.concatenate([identity, np.stack([by_yaw, by_pitch, by_roll], axis=2)], axis=2)


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
    constraints = gate_constraints(
        _constraints_of_ties(drives, drives.path, paths, ties), drives.path, at_rest, gate
    )
    return _updated_drives(drives, drives.path, constraints) if len(constraints) else drives


def _updated_drives(drives: SeveralDrives, error: PathError, constraints: PoseConstraints) -> SeveralDrives:
    """Return the drives after a measurement of the errors of their paths."""
    weighted = np.linalg.solve(constraints.noise, constraints.rows.toarray())
    added = sparse.csr_array(constraints.rows.T @ sparse.csr_array(weighted))
    tied = replace(error, information=sparse.csr_array(error.information + 0.5 * (added + added.T)))
    found = tied.solve(weighted.T @ constraints.value)
    shift = found[: len(tied) * tied.n_states].reshape(len(tied), tied.n_states)[:, :3]
    return drives._replace(points=_moved_landmarks(drives.points, tied, found), path=tied, shift=shift)


def _constraints_of_ties(
    drives: SeveralDrives, error: PathError, paths: Sequence[Trajectory], ties: DriveTies
) -> PoseConstraints:
    """Return the equations of ties for the errors of the paths."""
    first, second = ties.first.astype(np.int64), ties.second.astype(np.int64)
    moved = _positions_at(paths, second, ties.second_s) - _positions_at(paths, first, ties.time_s)
    by_second = np.tile(np.eye(3, POSE), (len(ties), 1, 1))
    by_first = by_second.copy()
    by_first[:, :, 3] = np.cross([0.0, 0.0, 1.0], ties.offset)
    rows = _keyframe_rows(error, _keyframes(drives, second, ties.second_s), by_second)
    rows = rows - _keyframe_rows(error, _keyframes(drives, first, ties.time_s), by_first)
    noise = np.asarray(sparse.block_diag(list(ties.covariance)).toarray())
    return PoseConstraints(sparse.csr_array(rows), (moved - ties.offset).ravel(), noise)


def _keyframes(drives: SeveralDrives, drive: IntArray, time_s: FloatArray) -> FloatArray:
    """Return places among the keyframes of all drives, from times on the clock of each drive."""
    counts = np.cumsum([0, *(len(times) for times in drives.time_s)])
    found = np.empty(len(drive))
    for k, times in enumerate(drives.time_s):
        found[drive == k] = counts[k] + np.interp(time_s[drive == k], times, np.arange(len(times)))
    return found


def _keyframe_rows(error: PathError, keyframe: FloatArray, by_pose: FloatArray) -> sparse.csr_array:
    """Return three rows for each keyframe, from derivatives (N, 3, 6) by its pose."""
    rows: sparse.csr_array = error.rows(np.repeat(keyframe, 3), by_pose.reshape(-1, POSE))
    return rows


def _positions_at(paths: Sequence[Trajectory], drive: IntArray, time_s: FloatArray) -> FloatArray:
    """Return the estimated positions (N, 3) [m] of drives at times."""
    found = np.empty((len(drive), 3))
    for k, path in enumerate(paths):
        here = drive == k
        for axis in range(3):
            found[here, axis] = np.interp(time_s[here], path.time_s, path.position[:, axis])
    return found


def _moved_landmarks(points: SurfacePoints, error: PathError, estimate: FloatArray) -> SurfacePoints:
    """Return landmarks less the estimated errors of their poses, with the covariance that is left."""
    keyframe, body, heading_rad = points.keyframe, points.body, points.heading_rad
    if points.own_covariance is None or keyframe is None or body is None or heading_rad is None:
        raise InputError("the points do not name the keyframes that they were seen from; localize again.")
    level = np.zeros_like(heading_rad)
    jacobian = pose_jacobian(points.xyz - body, np.column_stack([level, level, heading_rad]))
    shared = jacobian @ error.pose_covariance(keyframe) @ jacobian.transpose(0, 2, 1)
    shift = (_keyframe_rows(error, keyframe, jacobian) @ estimate).reshape(-1, 3)
    places = np.tile(np.eye(3, POSE), (len(points), 1, 1))
    body_shift = (_keyframe_rows(error, keyframe, places) @ estimate).reshape(-1, 3)
    return replace(
        points,
        xyz=points.xyz - shift,
        covariance=points.own_covariance + 0.5 * (shared + shared.transpose(0, 2, 1)),
        body=body - body_shift,
        origins=None if points.origins is None else points.origins - body_shift,
    )

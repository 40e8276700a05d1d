"""Global bundle adjustment: poses, points and lens of a complete drive, with their covariance.

`GlobalAdjustment` minimizes the pixel errors of all tracks, with wheels and gyro between keyframes, by Levenberg-Marquardt. Points
have an inverse depth in the frame of the first camera that saw them (Civera et al. 2008), so that a ridge at infinity holds the
heading and nothing else. They are eliminated by the Schur complement, which is banded: tracks are short beside a drive.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded
from scipy.spatial.transform import Rotation

from survey import Camera
from survey.core import BoolArray, FloatArray, IntArray, stream
from vision_slam.config import VisualOdometryConfig
from vision_slam.motion import RelativeMotion
from vision_slam.odometry.adjustment_kernels import (
    add_observations,
    add_scores,
    eliminate_points,
    seen_from_anchors,
)
from vision_slam.odometry.landmarks import EndedTrack
from vision_slam.odometry.tracks import Track

_LEAST_DEPTH = 1e-3
_OUTLYING = 2.5  # standard deviations, of Cauchy's loss
_MEDIAN_SQUARE = 2.0 * np.log(2.0)  # of two errors of standard deviation 1
_BEHIND = 1e4  # squared error of a point behind the camera
_HELD_INFORMATION = 1e10  # of the first pose, of the unit of length, and of what the prior excludes
_SMALLEST = 1e-9
_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-6, 1e-9, 1e6
# Largest step of a pose, as a share of the path, at which the adjustment ends; and where only the error of a pixel is asked for.
_ENOUGH, _ROUGHLY = 2e-4, 5e-3
_N_ITERATIONS = 30
_EXTREME = np.array([0.7, 2.0, 2.0])
_UNKNOWN_TURN_RAD, _UNKNOWN_TRAVEL = 0.2, 3.0
_SIGNIFICANT = 2.0  # standard deviations of an inverse depth
_N_DRAWN = 200  # errors; a standard deviation is known to 5 %
# Corners creep together, which independent pixel errors do not describe: lenses of two drives with cameras of one make
# differ by so many of their formal standard deviations. The prior of the lens counts as much more beside them.
_CORRELATED = 5.0
_LEAST_SIGHTS, _MOST_SIGHTS, _MOST_OBSERVATIONS = (
    3,
    60,
    250,
)  # of a track, which is cut into parts; of one keyframe
_FIRST_GATE_PX, _FIRST_GATE = 20.0, 4.0  # of a track's largest residual, in pixels or over the median one
_LEAST_TRACKS = 50


class LensChange(NamedTuple):
    """Logarithm of the factor of the focal length, and changes of the first two radial coefficients."""

    log_focal: float = 0.0
    k1: float = 0.0
    k2: float = 0.0

    def applied(self, camera: Camera) -> Camera:
        """Return the camera with this change of its lens."""
        matrix, distortion = camera.matrix.copy(), camera.distortion.copy()
        matrix[[0, 1], [0, 1]] *= np.exp(self.log_focal)
        distortion[:2] += [self.k1, self.k2]
        return replace(camera, matrix=matrix, distortion=distortion)


UNCHANGED = LensChange()


class TrackPixels(NamedTuple):
    """Pixels (N, 2) of tracks, sorted by track and keyframe: keyframe (N,) of each, and the first row of each track (J + 1,)."""

    keyframe: IntArray
    pixel: FloatArray
    first: IntArray

    def select(self, chosen: IntArray) -> "TrackPixels":
        """Return some of the tracks."""
        counts = np.diff(self.first)[chosen]
        rows = np.repeat(self.first[chosen] - np.r_[0, np.cumsum(counts)[:-1]], counts) + np.arange(
            counts.sum()
        )
        return TrackPixels(self.keyframe[rows], self.pixel[rows], np.r_[0, np.cumsum(counts)])


class Geometry(NamedTuple):
    """Camera poses (K, 4, 4), points (J, 3) and the lens.

    A point is where its ray meets z = 1 in the frame of the camera that saw it first, and its inverse depth there.
    """

    poses: FloatArray
    points: FloatArray
    lens: LensChange


class MotionFactors(NamedTuple):
    """Turns (K - 1, 3, 3) and steps (K - 1, 3) of the body between keyframes with standard deviations (K - 1, 3), in the earlier body frame."""

    turn: FloatArray
    step: FloatArray
    turn_sigma_rad: FloatArray
    step_sigma_m: FloatArray
    have_scale: bool

    @classmethod
    def of(
        cls, bodies: FloatArray, motions: Sequence[RelativeMotion], config: VisualOdometryConfig
    ) -> "MotionFactors":
        """Return the measured motions; what no sensor measured is that between the poses (K, 4, 4), and almost free."""
        relative = np.linalg.inv(bodies[:-1]) @ bodies[1:]
        turn, step = relative[:, :3, :3].copy(), relative[:, :3, 3].copy()
        turn_sigma, step_sigma = (
            np.full((len(step), 3), _UNKNOWN_TURN_RAD),
            np.full((len(step), 3), _UNKNOWN_TRAVEL),
        )
        for k, motion in enumerate(motions):
            if motion.rotation is not None:
                turn[k] = motion.rotation
                turn_sigma[k] = motion.turn_sigma_rad(float(np.radians(config.gyro_sigma_deg)))
            if motion.travel_m is not None:
                half = Rotation.from_rotvec(0.5 * Rotation.from_matrix(turn[k]).as_rotvec())
                step[k] = half.apply([motion.travel_m, 0.0, 0.0])
                travel = abs(motion.travel_m)
                along, aside = config.wheel_sigma * travel + 0.002, config.lateral_sigma * travel + 0.005
                step_sigma[k] = [along, aside, aside]
        have_scale = any(motion.travel_m is not None for motion in motions)
        return cls(turn, step, turn_sigma, step_sigma, have_scale)


class Adjusted(NamedTuple):
    """Result of an adjustment; ``cost`` is twice the negative logarithm of the likelihood."""

    geometry: Geometry
    cost: float


class _Equations(NamedTuple):
    band: FloatArray
    pose_lens: FloatArray
    lens: FloatArray
    g_pose: FloatArray
    g_lens: FloatArray
    own: FloatArray
    g_own: FloatArray
    lens_point: FloatArray
    pose_point: FloatArray
    g_of_pose: FloatArray
    g_of_lens: FloatArray


class _Factor(NamedTuple):
    """Cholesky factor of the poses' band, its solution for the columns of the lens, what is left of these, and gradients."""

    band: FloatArray
    of_lens: FloatArray
    lens: FloatArray
    inverse: FloatArray
    g_pose: FloatArray
    g_lens: FloatArray


class GlobalAdjustment:
    r"""Bundle adjustment of all keyframes of a drive.

    With camera poses (R_k, t_k), and track j seen first by camera a along d_j with inverse depth ρ_j, it minimizes by
    Levenberg-Marquardt

    .. math:: Σ γ(|u_{kj} − π(R_k^T (R_a d_j + ρ_j (t_a − t_k)); f, k_1, k_2)|² / σ²) + Σ |turn|² / σ_g² + Σ γ(step² / σ_w²) + |c|² / σ_c²

    with Cauchy's loss γ, the turns by gyro and steps by wheels where they measured, and the prior of the lens c. The first pose
    is held, and without wheels the unit of length.

    `camera`: calibration that the lens is relative to. `seen`: pixels of the tracks. `pixel_sigma`: error of a pixel [pixels].
    `prior_sigma` (3,): prior errors of log f, k1 and k2; 0 holds a parameter. `motions`: motion by wheels and gyro.
    """

    def __init__(
        self,
        camera: Camera,
        seen: TrackPixels,
        pixel_sigma: float,
        prior_sigma: FloatArray,
        motions: MotionFactors,
    ) -> None:
        self._camera, self._seen, self._sigma = camera, seen, pixel_sigma
        self._track = np.repeat(np.arange(len(seen.first) - 1), np.diff(seen.first))
        self._is_free = prior_sigma > 0.0
        sigma = np.maximum(prior_sigma / _CORRELATED, _SMALLEST)
        self._prior = np.where(self._is_free, sigma**-2.0, _HELD_INFORMATION)
        self._motions = motions
        mount = camera.T_body_camera
        self._turn = mount[:3, :3]
        self._lever = -mount[:3, :3].T @ mount[:3, 3]
        spans = (
            seen.keyframe[seen.first[1:] - 1] - seen.keyframe[seen.first[:-1]] if len(seen.first) > 1 else [1]
        )
        self._n_band = int(max(np.max(spans), 2))

    def solve(self, start: Geometry, n_iterations: int = _N_ITERATIONS, enough: float = _ENOUGH) -> Adjusted:
        """Adjust from initial poses, points and lens, until no pose moves by more than a share of the path."""
        state, damping = start, _DAMPING
        costs, rest = self.costs(state), self._other_cost(state)
        length = np.linalg.norm(np.diff(start.poses[:, :3, 3], axis=0), axis=1).sum()
        n, moved = 0, np.inf
        while n < n_iterations and moved > enough and damping < _MOST_DAMPING:
            equations, n = self._linearized(state), n + 1
            while damping < _MOST_DAMPING:
                trial = self._moved(state, equations, damping)
                if trial is not None:
                    trial, trial_costs = self._better_points(trial, state)
                    trial_rest = self._other_cost(trial)
                    if trial_costs.sum() + trial_rest < costs.sum() + rest:
                        break
                damping *= 10.0
            else:
                break
            moved = np.linalg.norm(trial.poses[:, :3, 3] - state.poses[:, :3, 3], axis=1).max() / max(
                length, _SMALLEST
            )
            state, costs, rest, damping = trial, trial_costs, trial_rest, max(0.1 * damping, _LEAST_DAMPING)
        return Adjusted(state, float(costs.sum() + rest))

    def _better_points(self, trial: Geometry, before: Geometry) -> tuple[Geometry, FloatArray]:
        """Keep the points of before where those of the trial fit worse: one bad track shall not stop the others."""
        still = trial._replace(points=before.points)
        costs, still_costs = self.costs(trial), self.costs(still)
        worse = still_costs < costs
        points = np.where(worse[:, None], before.points, trial.points)
        return trial._replace(points=points), np.minimum(costs, still_costs)

    def pixel_error(self, state: Geometry) -> float:
        """Return the standard deviation of a pixel by the median of the residuals [pixels]."""
        return float(self._sigma * np.sqrt(np.median(self._squares(state)) / _MEDIAN_SQUARE))

    def costs(self, state: Geometry) -> FloatArray:
        """Return the robust cost of each track (J,)."""
        loss = _OUTLYING**2 * np.log1p(self._squares(state) / _OUTLYING**2)
        costs: FloatArray = np.bincount(self._track, loss, minlength=len(state.points)).astype(np.float64)
        return costs

    def with_points(self, state: Geometry, n_iterations: int = 8) -> Geometry:
        """Adjust the points alone."""
        damping = np.full(len(state.points), 1e-3)
        costs = self.costs(state)
        for _ in range(n_iterations):
            equations = self._linearized(state)
            own = equations.own.copy()
            every = np.arange(3)
            own[:, every, every] *= 1.0 + damping[:, None]
            own[:, every, every] += _SMALLEST
            points = state.points + np.linalg.solve(own, equations.g_own[..., None])[..., 0]
            trial = state._replace(points=points)
            trial_costs = self.costs(trial)
            better = trial_costs < costs
            state = state._replace(points=np.where(better[:, None], points, state.points))
            costs = np.where(better, trial_costs, costs)
            damping = np.where(better, 0.2 * damping, 8.0 * damping)
        return state

    def _local(self, state: Geometry) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return the points in their cameras (N, 3), how these change with inverse depth (N, 3), and which lie ahead."""
        local, by_depth = seen_from_anchors(state.poses, state.points, self._seen.first, self._seen.keyframe)
        ahead = local[:, 2] > _LEAST_DEPTH
        local[~ahead] = [0.0, 0.0, 1.0]
        return local, by_depth, ahead

    def _squares(self, state: Geometry) -> FloatArray:
        local, _, ahead = self._local(state)
        off = (self._seen.pixel - state.lens.applied(self._camera).project(local)) / self._sigma
        return np.where(ahead, (off**2).sum(axis=1), _BEHIND)

    def _other_cost(self, state: Geometry) -> float:
        turn_off, step_off = self._motion_errors(state)
        motions = (turn_off**2).sum() + _OUTLYING**2 * np.log1p(step_off**2 / _OUTLYING**2).sum()
        return float(motions + (self._prior * np.array(state.lens) ** 2).sum())

    def _bodies(self, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations and positions of the body."""
        return poses[:, :3, :3] @ self._turn.T, poses[:, :3, 3] + poses[:, :3, :3] @ self._lever

    def _motion_errors(self, state: Geometry) -> tuple[FloatArray, FloatArray]:
        """Return the errors of turns and steps (K - 1, 3) over their standard deviations."""
        turn, place = self._bodies(state.poses)
        relative = turn[:-1].transpose(0, 2, 1) @ turn[1:]
        step = np.einsum("kji,kj->ki", turn[:-1], np.diff(place, axis=0))
        off = Rotation.from_matrix(self._motions.turn.transpose(0, 2, 1) @ relative).as_rotvec()
        return off / self._motions.turn_sigma_rad, (step - self._motions.step) / self._motions.step_sigma_m

    def _linearized(self, state: Geometry) -> _Equations:
        local, by_depth, ahead = self._local(state)
        pixel, by_local, by_lens = _projected(state.lens.applied(self._camera), local)
        by_lens = by_lens * self._is_free
        error = self._seen.pixel - pixel
        weight = ahead / (self._sigma**2 + (error**2).sum(axis=1) / _OUTLYING**2)
        n = 6 * len(state.poses)
        band = np.zeros((n, 6 * self._n_band + 6))
        pose_lens, lens, g_pose, g_lens = np.zeros((n, 3)), np.diag(self._prior), np.zeros(n), np.zeros(3)
        g_lens -= self._prior * np.array(state.lens)
        parts = add_observations(
            state.poses, state.points, self._seen.first, self._seen.keyframe, weight, error, by_local, by_lens,
            local, by_depth, band, pose_lens, lens, g_pose, g_lens,
        )  # fmt: skip
        self._add_motions(band, g_pose, state)
        self._hold(band, state)
        return _Equations(band, pose_lens, lens, g_pose, g_lens, *parts)

    def _add_motions(self, band: FloatArray, g_pose: FloatArray, state: Geometry) -> None:
        """Add turns by gyro and steps by wheels, these with the weight that Cauchy's loss leaves them."""
        off, slope, weight = self._motion_equations(state)
        n = len(slope)
        blocks = np.einsum("kri,kr,krj->kij", slope, weight, slope)
        gradient = -np.einsum("kri,kr,kr->ki", slope, weight, off)
        for row in range(12):
            g_pose[row : row + 6 * n : 6] += gradient[:, row]
            for column in range(row + 1):
                band[column : column + 6 * n : 6, row - column] += blocks[:, row, column]

    def _motion_equations(self, state: Geometry) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return errors of turns and steps (K - 1, 6) in standard deviations, their slopes by both poses (K - 1, 6, 12) and weights."""
        turn_off, step_off = self._motion_errors(state)
        turn, place = self._bodies(state.poses)
        relative = turn[:-1].transpose(0, 2, 1) @ turn[1:]
        back = turn[:-1].transpose(0, 2, 1)
        step = np.einsum("kij,kj->ki", back, np.diff(place, axis=0))
        slope = np.zeros((len(step), 6, 12))
        slope[:, :3, 0:3] = -relative.transpose(0, 2, 1) @ self._turn
        slope[:, :3, 6:9] = self._turn
        swing = _skew(self._lever[None])[0]
        slope[:, 3:, 0:3] = _skew(step) @ self._turn + back @ state.poses[:-1, :3, :3] @ swing
        slope[:, 3:, 3:6] = -back
        slope[:, 3:, 6:9] = -back @ state.poses[1:, :3, :3] @ swing
        slope[:, 3:, 9:12] = back
        slope /= np.hstack([self._motions.turn_sigma_rad, self._motions.step_sigma_m])[..., None]
        weight = np.hstack([np.ones_like(turn_off), 1.0 / (1.0 + (step_off / _OUTLYING) ** 2)])
        return np.hstack([turn_off, step_off]), slope, weight

    def _hold(self, band: FloatArray, state: Geometry) -> None:
        """Hold the first pose, and without wheels the distance from it to the farthest keyframe of the first tracks."""
        band[np.arange(6), 0] += _HELD_INFORMATION
        if self._motions.have_scale:
            return
        away = state.poses[1 : self._n_band, :3, 3] - state.poses[0, :3, 3]
        k = int(np.argmax(np.linalg.norm(away, axis=1)))
        slope = away[k] / max(float(np.linalg.norm(away[k])), _SMALLEST)
        for p in range(3):
            for q in range(p + 1):
                band[6 * (k + 1) + 3 + q, p - q] += 1e8 * slope[p] * slope[q]

    def _moved(self, state: Geometry, equations: _Equations, damping: float) -> Geometry | None:
        """Return the geometry after one damped step; None where rounding errors leave no solution."""
        factor = self._factorized(equations, damping)
        if factor is None:
            return None
        lens_step = np.linalg.solve(factor.lens, factor.g_lens - factor.of_lens.T @ factor.g_pose)
        step = (
            cho_solve_banded((factor.band, True), factor.g_pose, check_finite=False)
            - factor.of_lens @ lens_step
        )
        pull = np.einsum("npr,np->nr", equations.pose_point, step.reshape(-1, 6)[self._seen.keyframe])
        pull = np.add.reduceat(pull, self._seen.first[:-1], axis=0) + np.einsum(
            "jpr,p->jr", equations.lens_point, lens_step
        )
        shift = np.einsum("jik,jk->ji", factor.inverse, equations.g_own - pull)
        poses = _moved_chain(state.poses, step.reshape(-1, 6))
        lens = LensChange(*np.clip(np.array(state.lens) + lens_step, -_EXTREME, _EXTREME).tolist())
        return Geometry(poses, _moved_points(state.points, shift), lens)

    def _factorized(self, equations: _Equations, damping: float) -> _Factor | None:
        """Eliminate the points and factorize the band of the poses; None where that is not positive definite."""
        own, every = equations.own.copy(), np.arange(3)
        own[:, every, every] = (1.0 + damping) * own[:, every, every] + _SMALLEST
        inverse = np.ascontiguousarray(np.linalg.inv(own))
        band, pose_lens, lens = equations.band.copy(), equations.pose_lens.copy(), equations.lens.copy()
        g_pose, g_lens = equations.g_pose.copy(), equations.g_lens.copy()
        eliminate_points(
            self._seen.first, self._seen.keyframe, inverse, equations.g_own, equations.lens_point,
            equations.pose_point, band, pose_lens, lens, g_pose, g_lens,
        )  # fmt: skip
        band[:, 0] *= 1.0 + damping
        band[:, 0] += _SMALLEST
        lens[every, every] *= 1.0 + damping
        try:
            chol = cholesky_banded(band.T, lower=True, check_finite=False)
        except LinAlgError:
            return None
        of_lens = cho_solve_banded((chol, True), pose_lens, check_finite=False)
        return _Factor(chol, of_lens, lens - pose_lens.T @ of_lens, inverse, g_pose, g_lens)

    def errors(self, state: Geometry) -> tuple[FloatArray, FloatArray]:
        r"""Draw errors of poses (S, K, 6), rotation and translation, and of the lens (S, 3), by tracks, motions and the prior of the lens.

        Errors of one track are correlated: a corner creeps while it is followed. With the gradient s_j of track j, signs
        ε_j = ±1 drawn for each of them, and the matrix H of the normal equations,

        .. math:: δ = H^{-1} Σ_j ε_j s_j

        has the covariance :math:`H^{-1} Σ_j s_j s_j^T H^{-1}`, which is right whatever the correlation within a track (Liang and
        Zeger 1986). Turns, steps and the prior of the lens add errors of their own standard deviations: where images do not show
        a step, as in a turn on the spot, it is as uncertain as nothing else says.
        """
        state = self._with_far_points(state)
        equations = self._linearized(state)
        factor = self._factorized(equations, 0.0)
        if factor is None:
            raise LinAlgError("the normal equations of the adjustment are singular.")
        random = stream(0, "tracks")
        sign = np.where(random.random((len(state.points), _N_DRAWN)) < 0.5, -1.0, 1.0)
        drawn = np.zeros((len(equations.g_pose) + 3, _N_DRAWN))
        add_scores(
            self._seen.first, self._seen.keyframe, factor.inverse, equations.g_own, equations.lens_point,
            equations.pose_point, equations.g_of_pose, equations.g_of_lens, sign, drawn,
        )  # fmt: skip
        drawn[:-3] += self._drawn_motions(state, random)
        by_prior = random.standard_normal((3, _N_DRAWN)) * np.sqrt(self._prior)[:, None]
        drawn[-3:] += _CORRELATED * by_prior * self._is_free[:, None]
        lens = np.linalg.solve(factor.lens, drawn[-3:] - factor.of_lens.T @ drawn[:-3])
        poses = cho_solve_banded((factor.band, True), drawn[:-3], check_finite=False) - factor.of_lens @ lens
        by_draw: FloatArray = np.asarray(poses, dtype=np.float64).T.reshape(_N_DRAWN, -1, 6)
        return by_draw, np.asarray(lens, dtype=np.float64).T

    def _with_far_points(self, state: Geometry) -> Geometry:
        """Return the geometry with points at infinity whose inverse depth is not significantly above 0.

        Their noise would otherwise count as parallax, by which a step seems to be known.
        """
        sigma = np.sqrt(np.linalg.inv(self._linearized(state).own + _SMALLEST * np.eye(3))[:, 2, 2])
        points = state.points.copy()
        points[points[:, 2] < _SIGNIFICANT * sigma, 2] = 0.0
        return state._replace(points=points)

    def _drawn_motions(self, state: Geometry, random: np.random.Generator) -> FloatArray:
        """Return the gradient by the poses (6 K, S) of drawn errors of turns and steps."""
        _, slope, weight = self._motion_equations(state)
        errors = weight[..., None] * random.standard_normal((*weight.shape, _N_DRAWN))
        gradient = slope.transpose(0, 2, 1) @ errors
        drawn = np.zeros((len(state.poses), 6, _N_DRAWN))
        drawn[:-1] += gradient[:, :6]
        drawn[1:] += gradient[:, 6:]
        return drawn.reshape(-1, _N_DRAWN)


def _moved_points(points: FloatArray, shift: FloatArray) -> FloatArray:
    """Return points (J, 3) after a step: linear in the depth where that changes by little, so that a change of scale is exact."""
    moved = points + shift
    share = shift[:, 2] / np.where(points[:, 2] == 0.0, np.inf, points[:, 2])
    is_small = np.abs(share) < 0.3
    moved[is_small, 2] = points[is_small, 2] / (1.0 - share[is_small])
    return moved


def _moved_chain(poses: FloatArray, moves: FloatArray) -> FloatArray:
    """Return poses (K, 4, 4) whose motions from one to the next change as small moves (K, 6) change them.

    To first order this is to move each pose by itself. A large bend of the path leaves neighbours consistent, so that the
    adjustment takes long steps.
    """
    turns, shifts = moves[:, :3], moves[:, 3:]
    relative = np.linalg.inv(poses[:-1]) @ poses[1:]
    back = relative[:, :3, :3].transpose(0, 2, 1)
    turn = turns[1:] - np.einsum("kij,kj->ki", back, turns[:-1])
    shift = np.einsum("kji,kj->ki", poses[:-1, :3, :3], np.diff(shifts, axis=0))
    relative[:, :3, 3] += shift - np.cross(turns[:-1], relative[:, :3, 3])
    relative[:, :3, :3] = relative[:, :3, :3] @ Rotation.from_rotvec(turn).as_matrix()
    moved = poses.copy()
    moved[0, :3, :3] = poses[0, :3, :3] @ Rotation.from_rotvec(turns[0]).as_matrix()
    moved[0, :3, 3] += shifts[0]
    for k, step in enumerate(relative):
        moved[k + 1] = moved[k] @ step
    return moved


def _projected(camera: Camera, local: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return pixels (N, 2) of points, and how they change with the points (N, 2, 3) and the lens (N, 2, 3)."""
    zero, points = np.zeros(3), np.ascontiguousarray(local[:, None])
    if camera.model == "fisheye":
        found = cv2.fisheye.projectPoints(points, zero, zero, camera.matrix, camera.distortion)
        by_point, by_focal, by_radial = (slice(first, first + n) for first, n in ((11, 3), (0, 2), (4, 2)))
    else:
        found = cv2.projectPoints(points, zero, zero, camera.matrix, camera.distortion)
        by_point, by_focal, by_radial = (slice(first, first + n) for first, n in ((3, 3), (6, 2), (10, 2)))
    pixel = np.asarray(found[0], dtype=np.float64).reshape(-1, 2)
    slopes = np.asarray(found[1], dtype=np.float64).reshape(len(local), 2, -1)
    focal = slopes[:, :, by_focal] @ np.diag(camera.matrix)[:2, None]
    by_lens = np.concatenate([focal, slopes[:, :, by_radial]], axis=2)
    return pixel, np.ascontiguousarray(slopes[:, :, by_point]), by_lens


def triangulated(poses: FloatArray, rays: FloatArray, seen: TrackPixels) -> FloatArray:
    """Return the points (J, 3) of tracks with rays (N, 3) by least squares of the inverse depth."""
    anchor, track = (
        seen.keyframe[seen.first[:-1]],
        np.repeat(np.arange(len(seen.first) - 1), np.diff(seen.first)),
    )
    first = rays[seen.first[:-1]]
    plane = first / first[:, 2:]
    turned = np.einsum("jab,jb->ja", poses[anchor, :3, :3], plane)[track]
    back = poses[seen.keyframe, :3, :3]
    a = np.einsum("nba,nb->na", back, turned)
    b = np.einsum("nba,nb->na", back, poses[anchor, :3, 3][track] - poses[seen.keyframe, :3, 3])
    a -= (a * rays).sum(axis=1)[:, None] * rays
    b -= (b * rays).sum(axis=1)[:, None] * rays
    n = len(first)
    top, size = np.bincount(track, (a * b).sum(axis=1), n), np.bincount(track, (b * b).sum(axis=1), n)
    points = plane.copy()
    points[:, 2] = -top / np.maximum(size, 1e-12)
    return points


class DriveTracks(NamedTuple):
    """Tracks of a drive with first guesses: calibration, camera poses (K, 4, 4), pixels and points (J, 3)."""

    camera: Camera
    poses: FloatArray
    seen: TrackPixels
    points: FloatArray

    @classmethod
    def of(cls, camera: Camera, bodies: FloatArray, tracks: Sequence[Track | EndedTrack]) -> "DriveTracks":
        """Return the longest tracks, cut into parts, that poses (K, 4, 4) of the body fit at all."""
        eyes, parts = bodies @ camera.T_body_camera, list[tuple[IntArray, FloatArray]]()
        for track in tracks:
            for first in range(0, len(track.rays), _MOST_SIGHTS):
                part = slice(first, first + _MOST_SIGHTS)
                parts.append((np.asarray(track.keyframes[part]), np.asarray(track.rays[part])))
        parts = _longest(parts, len(eyes))
        counts = [len(keyframe) for keyframe, _ in parts]
        none = (np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
        keyframe, rays = (np.concatenate(part) for part in zip(none, *parts, strict=True))
        seen = TrackPixels(keyframe, camera.project(rays), np.r_[0, np.cumsum(counts, dtype=np.int64)])
        points = triangulated(eyes, rays, seen)
        local, _ = seen_from_anchors(eyes, points, seen.first, seen.keyframe)
        off = np.linalg.norm(camera.project(local) - seen.pixel, axis=1)
        off[(local[:, 2] <= _LEAST_DEPTH) | ~np.isfinite(off)] = np.inf
        worst = np.maximum.reduceat(off, seen.first[:-1]) if len(points) else np.zeros(0)
        usual = float(np.median(worst[np.isfinite(worst)])) if np.isfinite(worst).any() else 0.0
        fits = np.flatnonzero(worst < max(_FIRST_GATE_PX, _FIRST_GATE * usual))
        return cls(camera, eyes, seen.select(fits), points[fits])

    def geometry(self, lens: LensChange) -> Geometry:
        """Return the first guess under a lens."""
        return Geometry(self.poses, self.points, lens)


def _longest(parts: list[tuple[IntArray, FloatArray]], n_keyframes: int) -> list[tuple[IntArray, FloatArray]]:
    """Return the longest tracks, until most of their keyframes have enough observations."""
    count, chosen = np.zeros(n_keyframes), []
    for index in sorted(range(len(parts)), key=lambda index: -len(parts[index][0])):
        seen_by = parts[index][0]
        if len(seen_by) >= _LEAST_SIGHTS and (count[seen_by] < _MOST_OBSERVATIONS).mean() > 0.5:
            count[seen_by] += 1
            chosen.append(index)
    return [parts[index] for index in sorted(chosen)]


class AdjustedPath(NamedTuple):
    """Adjusted poses of the body (K, 4, 4), covariances of the positions (K, 3, 3) relative to the first, lens and its covariance (3, 3)."""

    poses: FloatArray
    covariance: FloatArray
    lens: LensChange
    lens_covariance: FloatArray

    @classmethod
    def of(cls, adjustment: GlobalAdjustment, found: Geometry, camera: Camera) -> "AdjustedPath":
        """Return the path of an adjusted geometry with its covariance."""
        errors, lens = adjustment.errors(found)
        back: FloatArray = np.asarray(np.linalg.inv(camera.T_body_camera), dtype=np.float64)
        swing = found.poses[:, :3, :3] @ _skew(back[None, :3, 3])
        moved = errors[:, :, 3:] - np.einsum("kij,skj->ski", swing, errors[:, :, :3])
        covariance = np.einsum("ski,skj->kij", moved, moved) / len(moved)
        return cls(found.poses @ back, covariance, found.lens, lens.T @ lens / len(lens))


def adjusted_path(
    camera: Camera,
    poses: FloatArray,
    tracks: Sequence[Track | EndedTrack],
    motions: Sequence[RelativeMotion],
    config: VisualOdometryConfig,
) -> AdjustedPath | None:
    """Adjust the poses of the body (K, 4, 4) under a known lens; None where corners are too few."""
    drive = DriveTracks.of(camera, poses, tracks)
    if len(drive.points) < _LEAST_TRACKS:
        return None
    factors = MotionFactors.of(poses, motions, config)
    first = GlobalAdjustment(camera, drive.seen, config.pixel_sigma, np.zeros(3), factors)
    start = first.solve(drive.geometry(UNCHANGED), enough=_ROUGHLY).geometry
    adjustment = GlobalAdjustment(camera, drive.seen, first.pixel_error(start), np.zeros(3), factors)
    return AdjustedPath.of(adjustment, adjustment.solve(start).geometry, camera)


def _skew(vectors: FloatArray) -> FloatArray:
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)

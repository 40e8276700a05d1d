"""Bundle adjustment: a fixed-lag window of the newest keyframes, and a batch over all of them with the lens.

`Window` estimates the newest poses at each keyframe by GTSAM's smart projection factors, with motion factors of wheels and
gyro; older poses are held. `BundleAdjustment` estimates all poses, points and the lens by Levenberg-Marquardt with the
points eliminated by the Schur complement. Cauchy's loss is that of the wheels in the window, and of all errors in the batch.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import cv2
import gtsam
import numpy as np
import scipy.sparse as sp
from gtsam.symbol_shorthand import X
from scipy.linalg import cho_factor, cho_solve

from survey import Camera
from survey.core import BoolArray, FloatArray, IntArray
from vision_slam.config import VisualOdometryConfig
from vision_slam.motion import RelativeMotion
from vision_slam.odometry.tracks import Track

_HELD_SIGMA = 1e-5
_UNKNOWN_TURN_RAD, _UNKNOWN_TRAVEL_M = 0.2, 3.0
_LEVEL = -0.04  # sine of elevation: from 0.7 m above level ground, what lies 17 m off
_FREE_SIGMA = 1e3
_SLIP_SIGMAS = 3.0  # wheels that disagree by more are down-weighted: they slip
_LEAP_PX = 10.0
_MOVED_SIGMAS = 4.0
_DIRECTION_KEYFRAMES = 30  # over which a direction at infinity must stay
_FAR_M = 400.0  # a point so far away moves by less than 0.1° within a window


@dataclass(frozen=True)
class _Between:
    """Motion factors of wheels and gyro between two keyframes."""

    pose: Any
    noises: tuple[Any, ...]


class Window:
    r"""Poses of all keyframes, of which the newest are estimated again at each keyframe.

    With T the free poses, the sum

    .. math:: Σ_j min_{x_j} Σ_k |u_{kj} − π(T_k, x_j)|² / σ² + Σ_k |turn|² / (σ_g² Δt + σ_b² Δt²) + ρ(along² / σ_w²) + ρ(|aside|² / σ_a²)

    is minimized by Levenberg-Marquardt; σ_b is the standard deviation of the gyro's bias. Each
    corner j is one smart factor: its point x_j is eliminated before the poses are solved for,
    and becomes a direction where no motion in the window moves it, so that a far ridge holds
    the heading and nothing else. That is for corners near the horizon only: ground that shows
    no parallax, as in a turn on the spot, is near all the same, and taken for a mountain it
    would bend the turn. A corner whose direction changed by more than four standard deviations
    is no direction either: façades and cars beside a street reach above the horizon. Turn,
    along and aside are the parts of log(M_k⁻¹ T_k⁻¹ T_{k+1}), with M the motion by gyro and
    wheels; the loss ρ is Cauchy's, because wheels slip. Each part has a loss of its own: a bump
    of the ground must not silence the wheels, or the scale drifts.

    Poses before the free ones are held, with every so many older ones as anchors, so that
    a mountain that was seen a hundred metres ago still bears on today's heading. What has
    been held is not questioned any more: uncertainty does not leave the window.
    """

    def __init__(self, camera: Camera, config: VisualOdometryConfig) -> None:
        self.poses: list[FloatArray] = []
        self.pixel_sigma = config.pixel_sigma
        self._between: list[_Between] = []
        self._config = config
        self._body_camera = camera.T_body_camera
        self._sensor = gtsam.Pose3(camera.T_body_camera)
        self._focal_px = 0.5 * (camera.matrix[0, 0] + camera.matrix[1, 1])
        self._lens = gtsam.Cal3_S2(1.0, 1.0, 0.0, 0.0, 0.0)
        self._may_be_far = _smart_params(gtsam.DegeneracyMode.HANDLE_INFINITY)
        self._is_ground = _smart_params(gtsam.DegeneracyMode.ZERO_ON_DEGENERACY)
        # A corner that jumps, of noise or of the rover's own shadow, is no point at all. No narrower
        # than this: what is left out costs nothing, and poses would bend until much is left out.
        self._is_ground.setDynamicOutlierRejectionThreshold(_LEAP_PX / self._focal_px)
        self._optimizer = gtsam.LevenbergMarquardtParams()
        self._optimizer.setMaxIterations(3)
        self._optimizer.setRelativeErrorTol(1e-2)

    def begin(self, pose: FloatArray) -> None:
        """Add the first keyframe, whose pose is held."""
        self.poses.append(pose)

    def add(self, pose: FloatArray, motion: RelativeMotion) -> None:
        """Add a keyframe with a first guess of its pose, and the measured motion from the one before."""
        self._between.append(self._constraint(pose, motion))
        self.poses.append(pose)

    @property
    def newest(self) -> int:
        """Index of the newest keyframe."""
        return len(self.poses) - 1

    def solve(self, tracks: list[Track]) -> list[bool]:
        """Optimize the newest poses and the points of the tracks; return which tracks are inliers."""
        free, held = self._split()
        keys = {k: X(k) for k in (*held, *free)}
        graph, values = self._posed(free, held)
        is_level = self._level(tracks)
        factors = [self._smart(track, keys, level) for track, level in zip(tracks, is_level, strict=True)]
        for factor in factors:
            if factor is not None:
                graph.add(factor)
        solved = self._optimized(graph, values)
        for k in free:
            self.poses[k] = solved.atPose3(keys[k]).matrix()
        level_tracks = []
        for track, factor, level in zip(tracks, factors, self._level(tracks), strict=True):
            if factor is not None and not self._take_point(track, factor.point(solved)) and level:
                level_tracks.append(track)
        self._take_directions(level_tracks)
        return self._agree(tracks, [factor is not None for factor in factors])

    def _optimized(self, graph: Any, values: Any) -> Any:
        """Return the most likely poses; the first guesses where a direction lies behind a camera that saw it."""
        try:
            return gtsam.LevenbergMarquardtOptimizer(graph, values, self._optimizer).optimize()
        except RuntimeError as error:
            if "Cheirality" not in str(error):
                raise
            return values

    def _posed(self, free: list[int], held: list[int]) -> tuple[Any, Any]:
        """Return the graph of the motion factors, and initial values of the poses."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for k in (*held, *free):
            values.insert(X(k), gtsam.Pose3(self.poses[k]))
        still = gtsam.noiseModel.Isotropic.Sigma(6, _HELD_SIGMA)
        for k in held:
            graph.add(gtsam.PriorFactorPose3(X(k), values.atPose3(X(k)), still))
        for k in free:
            between = self._between[k - 1]
            for noise in between.noises:
                graph.add(gtsam.BetweenFactorPose3(X(k - 1), X(k), between.pose, noise))
        return graph, values

    def _split(self) -> tuple[list[int], list[int]]:
        config = self._config
        first_free = max(1, self.newest - config.n_free + 1)
        first_held = max(0, first_free - config.n_held)
        anchors = [k for k in range(first_held - 1, -1, -1) if k % config.anchor_every == 0]
        held = sorted(anchors[: config.n_anchors]) + list(range(first_held, first_free))
        return list(range(first_free, self.newest + 1)), held

    def _smart(self, track: Track, keys: dict[int, int], is_level: bool) -> Any:
        """Return the factor of one corner, None where fewer than two keyframes of the window saw it."""
        sights = [
            (keys[k], plane) for k, plane in zip(track.keyframes, track.planes, strict=True) if k in keys
        ]
        if len(sights) < 2:
            return None
        # A pixel off the axis spans a larger piece of the plane z = 1: by 1/cos² along, 1/cos across.
        sigma = self.pixel_sigma / self._focal_px / track.rays[-1][2] ** 1.5
        params = self._may_be_far if is_level and not track.has_moved else self._is_ground
        factor = gtsam.SmartProjectionPoseFactorCal3_S2(
            gtsam.noiseModel.Isotropic.Sigma(2, sigma), self._lens, self._sensor, params
        )
        for key, plane in sights:
            factor.add(plane, key)
        return factor

    def _recent_turns(self) -> FloatArray:
        """Return the rotations (N, 3, 3) of the camera at the newest keyframes."""
        poses = np.array(self.poses[-_DIRECTION_KEYFRAMES - 1 :])
        turns: FloatArray = poses[:, :3, :3] @ self._body_camera[:3, :3]
        return turns

    def _take_point(self, track: Track, result: Any) -> bool:
        """Keep the track's point; return whether it has one."""
        is_valid = bool(result.valid())
        track.is_far, track.point = False, np.asarray(result.get()) if is_valid else None
        return is_valid

    def _take_directions(self, tracks: list[Track]) -> None:
        """Keep the directions of tracks that are level and did not move."""
        if not tracks:
            return
        turns = self._recent_turns()
        keyframes = [np.array(track.keyframes) - (len(self.poses) - len(turns)) for track in tracks]
        counts = [int((numbers >= 0).sum()) for numbers in keyframes]
        rays = np.concatenate([track.rays[-n:] for track, n in zip(tracks, counts, strict=True)])
        recent = np.concatenate([numbers[-n:] for numbers, n in zip(keyframes, counts, strict=True)])
        directions = np.einsum("nij,nj->ni", turns[recent], rays)
        first = np.r_[0, np.cumsum(counts)[:-1]]
        moved = np.linalg.norm(directions - np.repeat(directions[first], counts, axis=0), axis=1)
        most = np.maximum.reduceat(moved, first)
        limit = _MOVED_SIGMAS * self.pixel_sigma / self._focal_px
        for track, direction, shift in zip(tracks, directions[first], most, strict=True):
            track.has_moved = bool(shift > limit)
            if not track.has_moved:
                track.point, track.is_far = direction, True

    def _agree(self, tracks: list[Track], was_used: list[bool]) -> list[bool]:
        """Return whether the newest sight of each track lies where its point is; unknown points do not object."""
        rotation, place = self._camera_pose(self.newest)
        rays = np.array([track.rays[-1] for track in tracks])
        judged = np.array(was_used) & [track.point is not None for track in tracks]
        points = np.array(
            [ray if track.point is None else track.point for track, ray in zip(tracks, rays, strict=True)]
        )
        is_far = np.array([track.is_far for track in tracks])
        seen = np.where(is_far[:, None], points, points - place) @ rotation
        expected = seen / np.linalg.norm(seen, axis=1, keepdims=True)
        is_near = np.linalg.norm(expected - rays, axis=1) < self._config.gate_px / self._focal_px
        agree: list[bool] = (is_near | ~judged).tolist()
        return agree

    def _level(self, tracks: list[Track]) -> list[bool]:
        """Return whether each track lies so near the horizon, or above, that it may be a mountain."""
        rotation, _ = self._camera_pose(self.newest)
        level: list[bool] = (np.array([track.rays[-1] for track in tracks]) @ rotation[2] > _LEVEL).tolist()
        return level

    def _camera_pose(self, k: int) -> tuple[FloatArray, FloatArray]:
        pose = self.poses[k] @ self._body_camera
        return pose[:3, :3], pose[:3, 3]

    def _constraint(self, guess: FloatArray, motion: RelativeMotion) -> _Between:
        """Return the factors of the turn by gyro and the travel by wheels; unmeasured parts are almost free."""
        config = self._config
        relative = np.linalg.inv(self.poses[-1]) @ guess
        turn_sigma = np.full(3, _UNKNOWN_TURN_RAD)
        if motion.rotation is not None:
            relative[:3, :3] = motion.rotation
            turn_sigma = np.full(3, motion.turn_sigma_rad(np.radians(config.gyro_sigma_deg)))
        along_m, aside_m = _UNKNOWN_TRAVEL_M, _UNKNOWN_TRAVEL_M
        if motion.travel_m is not None:
            relative[:3, 3] = half_turned(relative[:3, :3]) @ [motion.travel_m, 0.0, 0.0]
            travel = abs(motion.travel_m)
            along_m, aside_m = config.wheel_sigma * travel + 0.002, config.lateral_sigma * travel + 0.005
        free = np.full(3, _FREE_SIGMA)
        turn = gtsam.noiseModel.Diagonal.Sigmas(np.concatenate([turn_sigma, free]))
        along = gtsam.noiseModel.Diagonal.Sigmas(np.array([*free, along_m, _FREE_SIGMA, _FREE_SIGMA]))
        aside = gtsam.noiseModel.Diagonal.Sigmas(np.array([*free, _FREE_SIGMA, aside_m, aside_m]))
        cauchy = gtsam.noiseModel.mEstimator.Cauchy.Create(_SLIP_SIGMAS)
        robust = [gtsam.noiseModel.Robust.Create(cauchy, noise) for noise in (along, aside)]
        return _Between(gtsam.Pose3(relative), (turn, *robust))


def _smart_params(mode: Any) -> Any:
    params = gtsam.SmartProjectionParams(gtsam.LinearizationMode.HESSIAN, mode)
    params.setRankTolerance(1e-3)
    params.setLandmarkDistanceThreshold(_FAR_M)
    return params


def half_turned(rotation: FloatArray) -> FloatArray:
    """Return the mean heading of a turn: a body drives its travel along the chord of the arc."""
    middle = gtsam.Rot3.Expmap(0.5 * gtsam.Rot3.Logmap(gtsam.Rot3(rotation)))
    matrix: FloatArray = middle.matrix()
    return matrix


_LEAST_DEPTH_M = 1e-3
_OUTLYING = 2.5  # standard deviations, of Cauchy's loss
_BEHIND = 1e4  # squared error of a point behind the camera
_HELD_INFORMATION = (
    1e10  # information that holds the first pose, the size of the path, and what the prior excludes
)
_ANY = 1.0  # information per step about poses that see nothing [1/m², 1/rad²]
_SIZE_HELD, _SMALLEST = 1e6, 1e-9
_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-4, 1e-9, 1e6
_ENOUGH = 2e-5  # relative decrease of the cost below which the adjustment ends
_N_ITERATIONS = 50
_EXTREME = np.array([0.7, 2.0, 2.0])


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


class PixelObservations(NamedTuple):
    """Pixels (N, 2) of points, with the keyframe and the number of the point (N,) of each."""

    keyframe: IntArray
    point: IntArray
    pixel: FloatArray


class Travel(NamedTuple):
    """Travel by wheels between neighbouring keyframes (K - 1,) [m], NaN where unknown, and its error."""

    rolled_m: FloatArray
    sigma_m: FloatArray


class Geometry(NamedTuple):
    """Camera poses (K, 4, 4), points (J, 3) and the lens."""

    poses: FloatArray
    points: FloatArray
    lens: LensChange


class Adjusted(NamedTuple):
    """Result of a bundle adjustment.

    ``covariance`` (3, 3) of the lens includes its prior; ``cost`` is twice the negative logarithm of the
    likelihood; ``error_px`` (N,) is the distance of each observation from its point.
    """

    geometry: Geometry
    covariance: FloatArray
    cost: float
    error_px: FloatArray


class _Linear(NamedTuple):
    """Errors (N, 2) with their weights (N,), and how pixels change with pose, lens and point of each."""

    weight: FloatArray
    error: FloatArray
    by_pose: FloatArray
    by_lens: FloatArray
    by_point: FloatArray


class _Equations(NamedTuple):
    """Blocks of the normal equations: poses, lens, points, and what couples them; gradients with the same letters."""

    poses: FloatArray
    pose_lens: FloatArray
    lens: FloatArray
    pose_point: Any
    lens_point: FloatArray
    points: FloatArray
    g_poses: FloatArray
    g_lens: FloatArray
    g_points: FloatArray


class BundleAdjustment:
    r"""Camera poses, points and lens of least squared error over all keyframes.

    Minimizes by Levenberg-Marquardt

    .. math:: Σ ρ(|u_{kj} − π(R_k^T(x_j − t_k); f, k_1, k_2)|² / σ²) + Σ ρ((|t_{k+1} − t_k| − r_k)² / σ_k²) + |c|² / σ_c²

    with Cauchy's loss ρ, the travel by wheels r where they measured, and the prior of the lens c.
    Points are eliminated by the Schur complement. The first pose is held, and without wheels the
    size of the path.

    `camera`: calibration that the lens is relative to. `seen`: pixels of the points. `pixel_sigma`: error of
    a pixel [pixels]. `prior_sigma` (3,): prior errors of log f, k1 and k2; 0 holds a parameter. `travel`:
    travel by wheels.
    """

    def __init__(
        self,
        camera: Camera,
        seen: PixelObservations,
        pixel_sigma: float,
        prior_sigma: FloatArray,
        travel: Travel,
    ) -> None:
        self._camera, self._seen, self._sigma = camera, seen, pixel_sigma
        self._prior = np.where(
            prior_sigma > 0.0, np.maximum(prior_sigma, _SMALLEST) ** -2.0, _HELD_INFORMATION
        )
        self._rolled = np.flatnonzero(np.isfinite(travel.rolled_m))
        self._travel = Travel(*(values[self._rolled] for values in travel))

    def solve(self, start: Geometry, n_iterations: int = _N_ITERATIONS) -> Adjusted:
        """Adjust from initial poses, points and lens."""
        state, cost, damping = start, self._cost(start), _DAMPING
        for _ in range(n_iterations):
            equations, before = self._linearized(state), cost
            while damping < _MOST_DAMPING:
                trial = _moved_geometry(state, equations, damping)
                trial_cost = np.inf if trial is None else self._cost(trial)
                if trial is not None and trial_cost < cost:
                    state, cost, damping = trial, trial_cost, max(0.2 * damping, _LEAST_DAMPING)
                    break
                damping *= 8.0
            if before - cost < _ENOUGH * before:
                break
        error_px = np.sqrt(self._squares(state)[0]) * self._sigma
        return Adjusted(state, _lens_covariance(self._linearized(state)), cost, error_px)

    def _local(self, state: Geometry) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return the rotation of each observation's camera, its point in that frame, and whether it lies ahead."""
        rotation, place = (state.poses[self._seen.keyframe, :3, part] for part in (slice(3), 3))
        local = np.einsum("nji,nj->ni", rotation, state.points[self._seen.point] - place)
        ahead = local[:, 2] > _LEAST_DEPTH_M
        local[~ahead] = [0.0, 0.0, 1.0]
        return rotation, local, ahead

    def _squares(self, state: Geometry) -> tuple[FloatArray, FloatArray]:
        """Return the squared normalized errors of pixels and of wheels."""
        _, local, ahead = self._local(state)
        off = (self._seen.pixel - state.lens.applied(self._camera).project(local)) / self._sigma
        step_m = np.linalg.norm(np.diff(state.poses[:, :3, 3], axis=0), axis=1)[self._rolled]
        rolled = (step_m - self._travel.rolled_m) / self._travel.sigma_m
        return np.where(ahead, (off**2).sum(axis=1), _BEHIND), rolled**2

    def _cost(self, state: Geometry) -> float:
        loss = sum(np.log1p(squares / _OUTLYING**2).sum() for squares in self._squares(state))
        return float(_OUTLYING**2 * loss + (self._prior * np.array(state.lens) ** 2).sum())

    def _linearized(self, state: Geometry) -> _Equations:
        rotation, local, ahead = self._local(state)
        camera = state.lens.applied(self._camera)
        pixel, by_local, by_lens = _projected(camera, local)
        by_lens = by_lens * (self._prior < _HELD_INFORMATION)
        error = self._seen.pixel - pixel
        weight = ahead / (self._sigma**2 + (error**2).sum(axis=1) / _OUTLYING**2)
        by_point = by_local @ rotation.transpose(0, 2, 1)
        by_pose = np.concatenate([by_local @ _skew(local), -by_point], axis=2)
        equations = self._assembled(_Linear(weight, error, by_pose, by_lens, by_point), state)
        self._add_wheels(equations, state.poses)
        self._hold(equations, state)
        return equations

    def _assembled(self, linear: _Linear, state: Geometry) -> _Equations:
        """Sum the blocks of all observations."""
        keyframe, point = self._seen.keyframe, self._seen.point
        n_poses, n_points = len(state.poses), len(state.points)
        weighted_pose, weighted_lens, weighted_point = (
            (linear.weight[:, None, None] * part).transpose(0, 2, 1) for part in linear[2:]
        )
        _, error, by_pose, by_lens, by_point = linear
        blocks = np.zeros((n_poses, 6, n_poses, 6))
        every = np.arange(n_poses)
        blocks[every, :, every, :] = _summed(keyframe, weighted_pose @ by_pose, n_poses)
        return _Equations(
            blocks.reshape(6 * n_poses, 6 * n_poses),
            _summed(keyframe, weighted_pose @ by_lens, n_poses).reshape(-1, 3),
            (weighted_lens @ by_lens).sum(axis=0) + np.diag(self._prior),
            _block_rows(keyframe, point, weighted_pose @ by_point, (n_poses, n_points)),
            _summed(point, weighted_lens @ by_point, n_points).transpose(1, 0, 2).reshape(3, -1),
            _summed(point, weighted_point @ by_point, n_points),
            _summed(keyframe, weighted_pose @ error[:, :, None], n_poses).ravel(),
            (weighted_lens @ error[:, :, None]).sum(axis=0).ravel() - self._prior * np.array(state.lens),
            _summed(point, weighted_point @ error[:, :, None], n_points)[..., 0],
        )

    def _add_wheels(self, equations: _Equations, poses: FloatArray) -> None:
        """Add the travel by wheels, each with the weight that Cauchy's loss leaves it."""
        for k, rolled_m, sigma_m in zip(self._rolled.tolist(), *self._travel, strict=True):
            step = poses[k + 1, :3, 3] - poses[k, :3, 3]
            length_m = max(float(np.linalg.norm(step)), _SMALLEST)
            off = (rolled_m - length_m) / sigma_m
            slope = np.r_[-step, step] / (length_m * sigma_m)
            index = np.r_[6 * k + 3 : 6 * k + 6, 6 * k + 9 : 6 * k + 12]
            weight = 1.0 / (1.0 + (off / _OUTLYING) ** 2)
            equations.poses[np.ix_(index, index)] += weight * np.outer(slope, slope)
            equations.g_poses[index] += weight * off * slope

    def _hold(self, equations: _Equations, state: Geometry) -> None:
        """Hold the first pose, weakly all others, and without wheels the size of the path."""
        first, every = np.arange(6), np.arange(len(equations.poses))
        equations.poses[every, every] += _ANY
        equations.poses[first, first] += _HELD_INFORMATION
        if len(self._rolled):
            return
        place = state.poses[:, :3, 3] - state.poses[0, :3, 3]
        size = np.zeros((len(place), 6))
        size[:, 3:] = place / max(float((place**2).sum()), _SMALLEST)
        equations.poses[...] += _SIZE_HELD * np.outer(size, size)


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
    return pixel, slopes[:, :, by_point], np.concatenate([focal, slopes[:, :, by_radial]], axis=2)


def _moved_geometry(state: Geometry, equations: _Equations, damping: float) -> Geometry | None:
    """Return the geometry after one damped step; None where rounding errors leave no solution."""
    points = equations.points.copy()
    every = np.arange(3)
    points[:, every, every] = (1.0 + damping) * points[:, every, every] + _SMALLEST
    inverse = np.asarray(np.linalg.inv(points), dtype=np.float64)
    reduced, right = _reduced(equations, inverse)
    diagonal = np.arange(len(reduced))
    reduced[diagonal, diagonal] *= 1.0 + damping
    try:
        step = cho_solve(cho_factor(reduced), right)
    except np.linalg.LinAlgError:
        return None
    pull = equations.pose_point.T @ step[:-3] + equations.lens_point.T @ step[-3:]
    shift = np.einsum("jik,jk->ji", inverse, equations.g_points - pull.reshape(-1, 3))
    poses, moves = state.poses.copy(), step[:-3].reshape(-1, 6)
    turns = np.array([gtsam.Rot3.Expmap(turn).matrix() for turn in moves[:, :3]])
    poses[:, :3, :3] = poses[:, :3, :3] @ turns
    poses[:, :3, 3] += moves[:, 3:]
    lens = LensChange(*np.clip(np.array(state.lens) + step[-3:], -_EXTREME, _EXTREME).tolist())
    return Geometry(poses, state.points + shift, lens)


def _reduced(equations: _Equations, inverse: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the Schur complement (6 K + 3, 6 K + 3) of the points, and its right-hand side."""
    n_points = len(inverse)
    solved = sp.bsr_array((inverse, np.arange(n_points), np.arange(n_points + 1)))
    of_pose = equations.pose_point @ solved
    of_lens = np.asarray(solved @ equations.lens_point.T).T
    poses = equations.poses - (of_pose @ equations.pose_point.T).toarray()
    coupled = equations.pose_lens - np.asarray(of_pose @ equations.lens_point.T)
    lens = equations.lens - of_lens @ equations.lens_point.T
    gradient = equations.g_points.ravel()
    right = np.r_[equations.g_poses - of_pose @ gradient, equations.g_lens - of_lens @ gradient]
    return np.block([[poses, coupled], [coupled.T, lens]]), right


def _lens_covariance(equations: _Equations) -> FloatArray:
    """Return the covariance (3, 3) of the lens when poses and points are unknown too; infinite where that is singular."""
    inverse = np.asarray(np.linalg.inv(equations.points + _SMALLEST * np.eye(3)), dtype=np.float64)
    reduced, _ = _reduced(equations, inverse)
    units = np.eye(len(reduced))[:, -3:]
    try:
        covariance: FloatArray = cho_solve(cho_factor(reduced), units)[-3:]
    except np.linalg.LinAlgError:
        return np.diag(np.full(3, np.inf))
    return covariance


def _block_rows(row: IntArray, column: IntArray, blocks: FloatArray, shape: tuple[int, int]) -> Any:
    """Return a sparse matrix of blocks (N, 6, 3), one for each pair of row and column."""
    order = np.lexsort((column, row))
    starts = np.searchsorted(row[order], np.arange(shape[0] + 1))
    size = (6 * shape[0], 3 * shape[1])
    return sp.bsr_array((np.ascontiguousarray(blocks[order]), column[order], starts), shape=size)


def _summed(index: IntArray, values: FloatArray, n: int) -> FloatArray:
    """Sum values (N, ...) of equal index to (n, ...)."""
    flat = values.reshape(len(values), -1)
    sums = sp.csr_array((np.ones(len(index)), (index, np.arange(len(index)))), shape=(n, len(index))) @ flat
    total: FloatArray = np.asarray(sums).reshape(n, *values.shape[1:])
    return total


def _skew(vectors: FloatArray) -> FloatArray:
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)

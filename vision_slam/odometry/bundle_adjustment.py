"""Bundle adjustment in a fixed-lag window of the newest keyframes.

`Window` estimates the newest poses at each keyframe by GTSAM's smart projection factors, with motion factors of wheels and
gyro; older poses are held. Cauchy's loss is that of the wheels.
"""

from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from survey import Camera
from survey.core import FloatArray
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

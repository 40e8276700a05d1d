"""Fixed-lag bundle adjustment: a window of the newest keyframes.

`Window` holds the poses of all keyframes, and estimates the newest ones and the corners that they see at each keyframe;
the least squares are those of `vision_slam.odometry.window_adjustment`.
"""

import numpy as np

from survey import Camera
from survey.core import FloatArray
from vision_slam.config import VisualOdometryConfig
from vision_slam.motion import RelativeMotion
from vision_slam.odometry.tracks import Track
from vision_slam.odometry.window_adjustment import (
    Corners,
    MotionLinks,
    Mount,
    Sights,
    WindowPoses,
    adjusted,
    exp_rotation,
    log_rotation,
)

_UNKNOWN_TURN_RAD, _UNKNOWN_TRAVEL_M = 0.2, 3.0
_SIGNIFICANT = 2.0  # standard deviations
_FAR_M = 200.0  # a corner so far away moves by less than 0.6° within a window


class Window:
    r"""Poses of all keyframes, of which the newest are estimated again at each keyframe.

    With T the free poses and x the corners, the sum

    .. math:: Σ_{kj} ρ(|u_{kj} − π(T_k, x_j)|² / σ²) + Σ_k |turn|² / (σ_g² Δt + σ_b² Δt²) + ρ(along² / σ_w²) + ρ(|aside|² / σ_a²)

    is minimized by Levenberg-Marquardt; σ_b is the standard deviation of the gyro's bias. Each
    corner is a direction and an inverse distance, which may be 0: a far ridge holds the heading and nothing else.
    Turn is that of M_kᵀ R_kᵀ R_{k+1}, with M the turn by gyro; along and aside are the parts of the travel minus that by
    the wheels, along the mean heading of the turn and across. The loss ρ is Cauchy's: corners leap, and wheels slip. Each part of the
    travel has a loss of its own: a bump of the ground must not silence the wheels, or the scale drifts.

    Poses before the free ones are held, with every so many older ones as anchors, so that
    a mountain that was seen a hundred metres ago still bears on today's heading. What has
    been held is not questioned any more: uncertainty does not leave the window.
    """

    def __init__(self, camera: Camera, config: VisualOdometryConfig) -> None:
        self.poses: list[FloatArray] = []
        self.pixel_sigma = config.pixel_sigma
        self._links: list[MotionLinks] = []
        self._config = config
        self._body_camera = camera.T_body_camera
        self._mount = Mount(*(np.ascontiguousarray(camera.T_body_camera[:3, part]) for part in (slice(3), 3)))
        self._focal_px = 0.5 * (camera.matrix[0, 0] + camera.matrix[1, 1])

    def begin(self, pose: FloatArray) -> None:
        """Add the first keyframe, whose pose is held."""
        self.poses.append(pose)

    def add(self, pose: FloatArray, motion: RelativeMotion) -> None:
        """Add a keyframe with a first guess of its pose, and the measured motion from the one before."""
        self._links.append(self._link(pose, motion))
        self.poses.append(pose)

    @property
    def newest(self) -> int:
        """Index of the newest keyframe."""
        return len(self.poses) - 1

    def camera_place(self) -> FloatArray:
        """Return the place of the camera at the newest keyframe."""
        place: FloatArray = (self.poses[-1] @ self._body_camera)[:3, 3]
        return place

    def solve(self, tracks: list[Track]) -> list[bool]:
        """Optimize the newest poses and the corners of the tracks; return which tracks are inliers."""
        free, held = self._split()
        numbers = [*held, *free]
        window = np.array([self.poses[k] for k in numbers])
        poses = WindowPoses(window[:, :3, :3].copy(), window[:, :3, 3].copy(), len(held))
        sights, seen = self._sights(tracks, numbers)
        corners = self._corners([tracks[j] for j in seen])
        links = MotionLinks(
            *(np.array(part) for part in zip(*(self._links[k - 1] for k in free), strict=True))
        )
        poses, corners, sigma = adjusted(poses, self._mount, sights, corners, links)
        for k, rotation, place in zip(
            free, poses.rotation[len(held) :], poses.place[len(held) :], strict=True
        ):
            self.poses[k] = np.eye(4)
            self.poses[k][:3, :3], self.poses[k][:3, 3] = rotation, place
        points = np.column_stack(
            [corners.direction + corners.nearness[:, None] * corners.origin, corners.nearness]
        )
        is_near = corners.nearness > _SIGNIFICANT * sigma
        is_far = corners.nearness + _SIGNIFICANT * sigma < 1.0 / _FAR_M
        found = zip(seen, points, sigma.tolist(), is_near.tolist(), is_far.tolist(), strict=True)
        for j, point, *kept in found:
            track = tracks[j]
            track.homogeneous = point
            track.nearness_sigma, track.is_near, track.is_far = kept
        return self._agree(tracks, seen, points)

    def _split(self) -> tuple[list[int], list[int]]:
        config = self._config
        first_free = max(1, self.newest - config.n_free + 1)
        first_held = max(0, first_free - config.n_held)
        anchors = [k for k in range(first_held - 1, -1, -1) if k % config.anchor_every == 0]
        held = sorted(anchors[: config.n_anchors]) + list(range(first_held, first_free))
        return list(range(first_free, self.newest + 1)), held

    def _sights(self, tracks: list[Track], numbers: list[int]) -> tuple[Sights, list[int]]:
        """Return the observations of corners that two keyframes of the window saw, and which tracks these are."""
        # Corners are seen from one keyframe on in all of them, until they are lost.
        first = np.searchsorted(numbers, [track.keyframes[0] for track in tracks])
        seen = np.flatnonzero(first < len(numbers) - 1).tolist()
        n_anchors = sum(self.newest - number >= len(numbers) - k for k, number in enumerate(numbers))
        rays: list[FloatArray] = []
        for j in seen:
            track, begin, k = tracks[j], tracks[j].keyframes[0], first[j]
            rays += [track.rays[anchor - begin] for anchor in numbers[k:n_anchors]]
            rays += track.rays[numbers[max(k, n_anchors)] - begin :]
        ray = np.concatenate(rays).reshape(-1, 3) if rays else np.zeros((0, 3))
        # A pixel off the axis spans a larger piece of the plane z = 1: by 1/cos² along, 1/cos across.
        weight = ray[:, 2] ** 1.5 * self._focal_px / self.pixel_sigma
        counts = len(numbers) - first[seen]
        start = np.r_[0, np.cumsum(counts)]
        frame = np.arange(start[-1]) - np.repeat(start[1:], counts) + len(numbers)
        return Sights(start, frame, ray[:, :2] / ray[:, 2:], weight), seen

    def _corners(self, tracks: list[Track]) -> Corners:
        """Return the corners from the place of the newest camera."""
        unknown = np.full(4, np.nan)
        points = np.array(
            [unknown if track.homogeneous is None else track.homogeneous for track in tracks]
        ).reshape(-1, 4)
        origin = self.camera_place()
        away = points[:, :3] - points[:, 3:] * origin
        length = np.linalg.norm(away, axis=1)
        return Corners(away / length[:, None], points[:, 3] / length, origin)

    def _agree(self, tracks: list[Track], seen: list[int], points: FloatArray) -> list[bool]:
        """Return whether the newest sight of each track lies where its corner is; unknown corners do not object."""
        camera = self.poses[-1] @ self._body_camera
        expected = (points[:, :3] - points[:, 3:] * camera[:3, 3]) @ camera[:3, :3]
        expected /= np.linalg.norm(expected, axis=1, keepdims=True)
        rays = np.array([tracks[j].rays[-1] for j in seen]).reshape(-1, 3)
        agree = np.ones(len(tracks), dtype=bool)
        agree[seen] = np.linalg.norm(expected - rays, axis=1) < self._config.gate_px / self._focal_px
        listed: list[bool] = agree.tolist()
        return listed

    def _link(self, guess: FloatArray, motion: RelativeMotion) -> MotionLinks:
        """Return the turn by gyro and the travel by wheels; unmeasured parts are almost free."""
        config = self._config
        relative = np.linalg.inv(self.poses[-1]) @ guess
        turn, shift, turn_sigma = relative[:3, :3].copy(), relative[:3, 3].copy(), _UNKNOWN_TURN_RAD
        if motion.rotation is not None:
            turn = motion.rotation
            turn_sigma = motion.turn_sigma_rad(np.radians(config.gyro_sigma_deg))
        along_m, aside_m, ahead = _UNKNOWN_TRAVEL_M, _UNKNOWN_TRAVEL_M, half_turned(turn)
        if motion.travel_m is not None:
            shift = ahead @ [motion.travel_m, 0.0, 0.0]
            travel = abs(motion.travel_m)
            along_m, aside_m = config.wheel_sigma * travel + 0.002, config.lateral_sigma * travel + 0.005
        return MotionLinks(turn, shift, ahead, np.array([turn_sigma, along_m, aside_m]))


def half_turned(rotation: FloatArray) -> FloatArray:
    """Return the mean heading of a turn: a body drives its travel along the chord of the arc."""
    return share_of_turn(rotation, 0.5)


def share_of_turn(rotation: FloatArray, share: float) -> FloatArray:
    """Return the rotation (3, 3) about the same axis by a share of the angle."""
    turned: FloatArray = exp_rotation(
        *(share * part for part in log_rotation(np.ascontiguousarray(rotation)))
    )
    return turned

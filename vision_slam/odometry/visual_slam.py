"""Monocular visual SLAM: tracking, resection and keyframe window, image by image."""

from dataclasses import dataclass, replace

import numpy as np

from survey import Camera
from survey.core import BoolArray, FloatArray, IntArray
from survey.data.frames import Image
from vision_slam.config import VisualOdometryConfig
from vision_slam.motion import RelativeMotion
from vision_slam.odometry.health import FrameHealth, VisionHysteresis, WheelSlipDetector, image_health
from vision_slam.odometry.resection import PixelNoise, ViewRecognizer, resect
from vision_slam.odometry.tracks import (
    ContrastEnhancer,
    CornerDetector,
    Pixels,
    Track,
    epipolar_motion,
    grey_of,
    quadrant_shift_px,
    rotation_between,
    track_corners,
)
from vision_slam.odometry.window import Window, half_turned, share_of_turn

_STILL_PX = 0.3
_ROLLS_M = 0.02
# A turn on the spot puts so many of the corners within so many pixels of their places.
_TURN_PX, _LEAST_TURNED = 1.0, 0.8
_LEAST_FAR = 10
_SURE = 1.5
_FEW_CAME = 0.5  # of the corners; without wheels and gyro the others are then looked for where they were
_STEEP, _LEAST_BELOW = (
    0.1,
    10,
)  # sine of the depression below which points count as ground, and their least number
_SAME_INTERVAL = 0.01  # intervals of images that differ by less count as equal: clocks jitter


@dataclass(frozen=True)
class FramePose:
    """Pose of one frame relative to its keyframe, and its health."""

    time_s: float
    keyframe: int
    relative: FloatArray
    health: FrameHealth


class VisualSlam:
    """Monocular visual SLAM, keyframe by keyframe.

    Poses are relative to `start`. Their scale is that of the wheels; without wheels the first
    step is one unit, and the position of the camera on the body must be zero, since it is in metres.

    `camera`: calibration and mounting. `config`: settings of detection, tracking and the keyframe window.
    `start` (4, 4): pose at the first image, with z up; the identity by default. `ground_height`: first guess
    of the height of the camera above the ground in units of the path, which predicts where new corners go;
    the mounted height by default.
    """

    def __init__(
        self,
        camera: Camera,
        config: VisualOdometryConfig | None = None,
        start: FloatArray | None = None,
        ground_height: float | None = None,
    ) -> None:
        self.config = config or VisualOdometryConfig()
        self.camera = camera
        self.window = Window(camera, self.config)
        self.frames: list[FramePose] = []
        self.finished: list[Track] = []
        self.rolled_m: list[float] = []
        self.motions: list[RelativeMotion] = []
        self.keyframe_turn: tuple[RelativeMotion, FloatArray] | None = None
        """Motion by wheels and gyro, and turn (3, 3) estimated with images, to a keyframe that the last image became."""
        self._tracks: list[Track] = []
        self._enhance = ContrastEnhancer(self.config.clahe_clip, self.config.clahe_tiles)
        self._detect = CornerDetector(self.config)
        self._slip = WheelSlipDetector(camera.T_body_camera[2, 3])
        self._ground_height = ground_height
        self._image: Image | None = None
        self._grey: Image | None = None
        self._pose = np.eye(4) if start is None else start
        self._step, self._step_s = np.eye(4), 0.0
        self._since: RelativeMotion | None = None
        self._has_travelled = self._is_unaided = False
        self._focal_px = 0.5 * (camera.matrix[0, 0] + camera.matrix[1, 1])
        self._noise = PixelNoise(self.config.pixel_sigma)
        self._hysteresis = VisionHysteresis(self.config.n_features)
        self._views = ViewRecognizer(camera, self.config)

    def step(self, image: Image, time_s: float, motion: RelativeMotion | None) -> FramePose:
        """Process the next image.

        `image` (H, W) or (H, W, 3): grey, or blue, green, red. `time_s`: its time [s].
        """
        self.keyframe_turn = None
        grey = grey_of(image, self.camera.width, self.camera.height)
        health = self._health(grey, motion)
        enhanced = self._enhance(grey)
        if self._image is None or motion is None:
            return self._begin(enhanced, time_s, health)
        predicted = self._predict(motion)
        pixels, came = self._track(self._image, enhanced, predicted)
        standing = self._is_standing(motion, pixels, came)
        pose, agree = self._estimate_pose(self._pose if standing else predicted, pixels, came)
        health = self._judge(health, came, agree)
        pose = self._pose if standing else pose if health.is_visual else predicted
        self._retain(pixels, agree if health.is_visual else np.zeros_like(agree), standing)
        since = self._since = _concatenated(self._since, motion)
        self._step, self._step_s = np.linalg.inv(self._pose) @ pose, motion.seconds
        self._views.add_motion(motion)
        self._pose, self._image = pose, enhanced
        recognition = (
            self._views.recognize(enhanced, pose, self.window.poses) if self._may_recognize(health) else None
        )
        if recognition is not None:
            self._pose = recognition.pose
            since = RelativeMotion(since.seconds, None, None)  # the wheels shall not undo it
            health = replace(health, n_followed=0, n_inliers=recognition.n_agree, is_visual=True)
        if recognition is not None or self._needs_keyframe(pose):
            self._add_keyframe(enhanced, health, since)
        return self._report(time_s, health)

    @property
    def live_tracks(self) -> list[Track]:
        """Tracks that are still followed."""
        return self._tracks

    @property
    def holds_heading(self) -> bool:
        """Whether enough far features are in view to bound the heading drift."""
        return sum(track.is_far for track in self._tracks) >= _LEAST_FAR

    def pose(self, frame: FramePose) -> FloatArray:
        """Return the current estimate of the pose of the body at a frame.

        Returns (4, 4): body to the frame of `start`.
        """
        placed: FloatArray = self.window.poses[frame.keyframe] @ frame.relative
        return placed

    def _health(self, grey: Image, motion: RelativeMotion | None) -> FrameHealth:
        """Measure image quality; an image that repeats the last while the wheels roll counts as blank."""
        health = image_health(grey)
        rolls = motion is not None and abs(motion.travel_m or 0.0) > _ROLLS_M
        is_frozen = rolls and self._grey is not None and np.array_equal(grey, self._grey)
        self._grey = grey
        return replace(health, entropy_bits=0.0) if is_frozen else health

    def _begin(self, enhanced: Image, time_s: float, health: FrameHealth) -> FramePose:
        self.window.begin(self._pose)
        self._image = enhanced
        self._replenish(enhanced, health)
        return self._report(time_s, health)

    def _predict(self, motion: RelativeMotion) -> FloatArray:
        """Predict the pose by wheels and gyro; what they do not measure goes on at the rate of the last step."""
        self._is_unaided = motion.rotation is None and motion.travel_m is None
        step = _extrapolated(self._step, motion.seconds / self._step_s if self._step_s > 0.0 else 1.0)
        if motion.rotation is not None:
            step[:3, :3] = motion.rotation
        if motion.travel_m is not None:
            self._has_travelled = True
            step[:3, 3] = half_turned(step[:3, :3]) @ [self._slip.share * motion.travel_m, 0.0, 0.0]
        elif not self._has_travelled:
            step[:3, 3] = [1.0, 0.0, 0.0]
        predicted: FloatArray = self._pose @ step
        return predicted

    def _track(self, before: Image, enhanced: Image, predicted: FloatArray) -> tuple[Pixels, BoolArray]:
        pixels = np.array([track.pixel for track in self._tracks], np.float32).reshape(-1, 2)
        guess = self._projected(predicted, self._guessed_points(pixels))
        lost = ~np.isfinite(guess).all(axis=1) | (np.abs(guess - pixels).max(axis=1, initial=0.0) > 150.0)
        guess[lost] = pixels[lost]
        landed, came = track_corners(before, enhanced, pixels, guess, self.config)
        if self._is_unaided and came.sum() < _FEW_CAME * len(came):
            again = np.flatnonzero(~came & ~lost)
            landed[again], came[again] = track_corners(
                before, enhanced, pixels[again], pixels[again].copy(), self.config
            )
        return landed, came & np.isfinite(self._rays(landed)).all(axis=1)

    def _guessed_points(self, pixels: Pixels) -> FloatArray:
        """Return the points (N, 4) of the tracks; unknown ones are assumed on level ground or far above the horizon."""
        camera = self._pose @ self.camera.T_body_camera
        rays = self._rays(pixels) @ camera[:3, :3].T
        down = -rays @ self._pose[:3, 2]
        mounted = (camera[:3, 3] - self._pose[:3, 3]) @ self._pose[:3, 2]
        height = mounted if self._ground_height is None else self._ground_height
        is_ahead = (down >= 0.02) & (
            height > 0.0
        )  # the height is 0 where the mount of the camera is not known
        nearness = np.divide(down, height, out=np.zeros_like(down), where=is_ahead)
        points = np.column_stack([rays + nearness[:, None] * camera[:3, 3], nearness])
        known = [index for index, track in enumerate(self._tracks) if track.is_near or track.is_far]
        points[known] = np.array([self._tracks[index].homogeneous for index in known]).reshape(-1, 4)
        return points

    def _rays(self, pixels: Pixels) -> FloatArray:
        return self.camera.rays(pixels.astype(np.float64))

    def _projected(self, body: FloatArray, points: FloatArray) -> Pixels:
        camera = body @ self.camera.T_body_camera
        seen = (points[:, :3] - points[:, 3:] * camera[:3, 3]) @ camera[:3, :3]
        return self.camera.project(seen).astype(np.float32)

    def _is_standing(self, motion: RelativeMotion, pixels: Pixels, came: BoolArray) -> bool:
        """Whether the wheels, or without them the corners since the last image that moved, stayed where they were."""
        if motion.travel_m is not None:
            return motion.is_standing
        if came.sum() < self.config.least_inliers:
            return False
        rest = np.array([track.rest_pixel for track in self._tracks])[came]
        return quadrant_shift_px(rest, pixels[came], (self.camera.width, self.camera.height)) < _STILL_PX

    def _estimate_pose(
        self, predicted: FloatArray, pixels: Pixels, came: BoolArray
    ) -> tuple[FloatArray, BoolArray]:
        """Estimate the pose by resection; return also which corners are inliers."""
        agree = came.copy()
        known = np.array([track.homogeneous is not None for track in self._tracks], dtype=bool) & came
        if known.sum() < self.config.least_inliers:
            turned = None if self._has_travelled else self._turned(pixels, came)
            if turned is not None:
                return turned
            self._has_travelled = True
            return self._epipolar(predicted, pixels, agree)
        index = np.flatnonzero(known)
        points = np.array([self._tracks[i].homogeneous for i in index])
        has_gyro = self._since is None or self._since.rotation is not None
        eye = predicted @ self.camera.T_body_camera
        angle_sigma = self._angle_sigma(index, eye[:3, 3])
        camera, errors = resect(
            eye, points, self._rays(pixels[index]), angle_sigma=angle_sigma,
            turn_sigma=0.01 if has_gyro else 0.1,
            shift_sigma=0.1 if has_gyro else 1.0,
        )  # fmt: skip
        pixel_sigma = self._noise.sigma_px / self._focal_px
        agree[index] = errors * pixel_sigma < angle_sigma * self.config.gate_px / self._focal_px
        if not self.camera.distortion_is_assumed:  # else the residuals are those of the lens
            is_sure = angle_sigma < _SURE * pixel_sigma  # others have residuals of their distance
            self._noise.update(self._focal_px * errors[agree[index] & is_sure])
        return camera @ np.linalg.inv(self.camera.T_body_camera), agree

    def _angle_sigma(self, index: IntArray, place: FloatArray) -> FloatArray:
        """Return the error of the directions of tracks (N,) from a place, by their pixels and by their distance [rad]."""
        moved = float(np.linalg.norm(place - self.window.camera_place()))
        sigma = np.array([self._tracks[i].nearness_sigma for i in index])
        error: FloatArray = np.hypot(self._noise.sigma_px / self._focal_px, moved * sigma)
        return error

    def _turned(self, pixels: Pixels, came: BoolArray) -> tuple[FloatArray, BoolArray] | None:
        """Return pose and inliers of a turn on the spot since the keyframe; None where the corners show travel."""
        newest = self.window.newest
        since = came & np.array([track.keyframes[-1] == newest for track in self._tracks], dtype=bool)
        if since.sum() < self.config.least_inliers:
            return None
        before = np.array([track.rays[-1] for track in self._tracks])[since]
        rotation, fits = rotation_between(before, self._rays(pixels[since]), _TURN_PX / self._focal_px)
        if fits.mean() < _LEAST_TURNED:
            return None
        agree = came.copy()
        agree[since] = fits
        mount = self.camera.T_body_camera
        turn = np.eye(4)
        turn[:3, :3] = mount[:3, :3] @ rotation @ mount[:3, :3].T
        return self.window.poses[-1] @ turn, agree

    def _epipolar(
        self, predicted: FloatArray, pixels: Pixels, came: BoolArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return the pose and the epipolar inliers, before any point is known.

        Without wheels and gyro turn and direction of travel are those of the epipolar geometry.
        """
        if came.sum() < self.config.least_inliers:
            return predicted, np.zeros_like(came)
        before = self.camera.rays(np.array([track.pixel for track in self._tracks])[came])
        agree = came.copy()
        step, agree[came] = epipolar_motion(before, self._rays(pixels[came]), 1.0 / self._focal_px)
        if not self._is_unaided or agree.sum() < self.config.least_inliers:
            return predicted, agree
        step[:3, 3] *= np.linalg.norm(predicted[:3, 3] - self._pose[:3, 3])
        mount = self.camera.T_body_camera
        return self._pose @ mount @ step @ np.linalg.inv(mount), agree

    def _judge(self, health: FrameHealth, came: BoolArray, agree: BoolArray) -> FrameHealth:
        config = self.config
        n_followed, n_inliers = int(came.sum()), int(agree.sum())
        is_visual = (
            health.entropy_bits >= config.least_entropy_bits
            and n_inliers >= config.least_inliers
            and n_inliers >= config.least_inlier_ratio * n_followed
            and n_inliers >= config.least_kept_ratio * len(self._tracks)
            and not self._hysteresis.update(n_inliers, self._slip.is_slipping)
        )
        return replace(health, n_followed=n_followed, n_inliers=n_inliers, is_visual=is_visual)

    def _may_recognize(self, health: FrameHealth) -> bool:
        is_clear = health.entropy_bits >= self.config.least_entropy_bits
        return is_clear and not health.is_visual and not self._hysteresis.is_distrusted

    def _retain(self, pixels: Pixels, agree: BoolArray, standing: bool = False) -> None:
        tracks = []
        for track, pixel, is_good in zip(self._tracks, pixels, agree.tolist(), strict=True):
            if is_good:
                track.pixel = pixel
                track.rest_pixel = track.rest_pixel if standing else pixel
                tracks.append(track)
            else:
                self.finished.append(track)
        self._tracks = tracks

    def _needs_keyframe(self, pose: FloatArray) -> bool:
        relative = np.linalg.inv(self.window.poses[-1]) @ pose
        turned = np.arccos(np.clip(0.5 * (np.trace(relative[:3, :3]) - 1.0), -1.0, 1.0))
        return bool(
            np.linalg.norm(relative[:3, 3]) >= self.config.keyframe_spacing_m
            or turned >= np.radians(self.config.keyframe_turn_deg)
        )

    def _add_keyframe(self, enhanced: Image, health: FrameHealth, since: RelativeMotion) -> None:
        rolled = since.travel_m
        self.rolled_m.append(np.nan if rolled is None else rolled)
        if rolled is not None:
            seen = float(np.linalg.norm(self._pose[:3, 3] - self.window.poses[-1][:3, 3]))
            travel_m = self._slip.travel_m(rolled, seen if health.is_visual else None)
            since = replace(since, travel_m=travel_m)
        self.motions.append(since)
        self.window.add(self._pose, since)
        self._since = None
        pixels = np.array([track.pixel for track in self._tracks]).reshape(-1, 2)
        newest = self.window.newest
        for track, ray in zip(self._tracks, self.camera.rays(pixels), strict=True):
            track.add_observation(newest, ray)
        self.window.pixel_sigma = self._noise.sigma_px
        if self._tracks and self._has_travelled:
            self._retain(pixels.astype(np.float32), np.array(self.window.solve(self._tracks)))
            self._pose = self.window.poses[-1]
        self._observe_height()
        if health.is_visual:
            self.keyframe_turn = self._turn_between_keyframes(since)
            self._views.add_view(self.window.newest, enhanced, self.window.poses)
        self._replenish(enhanced, health)

    def _turn_between_keyframes(self, since: RelativeMotion) -> tuple[RelativeMotion, FloatArray] | None:
        """Return the motion since the keyframe before and the turn that the window has; None where it was not solved."""
        before, newest = self.window.poses[-2:]
        return (since, before[:3, :3].T @ newest[:3, :3]) if self._has_travelled else None

    def _observe_height(self) -> None:
        known = np.array([track.homogeneous for track in self._tracks if track.is_near]).reshape(-1, 4)
        points = (known[:, :3] / known[:, 3:] - self._pose[:3, 3]) @ self._pose[:3, :3]
        travel = np.linalg.norm(self._pose[:3, 3] - self.window.poses[-2][:3, 3])
        self._slip.observe(points, float(travel))
        below = -points[-points[:, 2] > _STEEP * np.linalg.norm(points, axis=1), 2]
        if self._ground_height is not None and len(below) >= _LEAST_BELOW:
            self._ground_height = float(np.median(below))

    def _replenish(self, enhanced: Image, health: FrameHealth) -> None:
        n_missing = self.config.n_features - len(self._tracks)
        if n_missing < 0.1 * self.config.n_features or health.entropy_bits < self.config.least_entropy_bits:
            return
        taken = np.array([track.pixel for track in self._tracks], np.float32).reshape(-1, 2)
        fresh = self._detect(enhanced, taken, n_missing)
        for pixel, ray in zip(fresh, self._rays(fresh), strict=True):
            if ray[2] > 0.2:
                self._tracks.append(Track(pixel, [self.window.newest], [ray]))

    def _report(self, time_s: float, health: FrameHealth) -> FramePose:
        relative = np.linalg.inv(self.window.poses[-1]) @ self._pose
        self.frames.append(FramePose(time_s, self.window.newest, relative, health))
        return self.frames[-1]


def _extrapolated(step: FloatArray, ratio: float) -> FloatArray:
    """Return the motion (4, 4) of a step of constant velocity that takes `ratio` times as long."""
    longer: FloatArray = step.copy()
    if abs(ratio - 1.0) > _SAME_INTERVAL:
        longer[:3, :3] = share_of_turn(step[:3, :3], ratio)
        longer[:3, 3] *= ratio
    return longer


def _concatenated(first: RelativeMotion | None, second: RelativeMotion) -> RelativeMotion:
    """One motion after the other."""
    if first is None:
        return second
    rotation = None if first.rotation is None or second.rotation is None else first.rotation @ second.rotation
    travel = None if first.travel_m is None or second.travel_m is None else first.travel_m + second.travel_m
    seconds = first.seconds + second.seconds
    bias = first.bias_sigma_rad_s * first.seconds + second.bias_sigma_rad_s * second.seconds
    return RelativeMotion(seconds, rotation, travel, bias / seconds if seconds > 0.0 else 0.0)

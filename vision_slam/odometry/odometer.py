"""Incremental visual odometry: takes images one by one and corrects the finished drive."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from survey import Camera
from survey.core import BoolArray, DataObject, FloatArray, IntArray
from survey.data.frames import Image
from survey.data.sensors.odometry import Odometry, Sightings
from vision_slam.attitude import initial_pose, rotations, world_attitudes
from vision_slam.config import VisualOdometryConfig
from vision_slam.motion import MotionSensors
from vision_slam.odometry.global_adjustment import UNCHANGED, LensChange, adjusted_path
from vision_slam.odometry.health import IDLE_WHEELS, FrameHealth, bridged_errors, is_lost
from vision_slam.odometry.landmarks import EndedTrack, FarFeatures, LandmarkTriangulator
from vision_slam.odometry.scale_drift import (
    bridge_scale_jumps,
    camera_height_ratio,
    scale_corrections,
    scale_sightings,
    smoothed_steps,
    travel_between,
)
from vision_slam.odometry.self_calibration import LensEstimate, estimate_lens
from vision_slam.odometry.sensor_checks import mounting_note
from vision_slam.odometry.visual_slam import VisualSlam
from vision_slam.readers.sequence import VisionRecords

_LEAST_SIGHTS = 3  # of a track that adjustment and triangulation use
_AT_A_TIME = 500  # tracks that are triangulated
_NO_IMAGES = "the recording has no images: the path is that of wheels, gyro and fixes, as far as it has them"


@dataclass(frozen=True, eq=False, repr=False)
class VisualOdometry(DataObject):
    """Odometry and landmark sightings estimated from images.

    Parameters
    ----------
    odometry : Odometry
        Steps [m] and attitudes. With wheels and a gyro the lengths are corrected by wheels and
        by the height of the camera above the ground; with wheels the heading is corrected by
        far ridges. Without wheels the unit of length is the first step.
    sightings : Sightings
        Landmarks relative to the poses.
    health : tuple of FrameHealth
        One entry per frame.
    is_lost : (N,) ndarray of bool
        Whether the pose rests on wheels and gyro for more than 20 m, or on nothing.
    lens : LensEstimate, optional
        Self-calibration of the lens; None where the lens was used as given.
    lever_arm_m : (3,) ndarray, optional
        Position of the camera on the body [m] where the lengths have no scale. Steps and sightings are
        then those of the camera, in the axes of the body; `scale_visual_odometry` converts them to the
        body. None where they are those of the body.
    ignores_wheels : bool
        Whether the recording has wheels, which were left out because they count nothing while the images move.
    n_repeated : int
        Images that are the same as the one before, byte by byte, and were left out. Wheels say whether
        the camera stands or repeats itself; without wheels the next other image decides.
    adjusted_covariance : (N, 3, 3) ndarray, optional
        Covariances of the positions relative to the first by the global bundle adjustment, in the frame of its first pose; None
        where there was none.
    has_images : bool
        False where the recording has no images, and the odometry is that of wheels and gyro.

    Notes
    -----
    Heading and lengths need the whole drive. The same images give the same bytes, whatever
    the number of threads.
    """

    odometry: Odometry
    sightings: Sightings
    health: tuple[FrameHealth, ...]
    is_lost: BoolArray
    lens: LensEstimate | None = None
    lever_arm_m: FloatArray | None = None
    ignores_wheels: bool = False
    n_repeated: int = 0
    adjusted_covariance: FloatArray | None = None
    has_images: bool = True

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found about the lens, the wheels and repeated images, one sentence each."""
        if not self.has_images:
            return (_NO_IMAGES,)
        lens = () if self.lens is None else (self.lens.note,)
        wheels = (IDLE_WHEELS,) if self.ignores_wheels else ()
        repeated = f"images repeated to the last byte were left out: {self.n_repeated}"
        return (*lens, *wheels, repeated) if self.n_repeated else (*lens, *wheels)

    def mounting_note(self, camera: Camera) -> str | None:
        """Return a note where the landmarks lie on a side of the camera on which its mounting has no ground.

        Parameters
        ----------
        camera : Camera
            Calibration and mounting.

        Returns
        -------
        str or None
            A sentence; none where landmarks and mounting agree, or where too few landmarks show a plane.
        """
        place_m = camera.T_body_camera[:3, 3] if self.lever_arm_m is None else 0.0
        return mounting_note(self.sightings.offset - place_m, camera.T_body_camera)

    @property
    def scale_drift_sigma(self) -> float:
        """Relative drift of scale that a lens of unknown distortion may cause."""
        return 0.0 if self.lens is None else self.lens.scale_sigma


class VisualOdometer:
    """Incremental visual odometry: takes images one by one, with wheels and gyro in between.

    `camera`: calibration and mounting. `records`: records at least up to the first motion of the wheels.
    `config`: settings of detection, tracking and the keyframe window. `start_s`: time of the first image [s].
    """

    def __init__(
        self, camera: Camera, records: VisionRecords, config: VisualOdometryConfig | None, start_s: float
    ) -> None:
        self._lever_arm_m = None if records.wheels is not None else camera.T_body_camera[:3, 3]
        height = None if self._lever_arm_m is None else float(self._lever_arm_m[2])
        camera = camera if self._lever_arm_m is None else _at_origin(camera)
        self.slam = VisualSlam(camera, config, initial_pose(records, start_s), height)
        self.sensors = MotionSensors(records)
        self._blank = np.zeros((camera.height, camera.width), np.uint8)
        self._before_s = start_s
        self._newest: Image | None = None
        self._repeated: list[float] = []
        self._n_repeated = 0
        self._ended: list[EndedTrack] = []

    def add_image(self, image: Image, time_s: float) -> None:
        """Process the next image; the records must reach its time [s].

        `image` (H, W) or (H, W, 3): grey, or blue, green, red. `time_s`: its time [s].
        """
        if self._lever_arm_m is not None and self._is_repeated(image):
            self._repeated.append(time_s)
            return
        self._n_repeated += len(self._repeated)
        self._repeated, self._newest = [], image
        self._follow(image, time_s)

    def _is_repeated(self, image: Image) -> bool:
        """Return whether an image is the same as the one before; blank images are all the same and show nothing."""
        if self._newest is None or not np.array_equal(image, self._newest):
            return False
        return self.slam.frames[-1].health.entropy_bits >= self.slam.config.least_entropy_bits

    def _follow(self, image: Image, time_s: float) -> None:
        """Process an image that is not left out."""
        slam, sensors, before_s = self.slam, self.sensors, self._before_s
        for between_s in sensors.gap(before_s, time_s):
            slam.step(self._blank, between_s, sensors.between(before_s, between_s))
            before_s = between_s
        motion = sensors.between(before_s, time_s) if slam.frames else None
        slam.step(image, time_s, motion)
        self._before_s = time_s
        if slam.keyframe_turn is not None:
            noise = float(np.radians(slam.config.gyro_sigma_deg))
            sensors.learn(*slam.keyframe_turn, noise, has_far_features=slam.holds_heading)
        self._keep_ended()

    def finish(
        self, records: VisionRecords, given: Camera | None = None, used: LensChange = UNCHANGED
    ) -> VisualOdometry:
        """Return the odometry of all images after global bundle adjustment, levelled by the inertial records of the drive.

        `given`: the calibration, where the lens is to be estimated; `used`: how that of the images differs from it.
        """
        slam = self.slam
        if self._newest is not None and self._repeated:  # nothing shows any more that the camera moves
            self._follow(self._newest, self._repeated[-1])
            self._n_repeated += len(self._repeated) - 1
            self._repeated = []
        slam.finished += slam.live_tracks
        self._keep_ended()
        poses, tracks = np.array(slam.window.poses), self._ended
        lens, path, camera = None, None, slam.camera
        if given is not None:
            given = replace(given, T_body_camera=camera.T_body_camera)
            lens, path = estimate_lens(given, poses, tracks, slam.motions, slam.config, used=used)
            tracks = _read_by(lens.camera, used.applied(given), tracks)
            camera = lens.camera
        elif not camera.distortion_is_assumed:
            path = adjusted_path(camera, poses, tracks, slam.motions, slam.config)
        is_adjusted = path is not None and (lens is None or lens.is_accepted)
        drive = _FinishedDrive(
            slam, camera, path.poses if path is not None and is_adjusted else poses, tracks
        )
        found = _corrected(drive, records)
        covariance = None if path is None else path.covariance[drive.keyframe]
        return replace(
            found,
            lens=lens,
            lever_arm_m=self._lever_arm_m,
            n_repeated=self._n_repeated,
            adjusted_covariance=covariance,
        )

    def _keep_ended(self) -> None:
        """Keep the observations of the tracks that ended."""
        self._ended += [
            EndedTrack.of(track) for track in self.slam.finished if len(track.rays) >= _LEAST_SIGHTS
        ]
        self.slam.finished = []


class _FinishedDrive:
    """Keyframe poses (K, 4, 4), frame poses (N, 4, 4) and tracks of a finished drive."""

    def __init__(self, slam: VisualSlam, camera: Camera, poses: FloatArray, tracks: list[EndedTrack]) -> None:
        self.slam, self.camera, self.poses, self.tracks = slam, camera, poses, tracks
        self.keyframe = np.array([frame.keyframe for frame in slam.frames])
        self.time_s = np.array([frame.time_s for frame in slam.frames])

    def frame_poses(self) -> FloatArray:
        """Return the poses of the frames; between keyframes the change by the adjustment is spread over time."""
        before, relative = (
            np.array(self.slam.window.poses),
            np.array([frame.relative for frame in self.slam.frames]),
        )
        placed: FloatArray = self.poses[self.keyframe] @ relative
        if np.array_equal(before, self.poses):
            return placed
        first = np.unique(self.keyframe, return_index=True)[1]
        begin_s = self.time_s[first]
        steps = [np.linalg.inv(poses[:-1]) @ poses[1:] for poses in (before, self.poses)]
        change = np.linalg.inv(steps[0]) @ steps[1]
        at = np.minimum(self.keyframe, len(change) - 1)
        share = (self.time_s - begin_s[at]) / np.maximum(begin_s[at + 1] - begin_s[at], 1e-9)
        share = np.where(self.keyframe < len(change), share, 0.0)
        turn = Rotation.from_rotvec(share[:, None] * Rotation.from_matrix(change[at, :3, :3]).as_rotvec())
        placed[:, :3, 3] += np.einsum("nij,nj->ni", placed[:, :3, :3], share[:, None] * change[at, :3, 3])
        placed[:, :3, :3] = placed[:, :3, :3] @ turn.as_matrix()
        return placed

    def sightings(self) -> Sightings:
        """Triangulate the near tracks."""
        landmarks = LandmarkTriangulator(self.camera, self.slam.config)
        landmarks.pixel_sigma = self.slam.window.pixel_sigma
        first = np.searchsorted(self.keyframe, np.arange(len(self.poses)))
        for start in range(0, len(self.tracks), _AT_A_TIME):
            landmarks.add(self.tracks[start : start + _AT_A_TIME], self.poses, first)
        return landmarks.sightings


def _read_by(camera: Camera, before: Camera, tracks: list[EndedTrack]) -> list[EndedTrack]:
    """Return tracks whose rays are those of their pixels under another lens."""
    if not tracks or camera == before:
        return tracks
    rays = camera.rays(before.project(np.concatenate([track.rays for track in tracks])))
    ends = np.cumsum([len(track.rays) for track in tracks])[:-1]
    return [track._replace(rays=part) for track, part in zip(tracks, np.split(rays, ends), strict=True)]


def _at_origin(camera: Camera) -> Camera:
    """Return the camera at the origin of the body: its position is in metres, which images alone do not have."""
    mount = camera.T_body_camera.copy()
    mount[:3, 3] = 0.0
    return replace(camera, T_body_camera=mount)


def _corrected(drive: _FinishedDrive, records: VisionRecords) -> VisualOdometry:
    """Correct scale drift, level the attitudes and correct the heading by far features."""
    slam, poses, times, sightings = drive.slam, drive.frame_poses(), drive.time_s, drive.sightings()
    factor = _scale_factors(drive, sightings, records)
    steps = np.einsum("nji,nj->ni", poses[:-1, :3, :3], np.diff(poses[:, :3, 3], axis=0))
    steps *= factor[:-1, None]
    health = tuple(frame.health for frame in slam.frames)
    sightings = scale_sightings(sightings, factor)
    attitude = world_attitudes(poses[:, :3, :3], times, records)
    if records.wheels is None:
        steps = smoothed_steps(steps, np.diff(times), np.array([frame.is_visual for frame in health[1:]]))
    else:
        height_m = float(slam.camera.T_body_camera[2, 3])
        rolled_m = travel_between(records.wheels, times)
        steps, sightings, health = bridge_scale_jumps(steps, rolled_m, sightings, health, height_m)
        # The distance of ridges is assumed in metres, which images alone do not have.
        far_features = FarFeatures(drive.camera)
        far_features.add(drive.tracks)
        attitude[:, 2] -= far_features.drift_rad(*_levelled(drive, poses, attitude))
    errors = bridged_errors(
        steps,
        np.diff(times),
        health,
        has_wheels=records.wheels is not None,
        has_gyro=records.inertial is not None,
    )
    odometry = Odometry(times, steps, attitude, step_sigma_m=errors.step_m, turn_sigma_rad=errors.turn_rad)
    lost = is_lost(poses, health, has_wheels=records.wheels is not None)
    return VisualOdometry(odometry, sightings, health, lost)


def _scale_factors(drive: _FinishedDrive, sightings: Sightings, records: VisionRecords) -> FloatArray:
    """Return the factor of scale of each frame (N,)."""
    # Without a gyro the path bends up and down too much to use the height of the camera.
    height_m = 0.0 if records.inertial is None else float(drive.slam.camera.T_body_camera[2, 3])
    ratio = camera_height_ratio(drive.poses, sightings, drive.keyframe[sightings.pose], height_m)
    factor: FloatArray = scale_corrections(drive.poses, np.array(drive.slam.rolled_m), ratio)[drive.keyframe]
    return factor


def _levelled(
    drive: _FinishedDrive, poses: FloatArray, attitude_rad: FloatArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return rotations (K, 3, 3) and positions (K, 3) of the keyframes, levelled, and the keyframe of each frame."""
    _, first, of_frame = np.unique(drive.keyframe, return_index=True, return_inverse=True)
    turned = attitude_rad[first] - [0.0, 0.0, attitude_rad[0, 2]]
    return rotations(turned), poses[first, :3, 3], of_frame

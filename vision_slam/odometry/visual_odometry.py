"""Monocular visual odometry of a recording: images, wheels and gyro to odometry and sightings."""

from dataclasses import replace

import numpy as np

from survey import Camera, InputError
from survey.core import Progress
from survey.data.frames import Frames
from vision_slam.config import VisualOdometryConfig
from vision_slam.odometry.bundle_adjustment import LensChange
from vision_slam.odometry.health import WithoutWheels, wheels_are_idle
from vision_slam.odometry.odometer import VisualOdometer, VisualOdometry
from vision_slam.odometry.self_calibration import estimate_lens, unknown_lens
from vision_slam.odometry.sensor_checks import largest_turns, refuse_other_gyro, refuse_other_travel
from vision_slam.odometry.tracks import Track
from vision_slam.readers.sequence import VisionRecords

_MOVES = 0.1  # share of the images that have to move for wheels that count nothing to be wrong
_MOST_PASSES = 5  # over the images; two suffice unless the lens is off by tens of pixels


def visual_odometry(
    recording: VisionRecords, config: VisualOdometryConfig | None = None, progress: Progress | None = None
) -> VisualOdometry:
    """Estimate motion and landmarks from images, wheels and inertial records.

    Where images are missing for more than 1.5 s and wheels and gyro go on, poses are added in
    between, as of blank images: one step from end to end would cut the corner of a turn.

    Where the setting `lens` asks for it, the lens is estimated after a first pass over all images;
    further passes follow where the images contradict the given lens, until the estimate settles.
    """
    if recording.frames is None or recording.camera is None:
        raise InputError("the recording has no images; visual odometry needs frames and camera.toml.")
    if len(recording.frames) < 2:
        raise InputError("the recording has one frame; motion needs at least two.")
    _refuse_contradictions(recording, recording.frames, recording.camera, config or VisualOdometryConfig())
    if wheels_are_idle(recording):
        without = _estimated(WithoutWheels(recording), recording.frames, recording.camera, config, progress)
        if (np.linalg.norm(without.odometry.step, axis=1) > 0.0).mean() >= _MOVES:
            return replace(without, ignores_wheels=True)
    return _estimated(recording, recording.frames, recording.camera, config, progress)


def _refuse_contradictions(
    recording: VisionRecords, frames: Frames, camera: Camera, config: VisualOdometryConfig
) -> None:
    """Refuse gyro, wheels and mounting that the images' own motion contradicts."""
    if recording.wheels is not None:
        refuse_other_travel(frames, camera, recording.wheels, config)
    if recording.inertial is not None:
        refuse_other_gyro(largest_turns(frames, camera, recording.inertial, config))


def _estimated(
    recording: VisionRecords,
    frames: Frames,
    camera: Camera,
    config: VisualOdometryConfig | None,
    progress: Progress | None,
) -> VisualOdometry:
    """Estimate motion and landmarks, and the lens where the settings ask for it."""
    settings = config or VisualOdometryConfig()
    if settings.lens == "given" and camera.distortion_is_assumed:
        odometer = _followed(recording, frames, camera, settings, progress=progress)
        poses = np.array(odometer.slam.window.poses)
        return replace(odometer.finish(recording), lens=unknown_lens(camera, poses, "it was used as given"))
    if settings.lens == "given" or (settings.lens == "auto" and not camera.distortion_is_assumed):
        return _followed(recording, frames, camera, settings, progress=progress).finish(recording)
    return _self_calibrated(recording, frames, camera, settings, progress)


def _self_calibrated(
    recording: VisionRecords,
    frames: Frames,
    camera: Camera,
    config: VisualOdometryConfig,
    progress: Progress | None,
) -> VisualOdometry:
    """Estimate the lens from a pass over the images, and again from passes with the estimate until it settles.

    Corners far from where the given lens has them are lost in the first pass.
    """
    used, lens = LensChange(), None
    for n in range(_MOST_PASSES):
        ended: list[Track] = []
        odometer = _followed(recording, frames, used.applied(camera), config, progress=progress, ended=ended)
        visual, slam = odometer.finish(recording), odometer.slam
        given = replace(camera, T_body_camera=slam.camera.T_body_camera)
        poses, rolled_m = np.array(slam.window.poses), np.array(slam.rolled_m)
        found = estimate_lens(given, poses, ended, rolled_m, slam.config, used=used)
        has_settled = not found.is_accepted or bool((np.abs(found.lens - used) < found.sigma).all())
        if n and (has_settled or n == _MOST_PASSES - 1):
            break
        lens = replace(found, camera=replace(found.camera, T_body_camera=camera.T_body_camera))
        if not found.is_accepted:
            break
        used = LensChange(*found.lens.tolist())
    return replace(visual, lens=lens)


def _followed(
    recording: VisionRecords,
    frames: Frames,
    camera: Camera,
    config: VisualOdometryConfig,
    *,
    progress: Progress | None,
    ended: list[Track] | None = None,
) -> VisualOdometer:
    """Process all images of a recording; collect the ended tracks where a list is given."""
    times = frames.time_s
    odometer = VisualOdometer(camera, recording, config, times[0])
    odometer.ended = ended
    for index, time_s in enumerate(times.tolist()):
        odometer.add_image(frames[index], time_s)
        if progress is not None:
            progress("frames", index + 1, len(times))
    return odometer

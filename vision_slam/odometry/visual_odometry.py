"""Monocular visual odometry of a recording: images, wheels and gyro to odometry and sightings."""

from dataclasses import replace

import numpy as np

from survey import Camera, InputError
from survey.core import Progress
from survey.data.frames import Frames
from vision_slam.config import VisualOdometryConfig
from vision_slam.odometry.global_adjustment import LensChange
from vision_slam.odometry.health import WithoutWheels, wheels_are_idle
from vision_slam.odometry.odometer import VisualOdometer, VisualOdometry
from vision_slam.odometry.self_calibration import border_px, unknown_lens
from vision_slam.odometry.sensor_checks import largest_turns, refuse_other_gyro, refuse_other_travel
from vision_slam.readers.sequence import VisionRecords

_MOVES = 0.1  # share of the images that have to move for wheels that count nothing to be wrong
_MOST_PASSES = 5  # over the images; one suffices unless the lens is off by many pixels
_SETTLED_PX = 8.0  # at the border; tracks of a lens that is nearer to the estimate lose few corners


def visual_odometry(
    recording: VisionRecords, config: VisualOdometryConfig | None = None, progress: Progress | None = None
) -> VisualOdometry:
    """Estimate motion and landmarks from images, wheels and inertial records.

    Where images are missing for more than 1.5 s and wheels and gyro go on, poses are added in
    between, as of blank images: one step from end to end would cut the corner of a turn.

    At the end poses and points of the complete drive are adjusted together, with the lens where the setting `lens` asks for
    it.
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
    if settings.lens == "refine" or (settings.lens == "auto" and camera.distortion_is_assumed):
        return _self_calibrated(recording, frames, camera, settings, progress)
    odometer = _followed(recording, frames, camera, settings, progress)
    visual = odometer.finish(recording)
    if not camera.distortion_is_assumed:
        return visual
    return replace(
        visual, lens=unknown_lens(camera, np.array(odometer.slam.window.poses), "it was used as given")
    )


def _self_calibrated(
    recording: VisionRecords,
    frames: Frames,
    camera: Camera,
    config: VisualOdometryConfig,
    progress: Progress | None,
) -> VisualOdometry:
    """Estimate the lens with the path.

    Corners far from where a lens has them are lost: where the estimate differs by more than some pixels from the lens that the
    images were read with, they are processed again, until it settles.
    """
    used = LensChange()
    for _ in range(_MOST_PASSES):
        odometer = _followed(recording, frames, used.applied(camera), config, progress)
        visual = odometer.finish(recording, camera, used)
        lens = visual.lens
        if lens is None or not lens.is_accepted:
            break
        found = LensChange(*lens.lens.tolist())
        if border_px(used.applied(camera), found.applied(camera)) < _SETTLED_PX:
            break
        used = found
    return visual


def _followed(
    recording: VisionRecords,
    frames: Frames,
    camera: Camera,
    config: VisualOdometryConfig,
    progress: Progress | None,
) -> VisualOdometer:
    """Process all images of a recording."""
    times = frames.time_s
    odometer = VisualOdometer(camera, recording, config, times[0])
    for index, time_s in enumerate(times.tolist()):
        odometer.add_image(frames[index], time_s)
        if progress is not None:
            progress("frames", index + 1, len(times))
    return odometer

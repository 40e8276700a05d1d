"""Localization pipeline: one list of steps from a recording to a path and landmarks.

`localize` runs visual odometry, the steps that bring odometry and fixes into agreement
(`vision_slam.agreement.steps.STEPS`), and the batch smoother. Without images wheels and gyro are the odometry. On moving ice it repeats them in the frame of the ice at an
epoch, and estimates the motion of the ice with the path. A recording with neither is a kinematic GPS
survey. `localize_images` is for images without fixes, whose path is that of visual odometry.
"""

from dataclasses import replace

import numpy as np

from survey import Recording
from survey.core import FloatArray, Progress, check_types
from survey.data.ice_motion import IceMotion
from survey.reconstruction.motion.epoch import in_ice_frame
from survey.reconstruction.motion.stakes import motion_with_stakes
from vision_slam.agreement.drive import Drive, check_images, measure_motion, process_images
from vision_slam.agreement.steps import STEPS, note_delay
from vision_slam.config import LocalizationConfig, VisualOdometryConfig
from vision_slam.drive_estimate import DriveEstimate, Localization
from vision_slam.fusion.online import adjusted_covariance, predicted_covariance
from vision_slam.fusion.smoother import SmoothedPath, ground_of_path, place_landmarks, smooth
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.wheel_odometry import wheel_odometry
from vision_slam.photographs.localization import (
    are_far_apart,
    localize_photographs,
    photographs_without_fixes,
)
from vision_slam.readers.sequence import ImageSequence, MotionRecords

_UNIT_SCALE_SIGMA = 1e-6
"""Error of a scale that is the unit of the path."""
# On moving ice, checks of start, gates and memory of the fixes take the motion for exact: they are repeated about the motion
# that was found where this moves a fix by more than this share of its claimed error.
_CLOSE = 0.1
_MOST_PASSES = 4


@check_types
def localize(
    recording: Recording,
    config: LocalizationConfig | None = None,
    *,
    visual: VisualOdometry | None = None,
    visual_config: VisualOdometryConfig | None = None,
    motion: IceMotion | None = None,
    progress: Progress | None = None,
) -> Localization:
    """Estimate the path of a rover and its landmarks from a recording.

    Images are processed to odometry and sightings first, where the recording has no
    odometry. Without wheels the scale of the images is that of the fixes. Start, delay and
    outliers of the fixes are then checked, loop closures are added, and path and landmarks
    are smoothed. Without images the odometry is that of wheels and gyro, and the ground below the
    path takes the place of landmarks. A recording with fixes alone is a kinematic GPS survey: the
    fixes are the path, and the surface is the ground below the antenna.

    With the prior motion of the ice this is repeated in the frame of the ice at its epoch, and the
    motion is estimated with the path.

    Parameters
    ----------
    recording : Recording
        Records of one drive.
    config : LocalizationConfig, optional
        Errors assumed of the sensors.
    visual : VisualOdometry, optional
        Visual odometry of the images of this recording; computed where left out.
    visual_config : VisualOdometryConfig, optional
        Settings of visual odometry where it is computed.
    motion : IceMotion, optional
        Prior of the motion of the ice, with the epoch; the recording is in fixed coordinates, and repeated surveys of
        stakes count as measurements of the motion.
    progress : callable, optional
        Progress callback (stage, done, total) of the images.

    Returns
    -------
    Localization
        Path, landmarks, causal path, visual odometry and notes; with a motion those of the epoch, and
        `Localization.ice_motion`. A place of the path at its own time is that of the epoch plus
        `IceMotion.displacement`.

    Raises
    ------
    InputError
        Sightings are missing, no landmark passes the gates, the images cannot be followed,
        or, without wheels, the fixes spread over less than 20 m.

    Examples
    --------
    >>> from survey.data.sensors.records import GpsFixes
    >>> times = np.arange(3.0)
    >>> place = np.column_stack([times, np.zeros(3), np.zeros(3)]) + [5e5, 6e6, 100.0]
    >>> survey = Recording("EPSG:32608", place[0], GpsFixes(times, place), antenna_height_m=1.5)
    >>> localize(survey).points.xyz[:, 2].tolist()
    [98.5, 98.5, 98.5]
    """
    settings = config or LocalizationConfig()
    if visual is None and recording.odometry is None:
        if recording.frames is not None:
            visual = process_images(recording, visual_config, progress)
            if motion is None and are_far_apart(recording, visual):
                found = localize_photographs(recording, settings, visual, progress)
                if found is not None:
                    return found
        elif recording.wheels is not None:
            visual = wheel_odometry(recording, recording.gps)
    if motion is not None:
        return _localize_on_ice(recording, settings, visual, motion)
    return _localize_on_ground(recording, settings, visual)


def _localize_on_ground(
    recording: Recording, config: LocalizationConfig, visual: VisualOdometry | None
) -> Localization:
    """Measure the motion, bring odometry and fixes into agreement step by step, and smooth; the ground stands still."""
    if recording.odometry is None and visual is None:
        return Localization.of_fixes(recording, config)
    drive = measure_motion(recording, config, visual)
    for step in STEPS:
        drive = step(drive)
    path = smooth(drive.recording, drive.path, drive.config)
    return _result_of(note_delay(drive, path), path)


def _result_of(drive: Drive, path: SmoothedPath) -> Localization:
    """Return smoothed poses and landmarks, and the causal path of the drive with all its fixes."""
    before = drive.with_all_fixes
    trajectory, is_lost = path.trajectory(drive.recording), before.is_contradicted
    if drive.visual is not None:
        is_lost = is_lost | drive.visual.is_lost
    if drive.visual is not None or is_lost.any():
        trajectory = replace(trajectory, health=1.0 - is_lost)
    has_landmarks = drive.visual is None or drive.has_images
    return Localization(
        trajectory,
        place_landmarks(drive.recording, path, drive.config)
        if has_landmarks
        else ground_of_path(drive.recording, path),
        before.online.trajectory(before.recording),
        drive.visual if drive.has_images else None,
        n_fixes=before.online.n_fixes,
        n_fixes_refused=before.online.n_fixes - int(before.used_fixes.sum()),
        notes=drive.notes,
        ice_motion=path.ice_motion,
        landmarks_hold=not drive.follows_fixes,
    )


def _localize_on_ice(
    recording: Recording, config: LocalizationConfig, visual: VisualOdometry | None, motion: IceMotion
) -> Localization:
    """Localize in the frame of the ice, about the motion that was found before, until that moves no fix."""
    if recording.stake_surveys is not None:
        motion = motion_with_stakes(motion, recording.stake_surveys)
    about = motion.about(motion.expected)
    for _ in range(_MOST_PASSES):
        found = _localize_on_ground(in_ice_frame(recording, about), config, visual)
        if found.ice_motion is None:
            break
        if _most_moved_m(about, found.ice_motion, recording) < _CLOSE * config.fix_sigma_m:
            break
        about = about.about(_unknowns(about, found.ice_motion))
    return found


def _unknowns(about: IceMotion, found: IceMotion) -> FloatArray:
    """Return the unknowns (R,) that lead from one estimate to another with the same modes."""
    apart = (found.coefficients - about.coefficients).ravel()
    return np.asarray(np.linalg.lstsq(about.modes, apart)[0], dtype=np.float64)


def _most_moved_m(about: IceMotion, found: IceMotion, recording: Recording) -> float:
    """Return how far the motion that was found moves a fix from where it was taken to be, at most [m]."""
    ends = recording.gps.time_s[[0, -1]]
    places = recording.gps.position[[0, -1], :2]
    apart = found.displacement(places, ends) - about.displacement(places, ends)
    return float(np.abs(apart).max())


def localize_images(
    images: ImageSequence | MotionRecords,
    config: LocalizationConfig | None = None,
    *,
    visual_config: VisualOdometryConfig | None = None,
    progress: Progress | None = None,
) -> DriveEstimate:
    """Estimate path and landmarks of images, or the path of wheels, without fixes, in the frame of the first pose."""
    if images.frames is None:
        return _localize_wheels(images, config or LocalizationConfig())
    visual = process_images(images, visual_config, progress)
    if are_far_apart(images, visual):
        placed = photographs_without_fixes(images, visual, progress)
        if placed is not None:
            return placed
    has_wheels = images.wheels is not None and not visual.ignores_wheels
    check_images(visual, has_wheels=has_wheels)
    settings = config or LocalizationConfig()
    errors = settings.with_image_errors(visual.scale_drift_sigma)
    # Without wheels the scale is the unit of the path; with them it is theirs.
    scale_sigma = errors.wheel_scale_sigma if has_wheels else _UNIT_SCALE_SIGMA
    errors = errors.model_copy(update={"scale_sigma": scale_sigma})
    if visual.adjusted_covariance is None or images.inertial is not None:
        covariance = predicted_covariance(visual.odometry, errors)
    else:
        own = scale_sigma if has_wheels and not images.scale_is_of_reference else 0.0
        covariance = adjusted_covariance(visual, settings, own)
    estimate = DriveEstimate.in_first_frame(visual, covariance)
    notes = (visual.mounting_note(images.camera), _scale_note(estimate) if has_wheels else None)
    return replace(estimate, notes=(*estimate.notes, *(note for note in notes if note is not None)))


def _scale_note(estimate: DriveEstimate) -> str | None:
    """Return the standard deviation of the scale, by that of the farthest pose in its direction from the first."""
    away = estimate.position - estimate.position[0]
    farthest = int(np.argmax(np.linalg.norm(away, axis=1)))
    square = float(away[farthest] @ away[farthest])
    if square <= 0.0 or estimate.own_covariance is None:
        return None
    sigma = float(np.sqrt(away[farthest] @ estimate.own_covariance[farthest] @ away[farthest])) / square
    return f"the scale of the path has a standard deviation of {100.0 * sigma:.1f} %"


def _localize_wheels(records: MotionRecords, config: LocalizationConfig) -> DriveEstimate:
    """Estimate the path of wheels and gyro in the frame of the first pose."""
    wheels = wheel_odometry(records)
    covariance = predicted_covariance(wheels.odometry, config.with_wheel_errors())
    return replace(DriveEstimate.in_first_frame(wheels, covariance), visual_odometry=None)

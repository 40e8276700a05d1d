"""Localization pipeline: one list of steps from a recording to a path and landmarks.

`localize` runs visual odometry, the checks of odometry against fixes, loop closures and the batch smoother.
`localize_on_ice` repeats it in the frame of the ice at an epoch, and estimates the motion of the ice with the path. A
recording without images and odometry is a kinematic GPS survey.
"""

from dataclasses import replace

import numpy as np

from survey.core.arguments import check_types
from survey.core.arrays import BoolArray, FloatArray, Progress
from survey.core.errors import InputError
from survey.data.ice_motion import IceMotion
from survey.data.recording import OdometryRecording, Recording
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.reconstruction.motion.epoch import in_ice_frame
from survey.reconstruction.motion.stakes import motion_with_stakes
from vision_slam.agreement.sanity_checks import refuse_swapped_images
from vision_slam.agreement.scale import refuse_short_fixes, refuse_untracked
from vision_slam.agreement.steps import (
    Drive,
    align_drive,
    check_shape,
    check_start,
    correct_delay,
    drop_far_fixes,
    drop_fixes_in_gaps,
    drop_refused_fixes,
    drop_repeated_fixes,
    fit_memory,
    fit_turn_errors,
    note_delay,
    scale_to_fixes,
    widen_errors,
)
from vision_slam.attitude import quaternions
from vision_slam.config import UNKNOWN_CLOCK_S, UNKNOWN_MEMORY_S, LocalizationConfig, VisualOdometryConfig
from vision_slam.drive_estimate import Localization
from vision_slam.fusion.error_terms import stated_errors
from vision_slam.fusion.smoother import SmoothedPath, place_landmarks, smooth
from vision_slam.motion import dead_reckoning
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.visual_odometry import visual_odometry
from vision_slam.places.loop_closures import detect_loop_closures

_DRIFTS_OVER_M = 50.0  # the scale drifts in turns and stays as it is between them

_SURVEY_GRADE_M = 0.1
_BETTER = 0.1  # share of the fixes that are at least as good as the errors that are assumed


@check_types
def localize(
    recording: Recording,
    config: LocalizationConfig | None = None,
    *,
    visual: VisualOdometry | None = None,
    visual_config: VisualOdometryConfig | None = None,
    progress: Progress | None = None,
) -> Localization:
    """Estimate the path of a rover and its landmarks from a recording.

    Images are processed to odometry and sightings first, where the recording has no
    odometry. Without wheels the scale of the images is that of the fixes. Start, delay and
    outliers of the fixes are then checked, loop closures are added, and path and landmarks
    are smoothed. A recording without images and odometry is a kinematic GPS survey: the
    fixes are the path, and the surface is the ground below the antenna.

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
    progress : callable, optional
        Progress callback (stage, done, total) of the images.

    Returns
    -------
    Localization
        Path, landmarks, causal path, visual odometry and notes.

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
    if recording.odometry is None and recording.frames is None and visual is None:
        return kinematic_survey(recording, settings)
    visual = visual or process_images(recording, visual_config, progress)
    if visual is not None and visual.ignores_wheels:
        recording = replace(recording, wheels=None)
    drive = measure_motion(recording, settings, visual)
    for step in (
        drop_far_fixes,
        drop_repeated_fixes,
        drop_fixes_in_gaps,
        check_shape,
        scale_to_fixes,
        check_start,
        align_drive,
        correct_delay,
    ):
        drive = step(drive)
    drive = widen_errors(drive)
    accepted = add_loop_closures(fit_turn_errors(fit_memory(drop_refused_fixes(drive))))
    path = smooth(accepted.recording, accepted.path, accepted.config)
    accepted = note_delay(accepted, path)
    points = place_landmarks(accepted.recording, path, accepted.config)
    return Localization(
        _trajectory(accepted, path, drive.is_contradicted),
        points,
        drive.online.trajectory(drive.recording),
        drive.visual,
        n_fixes=drive.online.n_fixes,
        n_fixes_refused=drive.online.n_fixes - int(drive.used_fixes.sum()),
        notes=accepted.notes,
        ice_motion=path.ice_motion,
        landmarks_hold=not accepted.follows_fixes,
    )


def measure_motion(
    recording: Recording,
    config: LocalizationConfig,
    visual: VisualOdometry | None,
) -> Drive:
    """Take the odometry and sightings of the images, or the recorded ones.

    Raises
    ------
    InputError
        Odometry without sightings, images that could not be followed, or fixes that cannot
        give a scale.
    """
    settings = _stated(recording, config)
    if not recording.start_is_surveyed:
        settings = _foreign(settings, visual)
    if visual is None:
        if recording.odometry is None or recording.sightings is None:
            raise InputError(
                "the recording has odometry and no sightings; without landmarks there is no surface to map."
            )
        return Drive(recording.with_odometry(recording.odometry, recording.sightings), settings)
    refuse_swapped_images(visual.odometry)
    if recording.wheels is None:
        refuse_short_fixes(recording.gps, visual.odometry.time_s)
        refuse_untracked(visual)
    if visual.lens is not None:
        recording = replace(recording, camera=visual.lens.camera)
    with_images = recording.with_odometry(visual.odometry, visual.sightings)
    drive = Drive(with_images, image_config(settings, visual.scale_drift_sigma), visual, visual.notes)
    note = None if recording.camera is None else visual.mounting_note(recording.camera)
    return drive if note is None else drive.noted(note)


def _foreign(config: LocalizationConfig, visual: VisualOdometry | None) -> LocalizationConfig:
    """Return the configuration for a recording of others: unknown start, and unless set a memory of minutes and two clocks."""
    changed: dict[str, object] = {"start": "unknown"}
    claimed_m = float(np.hypot(config.gps_bias_sigma_m, config.gps_white_sigma_m))
    is_survey_grade = claimed_m < _SURVEY_GRADE_M  # such receivers state hardware time
    if visual is not None and not is_survey_grade and "clock_sigma_s" not in config.model_fields_set:
        changed["clock_sigma_s"] = UNKNOWN_CLOCK_S
    if "gps_correlation_time_s" not in config.model_fields_set:
        changed["gps_correlation_time_s"] = UNKNOWN_MEMORY_S
    return config.model_copy(update=changed)


def _stated(recording: Recording, config: LocalizationConfig) -> LocalizationConfig:
    """Return the errors of the better fixes, where the receiver states those of each."""
    if recording.gps.sigma_m is None:
        return config
    share = float(np.quantile(stated_errors(recording.gps, config), _BETTER))
    return config.model_copy(
        update={
            "gps_bias_sigma_m": share * config.gps_bias_sigma_m,
            "gps_white_sigma_m": share * config.gps_white_sigma_m,
        }
    )


def process_images(
    recording: Recording, config: VisualOdometryConfig | None, progress: Progress | None
) -> VisualOdometry | None:
    """Run visual odometry where the recording has no odometry; refuse before work starts where no scale is possible."""
    if recording.odometry is not None:
        return None
    if recording.wheels is None and recording.frames is not None:
        refuse_short_fixes(recording.gps, recording.frames.time_s)
    return visual_odometry(recording, config, progress)


def add_loop_closures(drive: Drive) -> Drive:
    """Add the loop closures of the images, unless the recording has loop closures."""
    return replace(drive, recording=with_loop_closures(drive.recording, drive.config))


def with_loop_closures(recording: OdometryRecording, config: LocalizationConfig) -> OdometryRecording:
    """Return the recording with the loop closures of its images, unless it has some."""
    if recording.frames is None or recording.loop_closures is not None:
        return recording
    path = smooth(recording, dead_reckoning(recording.odometry, recording.start), config)
    sigma_m = np.sqrt(np.linalg.eigvalsh(path.covariance[:, :2, :2])[:, -1])
    return replace(recording, loop_closures=detect_loop_closures(recording, path.position, sigma_m))


def image_config(config: LocalizationConfig, scale_drift_sigma: float = 0.0) -> LocalizationConfig:
    """Return the configuration with the odometry errors of images in place of those of other odometry.

    A drift of scale that the lens may cause widens the varying part of the scale error, and lasts longer.
    """
    images = config.images
    if scale_drift_sigma > 0.0:
        wander = float(np.hypot(images.scale_wander_sigma, scale_drift_sigma))
        images = images.model_copy(
            update={
                "scale_wander_sigma": wander,
                "scale_wander_m": max(images.scale_wander_m, _DRIFTS_OVER_M),
            }
        )
    return config.model_copy(update=images.model_dump())


def _trajectory(drive: Drive, path: SmoothedPath, is_contradicted: BoolArray) -> Trajectory:
    """Return the smoothed poses, with health 0 where images, wheels or fixes do not support them."""
    trajectory = Trajectory(
        drive.recording.odometry.time_s,
        path.position,
        quaternions(path.attitude_rad),
        path.covariance[:, :3, :3],
        drive.recording.crs,
        error=path.error,
    )
    is_lost = is_contradicted if drive.visual is None else is_contradicted | drive.visual.is_lost
    if drive.visual is None and not is_lost.any():
        return trajectory
    return replace(trajectory, health=1.0 - is_lost)


def kinematic_survey(recording: Recording, config: LocalizationConfig) -> Localization:
    """Return the fixes as path and the ground below the antenna as surface."""
    ground = recording.gps.position - [0.0, 0.0, recording.antenna_height_m]
    level = np.array([1.0, 1.0, config.gps_vertical_factor])
    variance = (config.gps_bias_sigma_m**2 + config.gps_white_sigma_m**2) * level**2
    covariance = np.tile(np.diag(variance), (len(ground), 1, 1))
    heading = np.arctan2(np.gradient(ground[:, 1]), np.gradient(ground[:, 0]))
    attitude = np.column_stack([np.zeros_like(heading), np.zeros_like(heading), heading])
    trajectory = Trajectory(recording.gps.time_s, ground, quaternions(attitude), covariance, recording.crs)
    points = SurfacePoints(
        ground,
        covariance=covariance,
        origins=recording.gps.position,
        crs=recording.crs,
        vertical_datum=recording.vertical_datum,
    )
    return Localization(trajectory, points, n_fixes=len(ground))


# Checks of start, gates and memory of the fixes take the motion for exact: they are repeated about the motion that was
# found where this moves a fix by more than this share of its claimed error.
_CLOSE = 0.1
_MOST_PASSES = 4


@check_types
def localize_on_ice(
    recording: Recording,
    motion: IceMotion,
    config: LocalizationConfig | None = None,
    *,
    visual: VisualOdometry | None = None,
    progress: Progress | None = None,
) -> Localization:
    """Estimate the path of a rover on moving ice, its landmarks and the motion of the ice.

    Parameters
    ----------
    recording : Recording
        Records of one drive, in fixed coordinates; repeated surveys of stakes count as measurements of the motion.
    motion : IceMotion
        Prior of the motion, with the epoch.
    config : LocalizationConfig, optional
        Errors assumed of the sensors.
    visual : VisualOdometry, optional
        Visual odometry of the images of this recording; computed where left out.
    progress : callable, optional
        Progress callback (stage, done, total) of the images.

    Returns
    -------
    Localization
        Path and landmarks at the epoch, and `Localization.ice_motion`. A place of the path at its own time is that of
        the epoch plus `IceMotion.displacement`.

    Raises
    ------
    InputError
        As `vision_slam.localize`.
    """
    settings = config or LocalizationConfig()
    if visual is None and recording.odometry is None and recording.frames is not None:
        visual = process_images(recording, None, progress)
    if recording.stake_surveys is not None:
        motion = motion_with_stakes(motion, recording.stake_surveys)
    about = motion.about(motion.expected)
    for _ in range(_MOST_PASSES):
        reduced = in_ice_frame(recording, about)
        found = localize(reduced, settings, visual=visual)
        if found.ice_motion is None or _most_moved_m(
            about, found.ice_motion, recording
        ) < _CLOSE * _claimed_m(settings):
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


def _claimed_m(config: LocalizationConfig) -> float:
    return float(np.hypot(config.gps_bias_sigma_m, config.gps_white_sigma_m))

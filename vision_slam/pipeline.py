"""Localization pipeline: one list of steps from a recording to a path and landmarks."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from survey.core.arguments import check_types
from survey.core.arrays import BoolArray, FloatArray, Progress
from survey.core.errors import InputError
from survey.data.recording import OdometryRecording, Recording
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from vision_slam.config import UNKNOWN_CLOCK_S, UNKNOWN_MEMORY_S, LocalizationConfig
from vision_slam.fusion.disagreement import fitted_memory_s, fitted_turn_sigma_m, reconcile
from vision_slam.fusion.fixes_alone import along_fixes, is_worse_than_fixes
from vision_slam.fusion.landmarks import place_landmarks
from vision_slam.fusion.online import OnlinePath, filter_path, gate_fixes, select_fixes
from vision_slam.fusion.receiver.base_station import stated_errors
from vision_slam.fusion.sanity_checks import (
    check_start_by_fixes,
    fix_delay_s,
    refuse_swapped_images,
    remove_repeated_fixes,
)
from vision_slam.fusion.smoother import SmoothedPath, smooth
from vision_slam.fusion.visual_scale import (
    refuse_short_fixes,
    refuse_untracked,
    scale_by_fixes,
    scale_visual_odometry,
)
from vision_slam.inertial.attitude import heading_correction
from vision_slam.inertial.dead_reckoning import dead_reckoning
from vision_slam.localization import Localization
from vision_slam.odometry.config import VisualOdometryConfig
from vision_slam.odometry.visual_odometry import VisualOdometry, visual_odometry
from vision_slam.places.loop_closures import detect_loop_closures
from vision_slam.places.relocalization import relocalize_segments, segment_starts
from vision_slam.rotation import quaternions

_DRIFTS_OVER_M = 50.0  # the scale drifts in turns and stays as it is between them

_MANY_REFUSED = 3
_CLOCK_SIGMAS = 2.0
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
    >>> from survey.data.sensors.aiding import GpsFixes
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
    drive = measure_motion(recording, settings, visual)
    for step in (drop_repeated_fixes, scale_to_fixes, check_start, align_drive, correct_delay):
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
    )


@dataclass(frozen=True)
class Drive:
    """Recording with odometry, and everything the steps of the pipeline pass on.

    ``visual`` is None where the odometry was processed elsewhere; ``used`` (M,) are the fixes to use
    where these are others than the filter accepted.
    """

    recording: OdometryRecording
    config: LocalizationConfig
    visual: VisualOdometry | None = None
    notes: tuple[str, ...] = ()
    used: BoolArray | None = None

    @cached_property
    def path(self) -> FloatArray:
        """Dead-reckoned positions (N, 3) [m]."""
        return dead_reckoning(self.recording.odometry, self.recording.start)

    @cached_property
    def online(self) -> OnlinePath:
        """Causal estimate of the particle filter."""
        return filter_path(self.recording, self.path, self.config)

    @property
    def used_fixes(self) -> BoolArray:
        """Whether each fix is used (M,): those that the filter accepted, unless others were chosen."""
        return self.online.accepted if self.used is None else self.used

    @property
    def is_interrupted(self) -> bool:
        """Whether the odometry has gaps that no sensor bridges."""
        return self.visual is not None and len(segment_starts(self.recording, self.visual)) > 0

    @property
    def is_contradicted(self) -> BoolArray:
        """Whether fixes contradict each pose (N,) and none agrees with the path any more until the end."""
        time_s, fix_s = self.recording.odometry.time_s, self.recording.gps.time_s
        used_s = fix_s[self.used_fixes]
        if len(used_s) == 0:
            return np.zeros(len(time_s), dtype=np.bool_)
        refused_s = fix_s[(fix_s > used_s[-1]) & (fix_s <= time_s[-1])]
        return time_s >= (refused_s[0] if len(refused_s) >= _MANY_REFUSED else np.inf)

    def noted(self, note: str) -> "Drive":
        """Return the drive with one more note."""
        return replace(self, notes=(*self.notes, note))


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
    return Drive(with_images, image_config(settings, visual.scale_drift_sigma), visual, visual.notes)


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


def drop_repeated_fixes(drive: Drive) -> Drive:
    """Remove fixes that repeat the one before to the last digit."""
    gps = remove_repeated_fixes(drive.recording.gps)
    n = len(drive.recording.gps) - len(gps)
    if n == 0:
        return drive
    dropped = replace(drive, recording=replace(drive.recording, gps=gps))
    return dropped.noted(f"{n} fixes repeat the one before to the last digit and were left out")


def scale_to_fixes(drive: Drive) -> Drive:
    """Scale visual odometry without wheels to the extent of the fixes."""
    if drive.visual is None or drive.recording.wheels is not None:
        return drive
    odometry = drive.visual.odometry
    factor, sigma = scale_by_fixes(drive.path, odometry.time_s, drive.recording.gps)
    scaled = scale_visual_odometry(drive.visual, factor)
    widened = drive.config.model_copy(update={"scale_sigma": max(drive.config.scale_sigma, sigma)})
    recording = drive.recording.with_odometry(scaled.odometry, scaled.sightings)
    return replace(drive, recording=recording, config=widened, visual=scaled)


def check_start(drive: Drive) -> Drive:
    """Take a surveyed start for unknown where the fixes contradict it."""
    if drive.is_interrupted:
        return drive
    time_s = drive.recording.odometry.time_s
    recording, config = check_start_by_fixes(drive.recording, drive.path, time_s, drive.config)
    if recording is drive.recording:
        return drive
    off_m = float(np.hypot(*(recording.start - drive.recording.start)[:2]))
    moved = replace(drive, recording=recording, config=config)
    return moved.noted(f"the fixes put the start {off_m:.0f} m from where it was surveyed")


def align_drive(drive: Drive) -> Drive:
    """Align the heading of visual odometry with the fixes; recorded odometry has a heading already."""
    if drive.visual is None:
        return drive
    recording, visual = align_heading(drive.recording, drive.visual)
    return replace(drive, recording=recording, visual=visual)


def correct_delay(drive: Drive) -> Drive:
    """Move delayed fixes back in time, and fixes of a clock that is ahead on in time.

    Fixes that were refused count only if most of them are accepted after the shift.
    """
    if drive.is_interrupted:
        return drive
    one_clock = drive.config.model_copy(update={"clock_sigma_s": 0.0})
    least_s = _CLOCK_SIGMAS * drive.config.clock_sigma_s  # what is less is estimated with the path
    delay_s = fix_delay_s(gate_fixes(drive.recording, drive.online), drive.path, one_clock)
    if abs(delay_s) > least_s:
        return _shifted(drive, delay_s)
    if drive.online.n_refused < _MANY_REFUSED:
        return drive
    delay_s = fix_delay_s(drive.recording, drive.path, one_clock)
    if abs(delay_s) <= least_s:
        return drive
    moved = _shifted(drive, delay_s)
    return moved if moved.online.n_refused <= 0.5 * drive.online.n_refused else drive


def _shifted(drive: Drive, delay_s: float) -> Drive:
    """Return the drive with its fixes earlier by so much, and aligned with them."""
    gps = replace(drive.recording.gps, time_s=drive.recording.gps.time_s - delay_s)
    moved = align_drive(replace(drive, recording=replace(drive.recording, gps=gps)))
    late = "late and were moved back" if delay_s > 0.0 else "early and were moved on"
    return moved.noted(f"the fixes are about {abs(delay_s):.1f} s {late} in time")


def widen_errors(drive: Drive) -> Drive:
    """Widen the errors of the odometry where it and the fixes disagree beyond both claims."""
    if drive.is_interrupted:
        return drive
    agreement = reconcile(drive.recording, drive.path, drive.config, drive.online)
    if np.array_equal(agreement.used, drive.online.accepted) and agreement.gain == 0.0:
        return drive
    widened = replace(drive, config=agreement.config, used=agreement.used)
    if agreement.gain == 0.0:
        return widened
    if is_worse_than_fixes(drive.recording, drive.path, agreement.config):
        return follow_fixes(drive)
    return widened.noted(agreement.note)


def follow_fixes(drive: Drive) -> Drive:
    """Replace odometry that predicts the fixes worse than their neighbours do by lines between them."""
    recording, config = along_fixes(drive.recording, drive.config)
    followed = replace(drive, recording=recording, config=config)
    return followed.noted(
        "odometry and fixes disagree so much that lines between the fixes predict them better; the path is that of the fixes: "
        "check focal length, lens distortion, order of the images and times"
    )


def note_delay(drive: Drive, path: SmoothedPath) -> Drive:
    """Note the estimated delay of the fixes where it, or its standard deviation along the path, exceeds half their errors."""
    time_s, step = drive.recording.odometry.time_s, drive.recording.odometry.step
    speed_m_s = float(np.linalg.norm(step, axis=1).sum() / (time_s[-1] - time_s[0]))
    claimed_m = float(np.hypot(drive.config.gps_bias_sigma_m, drive.config.gps_white_sigma_m))
    if max(abs(path.delay_s), path.delay_sigma_s) * speed_m_s <= 0.5 * claimed_m:
        return drive
    return drive.noted(
        f"the offset between the clocks of fixes and images is {path.delay_s:.2f} ± {path.delay_sigma_s:.2f} s, "
        f"{path.delay_sigma_s * speed_m_s:.1f} m along the path, which its standard deviations contain; set "
        "localization.clock_sigma_s where it is known better"
    )


def drop_refused_fixes(drive: Drive) -> Drive:
    """Remove the fixes that contradict the odometry and all other fixes."""
    return replace(drive, recording=select_fixes(drive.recording, drive.used_fixes))


def fit_memory(drive: Drive) -> Drive:
    """Take a longer correlation time of the fixes' errors where the evidence asks for it."""
    assumed_s = drive.config.gps_correlation_time_s
    memory_s = fitted_memory_s(drive.recording, drive.path, drive.config)
    if memory_s == assumed_s:
        return drive
    longer = drive.config.model_copy(update={"gps_correlation_time_s": memory_s})
    note = f"the errors of the fixes last longer than the {assumed_s:g} s assumed; {memory_s:g} s was used"
    return replace(drive, config=longer).noted(note)


def fit_turn_errors(drive: Drive) -> Drive:
    """Take a smaller error of turns for the images of others where precise fixes show it."""
    if drive.visual is None or drive.recording.start_is_surveyed:
        return drive
    smaller_m = fitted_turn_sigma_m(drive.recording, drive.path, drive.config)
    return replace(drive, config=drive.config.model_copy(update={"turn_sigma_m": smaller_m}))


def add_loop_closures(drive: Drive) -> Drive:
    """Add the loop closures of the images, unless the recording has loop closures."""
    return replace(drive, recording=with_loop_closures(drive.recording, drive.config))


def align_heading(recording: Recording, visual: VisualOdometry) -> tuple[OdometryRecording, VisualOdometry]:
    """Rotate visual odometry to the heading of the fixes; place the segments of an interrupted one."""
    if len(segment_starts(recording, visual)):
        visual = relocalize_segments(recording, visual)
    else:
        odometry = visual.odometry
        path = dead_reckoning(odometry, recording.start)
        turn_rad = heading_correction(path, odometry.time_s, recording.gps)
        attitude_rad = odometry.attitude_rad + [0.0, 0.0, turn_rad]
        visual = replace(visual, odometry=replace(odometry, attitude_rad=attitude_rad))
    return recording.with_odometry(visual.odometry, visual.sightings), visual


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

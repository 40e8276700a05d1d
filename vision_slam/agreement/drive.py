"""Drive: a recording with odometry, and everything that the steps of the pipeline pass on.

`process_images` runs visual odometry. `measure_motion` begins a `Drive` with its odometry and sightings, or with the
recorded ones, and with the errors that the receiver states. The path by dead reckoning and the causal filter of a drive
are computed when they are first used.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from survey.core import BoolArray, FloatArray, InputError, Progress
from survey.data.recording import OdometryRecording, Recording
from survey.data.sensors.records import GpsFixes
from vision_slam.agreement.sanity_checks import refuse_swapped_images
from vision_slam.agreement.scale import refuse_short_fixes, refuse_untracked
from vision_slam.config import UNKNOWN_CLOCK_S, UNKNOWN_MEMORY_S, LocalizationConfig, VisualOdometryConfig
from vision_slam.fusion.error_terms import stated_errors
from vision_slam.fusion.online import OnlinePath, filter_path
from vision_slam.motion import dead_reckoning
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.visual_odometry import visual_odometry
from vision_slam.places.relocalization import segment_starts
from vision_slam.readers.sequence import VisionRecords

MANY_REFUSED = 3
"""Refused fixes beyond which a delay is tried, or, at the end of a drive, beyond which its last poses count as lost."""
_PHOTOGRAPHS_S = 1.0  # between images of a camera that is no video camera
_SURVEY_GRADE_M = 0.1  # errors of receivers with corrections, which stamp fixes by hardware
_BETTER = 0.1  # share of the fixes that are at least as good as the errors that are assumed


@dataclass(frozen=True)
class Drive:
    """Recording with odometry, and everything the steps of the pipeline pass on.

    ``visual`` is None where the odometry was processed elsewhere; ``used`` (M,) are the fixes to use
    where these are others than the filter accepted; ``undelayed`` is the drive with the fixes at their recorded
    times, where a delay was corrected, and ``ungated`` the drive before the fixes that contradict it were removed;
    ``follows_fixes`` whether lines between the fixes have replaced the odometry.
    """

    recording: OdometryRecording
    config: LocalizationConfig
    visual: VisualOdometry | None = None
    notes: tuple[str, ...] = ()
    used: BoolArray | None = None
    undelayed: "Drive | None" = None
    ungated: "Drive | None" = None
    follows_fixes: bool = False

    @cached_property
    def path(self) -> FloatArray:
        """Dead-reckoned positions (N, 3) [m]."""
        return dead_reckoning(self.recording.odometry, self.recording.start)

    @cached_property
    def online(self) -> OnlinePath:
        """Causal estimate of the particle filter."""
        return filter_path(self.recording, self.path, self.config)

    @property
    def has_images(self) -> bool:
        """Whether the odometry is that of images processed here."""
        return self.visual is not None and self.visual.has_images

    @property
    def with_all_fixes(self) -> "Drive":
        """The drive with all fixes, also those that were removed because they contradict it."""
        return self if self.ungated is None else self.ungated

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
        return time_s >= (refused_s[0] if len(refused_s) >= MANY_REFUSED else np.inf)

    def noted(self, note: str) -> "Drive":
        """Return the drive with one more note."""
        return replace(self, notes=(*self.notes, note))


def process_images(
    records: VisionRecords, config: VisualOdometryConfig | None, progress: Progress | None
) -> VisualOdometry:
    """Run visual odometry; refuse before work starts where neither wheels nor fixes give a scale.

    Images seconds apart may turn out to be photographs, which need less.
    """
    if isinstance(records, Recording) and records.wheels is None and records.frames is not None:
        times = records.frames.time_s
        if len(times) < 2 or np.median(np.diff(times)) < _PHOTOGRAPHS_S:
            refuse_short_fixes(records.gps, times)
    return visual_odometry(records, config, progress)


def check_images(visual: VisualOdometry, *, has_wheels: bool, gps: GpsFixes | None = None) -> None:
    """Refuse images in another order; without wheels also short fixes, and images that were hardly tracked."""
    refuse_swapped_images(visual.odometry)
    if has_wheels:
        return
    if gps is not None:
        refuse_short_fixes(gps, visual.odometry.time_s)
    refuse_untracked(visual)


def measure_motion(recording: Recording, config: LocalizationConfig, visual: VisualOdometry | None) -> Drive:
    """Take the odometry and sightings of the images, or the recorded ones."""
    settings = _stated(recording, config)
    if not recording.start_is_surveyed:
        settings = _foreign(settings, visual)
    if visual is None:
        if recording.odometry is None or recording.sightings is None:
            raise InputError(
                "the recording has odometry and no sightings; without landmarks there is no surface to map."
            )
        return Drive(recording.with_odometry(recording.odometry, recording.sightings), settings)
    if not visual.has_images:
        of_wheels = replace(recording, wheels=None).with_odometry(visual.odometry, visual.sightings)
        return Drive(of_wheels, settings.with_wheel_errors(), visual, visual.notes)
    if visual.ignores_wheels:
        recording = replace(recording, wheels=None)
    check_images(visual, has_wheels=recording.wheels is not None, gps=recording.gps)
    if visual.lens is not None:
        recording = replace(recording, camera=visual.lens.camera)
    with_images = recording.with_odometry(visual.odometry, visual.sightings)
    drive = Drive(with_images, settings.with_image_errors(visual.scale_drift_sigma), visual, visual.notes)
    note = None if recording.camera is None else visual.mounting_note(recording.camera)
    return drive if note is None else drive.noted(note)


def _foreign(config: LocalizationConfig, visual: VisualOdometry | None) -> LocalizationConfig:
    """Return the configuration for a recording of others: unknown start, and unless set a memory of minutes and two clocks."""
    changed: dict[str, object] = {"start": "unknown"}
    is_survey_grade = config.fix_sigma_m < _SURVEY_GRADE_M  # such receivers state hardware time
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

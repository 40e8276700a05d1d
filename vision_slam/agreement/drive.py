"""Recording with odometry, as the steps of the pipeline pass it on."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.data.recording import OdometryRecording, Recording
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.online import OnlinePath, filter_path
from vision_slam.inertial.attitude import heading_correction
from vision_slam.inertial.dead_reckoning import dead_reckoning
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.places.relocalization import relocalize_segments, segment_starts

_MANY_REFUSED = 3


@dataclass(frozen=True)
class Drive:
    """Recording with odometry, and everything the steps of the pipeline pass on.

    ``visual`` is None where the odometry was processed elsewhere; ``used`` (M,) are the fixes to use
    where these are others than the filter accepted; ``undelayed`` is the drive with the fixes at their recorded
    times, where a delay was corrected; ``follows_fixes`` whether lines between the fixes have replaced the odometry.
    """

    recording: OdometryRecording
    config: LocalizationConfig
    visual: VisualOdometry | None = None
    notes: tuple[str, ...] = ()
    used: BoolArray | None = None
    undelayed: "Drive | None" = None
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

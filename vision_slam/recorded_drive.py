"""Recorded drive: images, fixes and inertial measurements with their localization."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from survey import ConfigError, InputError, Recording, Trajectory
from survey.core import FloatArray, Progress, validated, with_overrides
from survey.data.ice_motion import IceMotion
from survey.data.sensors.records import GpsFixes
from vision_slam.config import LocalizationConfig, VisualOdometryConfig
from vision_slam.drive_estimate import DriveEstimate
from vision_slam.evaluation import Comparison, compare_aligned, compare_from_start, compare_in_crs
from vision_slam.pipeline import localize, localize_images
from vision_slam.readers.datasets import is_kitti, read_poses
from vision_slam.readers.gps_files import is_receiver_file, read_gps
from vision_slam.readers.sequence import ZERO_HEIGHTS, ImageSequence, MotionRecords

logger = logging.getLogger(__name__)


_NO_ANTENNA = "the height of the antenna above the ground is not stated; name it with --antenna"
_NO_ERRORS = "the fixes state no errors: those of the settings are assumed, --set localization.gps_bias_sigma_m and others change them"


class ReferencePoses(NamedTuple):
    """Reference poses in a frame of their own: times (R,) [s] and poses (R, 4, 4), body to that frame."""

    time_s: FloatArray
    poses: FloatArray


@dataclass(frozen=True)
class RecordedDrive:
    """A recording that is ready to be localized.

    `records`: a recording has fixes in a CRS; a sequence of images, and records of motion without images, have none. `notes`: what its reader did or
    assumed, one sentence each. `reference_time_s`, `reference` (R,) and (R, 4, 4): reference poses of the
    layout, in a frame of their own. `no_ground`: why the fixes of a drive without images are no points of the ground;
    ``""`` where they are.
    """

    records: Recording | ImageSequence | MotionRecords
    notes: tuple[str, ...] = ()
    reference_time_s: FloatArray | None = None
    reference: FloatArray | None = None
    no_ground: str = ""

    @classmethod
    def of_fixes(
        cls, recording: Recording, notes: Sequence[str], antenna_m: float | None, flown: str = ""
    ) -> Self:
        """Return the drive of a receiver alone, whose antenna has a height above the ground [m] or an unknown one.

        `flown`: the vehicle, where it is one that flies.
        """
        reason = "" if antenna_m is not None else _NO_ANTENNA
        if ZERO_HEIGHTS in notes:
            reason = "all heights are 0; record or export the log with heights"
        if flown:
            reason = f"the log is of {flown}, whose fixes are not above the ground by a height that stays"
        if recording.gps.sigma_m is None:
            notes = [*notes, _NO_ERRORS]
        if reason:
            notes = [
                *notes,
                f"the path is that of the antenna, and there are no points of the ground: {reason}",
            ]
        drive = replace(recording, antenna_height_m=antenna_m or 0.0)
        return cls(drive, tuple(notes), no_ground=reason)

    @property
    def start_is_surveyed(self) -> bool:
        """Whether the recording has a surveyed start."""
        return isinstance(self.records, Recording) and self.records.start_is_surveyed

    @property
    def gps(self) -> GpsFixes | None:
        """Fixes, in the working CRS."""
        return self.records.gps if isinstance(self.records, Recording) else None

    def config(self, overrides: Sequence[str] = ()) -> LocalizationConfig:
        """Return the errors assumed of the sensors."""
        values = _sections(overrides)
        if values["localization"].get("start") == "surveyed" and not self.start_is_surveyed:
            raise ConfigError(
                "--set names localization.start=surveyed, and the start of this recording was not surveyed; leave it out."
            )
        return validated(LocalizationConfig, values["localization"], "--set")

    def visual_config(self, overrides: Sequence[str] = ()) -> VisualOdometryConfig:
        """Return the settings of visual odometry."""
        return validated(VisualOdometryConfig, _sections(overrides)["visual"], "--set")

    def localize(
        self,
        config: LocalizationConfig | None = None,
        progress: Progress | None = None,
        *,
        visual_config: VisualOdometryConfig | None = None,
        motion: IceMotion | None = None,
    ) -> DriveEstimate:
        """Estimate path and landmarks.

        With fixes this is `vision_slam.localize`; without, the path is that of visual odometry.
        """
        if isinstance(self.records, Recording):
            if motion is not None and self.records.odometry is None and self.records.frames is None:
                raise InputError("the recording has no images; visual odometry needs frames and camera.toml.")
            found = localize(
                self.records, config, visual_config=visual_config, motion=motion, progress=progress
            )
            return DriveEstimate.in_crs(
                replace(found, landmarks_hold=found.landmarks_hold and not self.no_ground)
            )
        if motion is not None:
            raise InputError(
                "the recording has no fixes, and the motion of the ice is one relative to them; add --gps, or leave --epoch out."
            )
        return localize_images(self.records, config, visual_config=visual_config, progress=progress)

    def compare(
        self, estimate: DriveEstimate, reference: Trajectory | ReferencePoses | None
    ) -> Comparison | None:
        """Compare an estimate with a reference from a file, or with that of the layout.

        Returns: None without any reference. A reference in a frame of its own is moved to the first common
        pose, and beside a path in a CRS by heading and shift onto the path.
        """
        if isinstance(reference, Trajectory):
            path = estimate.fixed_trajectory
            return None if path is None else compare_in_crs(path, reference)
        if reference is not None:
            return self._compare_own_poses(estimate, reference)
        if estimate.trajectory is not None or self.reference is None or self.reference_time_s is None:
            return None
        return compare_from_start(estimate, self.reference_time_s, self.reference @ estimate.T_body_tracked)

    def read_reference(self, path: Path) -> Trajectory | ReferencePoses:
        """Read a reference path."""
        if not isinstance(self.records, Recording) or is_kitti(path):
            return self._read_own_poses(path)
        if not is_receiver_file(path):
            return Trajectory.read(path, self.records.crs)
        log = read_gps(path)
        for note in log.notes:
            logger.warning("%s: %s", path, note)
        fixes, crs = log.fixes(self.records.crs)
        level = np.tile([0.0, 0.0, 0.0, 1.0], (len(fixes), 1))
        return Trajectory(fixes.time_s, fixes.position, level, np.zeros((len(fixes), 3, 3)), crs)

    def _read_own_poses(self, path: Path) -> ReferencePoses:
        if self.records.frames is None or self.records.camera is None:
            raise InputError(
                f"{path} holds poses of images, and the recording has none; name a path in its CRS."
            )
        return ReferencePoses(*read_poses(path, self.records.frames.time_s, self.records.camera))

    def _compare_own_poses(self, estimate: DriveEstimate, reference: ReferencePoses) -> Comparison:
        """Compare with poses of the body or of the camera, whichever agrees better: files do not say."""
        compare = compare_from_start if estimate.trajectory is None else compare_aligned
        mount = np.eye(4) if self.records.camera is None else self.records.camera.T_body_camera
        # A path without a scale is that of the camera: its position on the body is not subtracted.
        mount = np.linalg.inv(estimate.T_body_tracked) @ mount
        of_body = mount @ reference.poses @ np.linalg.inv(mount)
        compared = [compare(estimate, reference.time_s, poses) for poses in (reference.poses, of_body)]
        return min(compared, key=lambda found: float(np.square(found.position - found.reference).sum()))


def _sections(overrides: Sequence[str]) -> dict[str, Any]:
    """Return the overrides by section; refuse sections that localization does not have."""
    values = with_overrides({"localization": {}, "visual": {}}, overrides)
    unknown = next((key for key in values if key not in {"localization", "visual"}), None)
    if unknown is not None:
        raise ConfigError(
            f"--set names {unknown!r}; localize takes only localization.KEY=VALUE and visual.KEY=VALUE."
        )
    return values

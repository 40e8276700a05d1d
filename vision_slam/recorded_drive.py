"""Recorded drive: images, fixes and inertial measurements with their localization."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from survey.core.arrays import FloatArray, Progress
from survey.core.config import validated, with_overrides
from survey.core.errors import ConfigError, InputError
from survey.data.camera import Camera
from survey.data.frames import Frames
from survey.data.ice_motion import IceMotion
from survey.data.recording import Recording
from survey.data.sensors.records import GpsFixes
from survey.data.trajectory import Trajectory
from vision_slam.agreement.sanity_checks import refuse_swapped_images
from vision_slam.agreement.scale import refuse_untracked
from vision_slam.config import LocalizationConfig, VisualOdometryConfig
from vision_slam.drive_estimate import (
    Comparison,
    DriveEstimate,
    compare_aligned,
    compare_from_start,
    compare_in_crs,
)
from vision_slam.fusion.online import predicted_covariance
from vision_slam.odometry.visual_odometry import visual_odometry
from vision_slam.pipeline import image_config, localize, localize_on_ice, process_images
from vision_slam.readers.datasets import is_kitti, read_poses
from vision_slam.readers.gps_files import is_receiver_file, read_gps
from vision_slam.readers.sequence import ImageSequence

logger = logging.getLogger(__name__)
_UNIT = 1e-6


class ReferencePoses(NamedTuple):
    """Reference poses in a frame of their own: times (R,) [s] and poses (R, 4, 4), body to that frame."""

    time_s: FloatArray
    poses: FloatArray


@dataclass(frozen=True)
class RecordedDrive:
    """A recording that is ready to be localized.

    Parameters
    ----------
    records : Recording or ImageSequence
        A recording has fixes in a CRS; a sequence of images has none.
    notes : tuple of str
        What its reader did or assumed, one sentence each.
    reference_time_s, reference : (R,) and (R, 4, 4) ndarray, optional
        Reference poses of the layout, in a frame of their own.
    """

    records: Recording | ImageSequence
    notes: tuple[str, ...] = ()
    reference_time_s: FloatArray | None = None
    reference: FloatArray | None = None

    @property
    def start_is_surveyed(self) -> bool:
        """Whether the recording has a surveyed start."""
        return isinstance(self.records, Recording) and self.records.start_is_surveyed

    @property
    def frames(self) -> Frames | None:
        """Images."""
        return self.records.frames

    @property
    def camera(self) -> Camera | None:
        """Calibration."""
        return self.records.camera

    @property
    def gps(self) -> GpsFixes | None:
        """Fixes, in the working CRS."""
        return self.records.gps if isinstance(self.records, Recording) else None

    def config(self, overrides: Sequence[str] = ()) -> LocalizationConfig:
        """Return the errors assumed of the sensors.

        Parameters
        ----------
        overrides : sequence of str
            As in a mission file: ``localization.gps_bias_sigma_m=3.0``.

        Returns
        -------
        LocalizationConfig
            Defaults with the overrides.

        Raises
        ------
        ConfigError
            An unknown key, a value of another kind, or a surveyed start that the recording lacks.
        """
        values = _sections(overrides)
        if values["localization"].get("start") == "surveyed" and not self.start_is_surveyed:
            raise ConfigError(
                "--set names localization.start=surveyed, and the start of this recording was not surveyed; leave it out."
            )
        return validated(LocalizationConfig, values["localization"], "--set")

    def visual_config(self, overrides: Sequence[str] = ()) -> VisualOdometryConfig:
        """Return the settings of visual odometry.

        Parameters
        ----------
        overrides : sequence of str
            ``visual.pixel_sigma=1.0``; those of other sections are left out.

        Returns
        -------
        VisualOdometryConfig
            Defaults with the overrides.

        Raises
        ------
        ConfigError
            An unknown key, or a value of another kind.
        """
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

        With fixes this is `vision_slam.localize`, or `vision_slam.localize_on_ice`; without, the path is that of visual
        odometry.

        Parameters
        ----------
        config : LocalizationConfig, optional
            Errors assumed of the sensors.
        progress : callable, optional
            Progress callback (stage, done, total).
        visual_config : VisualOdometryConfig, optional
            Settings of visual odometry.
        motion : IceMotion, optional
            Prior of the motion of the ice, at the epoch of the result; without it the ground rests.

        Returns
        -------
        DriveEstimate
            Path and landmarks.

        Raises
        ------
        InputError
            The images or the fixes do not suffice.
        """
        if motion is not None:
            return self._localized_on_ice(motion, config, progress, visual_config)
        if isinstance(self.records, Recording):
            return DriveEstimate.in_crs(
                localize(self.records, config, visual_config=visual_config, progress=progress)
            )
        visual = visual_odometry(self.records, visual_config, progress)
        refuse_swapped_images(visual.odometry)
        has_wheels = self.records.wheels is not None and not visual.ignores_wheels
        if not has_wheels:
            refuse_untracked(visual)
        errors = image_config(config or LocalizationConfig(), visual.scale_drift_sigma)
        # Without wheels the scale is the unit of the path; with them it is theirs.
        scale_sigma = errors.wheel_scale_sigma if has_wheels else _UNIT
        errors = errors.model_copy(update={"scale_sigma": scale_sigma})
        estimate = DriveEstimate.in_first_frame(visual, predicted_covariance(visual.odometry, errors))
        note = visual.mounting_note(self.records.camera)
        return estimate if note is None else replace(estimate, notes=(*estimate.notes, note))

    def _localized_on_ice(
        self,
        motion: IceMotion,
        config: LocalizationConfig | None,
        progress: Progress | None,
        visual_config: VisualOdometryConfig | None,
    ) -> DriveEstimate:
        """Estimate path, landmarks and the motion of the ice; refuse images without fixes."""
        if not isinstance(self.records, Recording):
            raise InputError(
                "the recording has no fixes, and the motion of the ice is one relative to them; add --gps, or leave --epoch out."
            )
        visual = process_images(self.records, visual_config, progress)
        return DriveEstimate.in_crs(localize_on_ice(self.records, motion, config, visual=visual))

    def compare(
        self, estimate: DriveEstimate, reference: Trajectory | ReferencePoses | None
    ) -> Comparison | None:
        """Compare an estimate with a reference from a file, or with that of the layout.

        Parameters
        ----------
        estimate : DriveEstimate
            Result of `localize`.
        reference : Trajectory or ReferencePoses, optional
            Result of `read_reference`.

        Returns
        -------
        Comparison or None
            None without any reference. A reference in a frame of its own is moved to the first
            common pose, and beside a path in a CRS by heading and shift onto the path.
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
        """Read a reference path.

        Parameters
        ----------
        path : Path
            KITTI ``poses.txt``, one pose for each image. Else ``.csv`` or ``.tum`` in the CRS of the
            recording, or the file of a receiver that `vision_slam.readers.gps_files.read_gps` reads, such
            as a table of RTK fixes on the clock of the recording; for images alone TUM in a frame of
            its own.

        Returns
        -------
        Trajectory or ReferencePoses
            Poses in a frame of their own for KITTI and for images alone.

        Raises
        ------
        InputError
            Missing or damaged.
        """
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
        if self.frames is None or self.camera is None:
            raise InputError(
                f"{path} holds poses of images, and the recording has none; name a path in its CRS."
            )
        return ReferencePoses(*read_poses(path, self.frames.time_s, self.camera))

    def _compare_own_poses(self, estimate: DriveEstimate, reference: ReferencePoses) -> Comparison:
        """Compare with poses of the body or of the camera, whichever agrees better: files do not say."""
        compare = compare_from_start if estimate.trajectory is None else compare_aligned
        mount = np.eye(4) if self.camera is None else self.camera.T_body_camera
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

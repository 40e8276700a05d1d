"""A drive as its files tell it, whosever they are: opened and checked, then localized, then judged."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pyproj import CRS

from survey.core.arrays import FloatArray, Progress
from survey.core.config import validated, with_overrides
from survey.core.errors import ConfigError, InputError
from survey.data.camera import Camera, Frames, ImageFiles
from survey.data.recording import Recording
from survey.data.sensors import GpsFixes
from survey.data.trajectory import Trajectory
from survey.io.tracks import read_tum
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.visual_scale import refuse_untracked
from vision_slam.io.bags import is_bag, read_bag
from vision_slam.io.gps_files import read_gps
from vision_slam.io.images import refuse_cut_off, refuse_other_sizes
from vision_slam.io.readers import read_sequence
from vision_slam.io.sequence import ImageSequence, placed, scaled_by_first
from vision_slam.odometry.visual_slam import visual_odometry
from vision_slam.pipeline import localize
from vision_slam.results import Compared, Localized, compared_from_its_start, compared_in_the_world


@dataclass(frozen=True)
class RecordedDrive:
    """A recording that is ready to be localized.

    Parameters
    ----------
    sensed : Recording or ImageSequence
        A recording has its place in the world by fixes; a sequence of images has none.
    notes : tuple of str
        What its reader did or supposed, in words.
    reference_time_s, reference : (R,) and (R, 4, 4) ndarray, optional
        Poses of the layout to judge by, in a frame of their own.
    """

    sensed: Recording | ImageSequence
    notes: tuple[str, ...] = ()
    reference_time_s: FloatArray | None = None
    reference: FloatArray | None = None

    @property
    def start_is_surveyed(self) -> bool:
        """Whether the recording has a surveyed start."""
        return isinstance(self.sensed, Recording) and self.sensed.start_is_surveyed

    @property
    def frames(self) -> Frames | None:
        """Images."""
        return self.sensed.frames

    @property
    def camera(self) -> Camera | None:
        """Calibration."""
        return self.sensed.camera

    @property
    def gps(self) -> GpsFixes | None:
        """Fixes, in the CRS that is worked in."""
        return self.sensed.gps if isinstance(self.sensed, Recording) else None

    def assumed(self, overrides: Sequence[str] = ()) -> LocalizationConfig:
        """Return the errors assumed of the sensors, with overrides.

        Parameters
        ----------
        overrides : sequence of str
            As in a mission file: ``localization.gps_bias_sigma_m=3.0``.

        Raises
        ------
        ConfigError
            An unknown key, a value of another kind, or a surveyed start that the recording lacks.
        """
        values = with_overrides({"localization": {}}, overrides)
        unknown = next((key for key in values if key != "localization"), None)
        if unknown is not None:
            raise ConfigError(f"--set names {unknown!r}; localize knows localization.KEY=VALUE alone.")
        if values["localization"].get("start") == "surveyed" and not self.start_is_surveyed:
            raise ConfigError(
                "--set names localization.start=surveyed, and the start of this recording was not surveyed; leave it out."
            )
        return validated(LocalizationConfig, values["localization"], "--set")

    def localized(
        self, config: LocalizationConfig | None = None, progress: Progress | None = None
    ) -> Localized:
        """Estimate path and landmarks.

        Raises
        ------
        InputError
            What the images or the fixes do not suffice for.
        """
        if isinstance(self.sensed, ImageSequence):
            seen = visual_odometry(self.sensed, progress=progress)
            if self.sensed.wheels is None:
                refuse_untracked(seen)
            return Localized.from_its_start(seen)
        return Localized.in_the_world(localize(self.sensed, config, progress=progress))

    def compared(self, localized: Localized, judge: Trajectory | FloatArray | None) -> Compared | None:
        """Hold an estimate against a reference from a file, else against the layout's own; None without either."""
        if localized.trajectory is not None:
            return compared_in_the_world(localized, judge) if isinstance(judge, Trajectory) else None
        if judge is not None:
            rows = np.asarray(judge)
            poses = np.tile(np.eye(4), (len(rows), 1, 1))
            poses[:, :3, 3] = rows[:, 1:4]
            poses[:, :3, :3] = _turns(rows[:, 4:8])
            return compared_from_its_start(localized, rows[:, 0], poses)
        if self.reference is None or self.reference_time_s is None:
            return None
        return compared_from_its_start(localized, self.reference_time_s, self.reference)

    def read_reference(self, path: Path) -> Trajectory | FloatArray:
        """Read a path to judge by: in the drive's CRS or, for images alone, TUM poses in a frame of their own.

        Raises
        ------
        InputError
            Missing or damaged.
        """
        if isinstance(self.sensed, Recording):
            return Trajectory.read(path, self.sensed.crs)
        return read_tum(path)


def open_drive(
    source: Path,
    *,
    camera: Path | None = None,
    topics: Sequence[str] = (),
    gps: Path | None = None,
    crs: CRS | str | None = None,
    gps_shift_s: float = 0.0,
    scale_from_m: float | None = None,
) -> RecordedDrive:
    """Open a recording of ours, a bag, or a folder of images; whatever can be checked is checked here.

    Parameters
    ----------
    source : Path
        See `vision_slam.io.readers.read_sequence` and `vision_slam.io.bags.read_bag`.
    camera : Path, optional
        ``camera.toml`` to use instead of the calibration that came with the images.
    topics : sequence of str
        Topics of a bag.
    gps : Path, optional
        Fixes that were recorded beside the images.
    crs : str or pyproj.CRS, optional
        Projected CRS to work in; the UTM zone of the first fix unless given.
    gps_shift_s : float
        Added to the times of the fixes [s].
    scale_from_m : float, optional
        Take the scale from the first metres of the layout's reference [m].

    Raises
    ------
    InputError, ConfigError
        Nothing that is known, damaged files, or options that do not fit what is there.
    """
    if not source.exists():
        raise InputError(f"{source} does not exist; check the path.")
    if (source / "recording.json").is_file():
        if camera or topics or gps or crs or scale_from_m is not None:
            raise ConfigError(
                f"{source} is a recording with calibration, fixes and CRS of its own; leave --camera, --topic, --gps, --crs and --scale-from out."
            )
        return _ours(source)
    if topics and not is_bag(source):
        raise ConfigError(f"{source} is no bag and has no topics; leave --topic out.")
    calibration = None if camera is None else Camera.read(camera)
    sequence = read_bag(source, topics, calibration) if is_bag(source) else read_sequence(source, calibration)
    if scale_from_m is not None:
        sequence = scaled_by_first(sequence, scale_from_m)
    log, notes = (sequence.gps if gps is None else read_gps(gps)), sequence.notes
    if len(sequence.frames) < 2:
        raise InputError(f"{source} holds one image; motion needs at least two.")
    if log is None and (crs is not None or gps_shift_s != 0.0):
        raise ConfigError(f"{source} holds no fixes; --crs and --gps-shift need some, name them with --gps.")
    if log is None:
        if sequence.wheels is None:
            notes += ("no wheels and no fixes: lengths are no metres, the first step counts as one",)
        return RecordedDrive(sequence, notes, sequence.reference_time_s, sequence.reference)
    recording = placed(sequence, log, crs, gps_shift_s)
    notes += (f"works in {recording.crs.name}",)
    if log.n_without_fix:
        notes += (f"{log.n_without_fix} records of the receiver without a fix are left out",)
    if sequence.wheels is None:
        notes += ("no wheels: the scale is that of the fixes",)
    return RecordedDrive(recording, notes)


def _ours(source: Path) -> RecordedDrive:
    recording = Recording.read(source)
    frames, camera = recording.frames, recording.camera
    if frames is not None and camera is not None and isinstance(frames.images, ImageFiles):
        for file in frames.images.files:
            refuse_cut_off(file)
        refuse_other_sizes(frames.images.files, camera)
    return RecordedDrive(recording)


def _turns(quaternion: FloatArray) -> FloatArray:
    from scipy.spatial.transform import Rotation

    turns: FloatArray = Rotation.from_quat(quaternion).as_matrix()
    return turns

"""Recordings of any supported kind: open, check, localize, compare with a reference."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pyproj import CRS

from survey.core.errors import ConfigError, InputError
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import ImageFiles
from survey.data.recording import Recording
from vision_slam.inertial.units import refuse_other_units
from vision_slam.io.bags.reading import is_bag, read_bag
from vision_slam.io.calibrations import read_calibration
from vision_slam.io.gps_files import read_gps
from vision_slam.io.gps_log import GpsLog
from vision_slam.io.images import refuse_cut_off, refuse_other_sizes
from vision_slam.io.readers import read_sequence
from vision_slam.io.sequence import ImageSequence, VisionRecords, georeference, scale_by_reference
from vision_slam.recorded_drive import RecordedDrive


def open_recording(
    source: str | Path,
    *,
    camera: str | Path | None = None,
    topics: Sequence[str] = (),
    gps: str | Path | None = None,
    crs: CRS | str | None = None,
    gps_shift_s: float = 0.0,
    scale_from_m: float | None = None,
    columns: Sequence[str] = (),
    frame_rate_hz: float | None = None,
) -> RecordedDrive:
    """Open a firnline recording, a ROS bag, or a folder of images, and check it.

    Parameters
    ----------
    source : str or Path
        See `vision_slam.io.readers.read_sequence` and `vision_slam.io.bags.reading.read_bag`.
    camera : str or Path, optional
        ``camera.toml`` to use instead of the calibration that came with the images.
    topics : sequence of str
        Topics of a bag.
    gps : str or Path, optional
        Fixes recorded beside the images.
    crs : str or pyproj.CRS, optional
        Projected CRS to work in; the UTM zone of the first fix unless given.
    gps_shift_s : float
        Added to the times of the fixes [s].
    scale_from_m : float, optional
        Take the scale from the first metres of the layout's reference [m].
    columns : sequence of str
        Columns of a table of fixes by key, such as ``time=t,x=Easting``.
    frame_rate_hz : float, optional
        Images per second, for a folder of images without times.

    Returns
    -------
    RecordedDrive
        What `localize` takes is its `records`, where there are fixes.

    Raises
    ------
    InputError, ConfigError
        An unknown layout, damaged files, or options that do not fit the recording.
    """
    place = Path(source)
    if not place.exists():
        raise InputError(f"{place} does not exist; check the path.")
    if (place / "recording.json").is_file():
        if camera or topics or gps or crs or frame_rate_hz or scale_from_m is not None:
            raise ConfigError(
                f"{place} is a recording with calibration, fixes and CRS of its own; leave --camera, --topic, --gps, --crs, --frame-rate and --scale-from out."
            )
        return _firnline_recording(place)
    if columns and gps is None:
        raise ConfigError("--columns names columns of a table of fixes; name the table with --gps.")
    lens, lens_notes = (None, ()) if camera is None else read_calibration(camera)
    sequence = _read_images(place, topics, lens, frame_rate_hz)
    sequence = replace(sequence, notes=(*lens_notes, *sequence.notes))
    if scale_from_m is not None:
        sequence = scale_by_reference(sequence, scale_from_m)
    log = sequence.gps if gps is None else read_gps(gps, columns)
    if log is not None:
        return _with_fixes(sequence, log, crs, gps_shift_s)
    if crs is not None or gps_shift_s != 0.0:
        raise ConfigError(f"{place} holds no fixes; --crs and --gps-shift need some, name them with --gps.")
    notes = sequence.notes
    if sequence.wheels is None:
        notes += ("no wheels and no fixes: lengths are no metres, the first step counts as one",)
    return RecordedDrive(sequence, notes, sequence.reference_time_s, sequence.reference)


def _read_images(
    place: Path, topics: Sequence[str], camera: Camera | None, frame_rate_hz: float | None
) -> ImageSequence:
    """Read a bag or a folder; refuse topics of a folder, and fewer than two images."""
    if topics and not is_bag(place):
        raise ConfigError(f"{place} is no bag and has no topics; leave --topic out.")
    if is_bag(place):
        if frame_rate_hz is not None:
            raise ConfigError(f"{place} is a bag, whose images have times; leave --frame-rate out.")
        sequence = read_bag(place, topics, camera)
    else:
        sequence = read_sequence(place, camera, frame_rate_hz)
    if len(sequence.frames) < 2:
        raise InputError(f"{place} holds one image; motion needs at least two.")
    _refuse_other_units(sequence, place)
    return sequence


def _with_fixes(sequence: ImageSequence, log: GpsLog, crs: CRS | str | None, shift_s: float) -> RecordedDrive:
    """Place images in the CRS of their fixes."""
    recording = georeference(sequence, log, crs, shift_s)
    notes = (*sequence.notes, *log.notes, f"works in {recording.crs.name}")
    if log.n_without_fix:
        notes += (f"{log.n_without_fix} records of the receiver without a fix are left out",)
    if sequence.wheels is None:
        notes += ("no wheels: the scale is that of the fixes",)
    return RecordedDrive(recording, notes)


def _firnline_recording(place: Path) -> RecordedDrive:
    """Read a recording and check all its images."""
    recording = Recording.read(place)
    frames, camera = recording.frames, recording.camera
    if frames is not None and camera is not None and isinstance(frames.images, ImageFiles):
        for file in frames.images.files:
            refuse_cut_off(file)
        refuse_other_sizes(frames.images.files, camera)
    _refuse_other_units(recording, place)
    return RecordedDrive(recording)


def _refuse_other_units(records: VisionRecords, place: Path) -> None:
    """Refuse inertial readings and encoders in other units or axes, with the name of the recording."""
    try:
        refuse_other_units(records.inertial, records.wheels)
    except InputError as error:
        raise InputError(f"{place}: {error}") from error

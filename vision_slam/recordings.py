"""Open a recording of any supported kind and check its units.

`open_recording` reads a firnline recording, a ROS bag or a folder of images, adds calibration and fixes from other
files, and returns a `RecordedDrive`. `refuse_other_units` recognizes inertial readings and encoders in wrong units or
axes by gravity, by rates of turn and by the speed of the wheels.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pyproj import CRS

from survey import Camera, ConfigError, InputError, Recording
from survey.core import FloatArray
from survey.data.frames import ImageFiles
from survey.data.sensors.records import Inertial, Wheels
from vision_slam.readers.bags import is_bag, read_bag
from vision_slam.readers.calibrations import read_calibration
from vision_slam.readers.folders import read_sequence
from vision_slam.readers.gps_files import read_gps
from vision_slam.readers.images import refuse_cut_off_image, refuse_other_sizes
from vision_slam.readers.sequence import (
    GpsLog,
    ImageSequence,
    VisionRecords,
    georeference,
    scale_by_reference,
)
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

    `gps_shift_s`: added to the times of the fixes [s]. `scale_from_m`: take the scale from the first metres
    of the layout's reference [m].
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
            refuse_cut_off_image(file)
        refuse_other_sizes(frames.images.files, camera)
    _refuse_other_units(recording, place)
    return RecordedDrive(recording)


def _refuse_other_units(records: VisionRecords, place: Path) -> None:
    """Refuse inertial readings and encoders in other units or axes, with the name of the recording."""
    try:
        refuse_other_units(records.inertial, records.wheels)
    except InputError as error:
        raise InputError(f"{place}: {error}") from error


_GRAVITY_M_S2 = 9.81
# Median length of the specific force over gravity; vibration makes it longer.
_LEAST_FORCE, _MOST_FORCE = 0.8, 1.5
_LEAST_UP = 0.5  # share of the force along z, that of a slope of 60°
# No rover turns at more than 3 rad/s in a twentieth of a drive, or in full circles a second for three seconds.
_FAST_PERCENTILE, _FAST_RAD_S = 95.0, 3.0
_FASTEST_SECONDS, _FASTEST_RAD_S = 3, 2.0 * np.pi
_FASTEST_M_S = 30.0
# No rover turns on the spot for so long, and goes nowhere in between.
_ROLLED_M, _OPPOSED_SHARE = 20.0, 0.1
_WINDOW_S = 1.0


def refuse_other_units(inertial: Inertial | None, wheels: Wheels | None) -> None:
    """Refuse readings of inertial unit and encoders whose units or axes are not those of a recording.

    >>> level = np.tile([0.0, 0.0, 9.81], (3, 1))
    >>> refuse_other_units(Inertial(np.arange(3.0), np.zeros((3, 3)), level), None)
    """
    if inertial is not None:
        _refuse_fast_turns(inertial)
        if inertial.specific_force_m_s2.any():
            _refuse_other_force(inertial.specific_force_m_s2)
            # Without wheels the axes may be any that the mounting of the camera belongs to.
            if wheels is not None:
                _refuse_other_axes(inertial.specific_force_m_s2)
    if wheels is not None and len(wheels) > 1:
        _refuse_fast_wheels(wheels)
        _refuse_opposed_wheels(wheels)


def _refuse_fast_turns(inertial: Inertial) -> None:
    """Refuse rates that no rover turns at for long; outliers of single readings do not count."""
    rates = np.linalg.norm(inertial.gyro_rad_s, axis=1)
    seconds = np.floor((inertial.time_s - inertial.time_s[0]) / _WINDOW_S)
    parts = np.split(rates, np.flatnonzero(np.diff(seconds)) + 1)
    medians = np.sort([np.median(part) for part in parts])
    often, seldom = (
        float(np.percentile(medians, _FAST_PERCENTILE)),
        float(medians[max(-_FASTEST_SECONDS, -len(medians))]),
    )
    if often > _FAST_RAD_S or seldom > _FASTEST_RAD_S:
        raise InputError(
            f"the gyro turns at {max(often, seldom):.1f} rad/s for seconds, and no rover turns so fast; "
            "where the rates are in degrees per second, multiply them by 0.0174533."
        )


def _refuse_other_force(force: FloatArray) -> None:
    """Refuse forces (N, 3) whose median length is not that of gravity."""
    length = float(np.median(np.linalg.norm(force, axis=1)))
    share = length / _GRAVITY_M_S2
    if _LEAST_FORCE <= share <= _MOST_FORCE:
        return
    remedy = "write m/s²"
    if _LEAST_FORCE <= length <= _MOST_FORCE:
        remedy = "it is in g, multiply it by 9.81"
    elif share < _LEAST_FORCE:
        remedy = "record it with gravity, and in m/s²"
    raise InputError(
        f"the specific force of the inertial readings has a median length of {length:.3g}, and 9.8 m/s² was expected; {remedy}."
    )


def _refuse_other_axes(force: FloatArray) -> None:
    """Refuse forces (N, 3) that do not point along z."""
    up = float(np.median(force[:, 2]))
    length = float(np.median(np.linalg.norm(force, axis=1)))
    if up >= _LEAST_UP * length:
        return
    if up <= -_LEAST_UP * length:
        raise InputError(
            f"the specific force along z has a median of {up:.2f} m/s², and +9.8 m/s² was expected; where the axes are x "
            "forward, y right, z down, change the sign of y and z of gyro and force."
        )
    x, y, z = np.median(force, axis=0).tolist()
    raise InputError(
        f"the specific force has medians of {x:.2f}, {y:.2f}, {z:.2f} m/s² along x, y, z, and +9.8 m/s² along z was expected; "
        "turn gyro and force into the axes of the body, x forward, y left, z up."
    )


def _refuse_fast_wheels(wheels: Wheels) -> None:
    """Refuse encoders whose median speed, where they roll, is that of no rover."""
    time_s = wheels.time_s
    n_windows = max(1, int((time_s[-1] - time_s[0]) / _WINDOW_S))
    at_s = np.linspace(time_s[0], time_s[-1], n_windows + 1)
    rolled = np.interp(at_s, time_s, 0.5 * (wheels.left_m + wheels.right_m))
    speed = np.abs(np.diff(rolled)) / np.diff(at_s)
    rolling = speed[speed > 0.0]
    if len(rolling) and np.median(rolling) > _FASTEST_M_S:
        raise InputError(
            f"the wheels roll at a median of {np.median(rolling):.0f} m/s, and no rover is faster than {_FASTEST_M_S:g} m/s; "
            "where left_m and right_m are ticks or millimetres, convert them to metres."
        )


def _refuse_opposed_wheels(wheels: Wheels) -> None:
    """Refuse encoders of which one side counts backward whenever the other counts forward."""
    left, right = np.diff(wheels.left_m), np.diff(wheels.right_m)
    sides_m = [float(np.abs(side).sum()) for side in (left, right)]
    together_m = 0.5 * float(np.abs(left + right).sum())
    if min(sides_m) > _ROLLED_M and together_m < _OPPOSED_SHARE * min(sides_m):
        raise InputError(
            f"the left wheels roll {sides_m[0]:.0f} m and the right ones {sides_m[1]:.0f} m, in opposite directions from the "
            "start to the end; change the sign of the side that counts backward."
        )

"""Open a recording of any supported kind and check its units.

`open_recording` reads a firnline recording, a ROS bag or a folder of images, adds calibration and fixes from other
files, and returns a `RecordedDrive`. `refuse_other_units` recognizes inertial readings and encoders in wrong units or
axes by gravity, by rates of turn and by the speed of the wheels.

`read_sequence` recognizes the layouts of KITTI, EuRoC and TUM by their files, which `vision_slam.readers.datasets` reads,
and tables ``frames.csv``. `read_images` reads plain images: their times are from a list, file names, EXIF or a frame rate,
their calibration is from ``camera.toml`` or EXIF. Videos and raw photographs are refused; the message names the conversion.
"""

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pyproj import CRS

from survey import Camera, ConfigError, InputError, Recording
from survey.core import FloatArray
from survey.data.camera import off_centre_note
from survey.data.frames import Frames, ImageFiles
from survey.data.sensors.records import Inertial, Wheels
from vision_slam.readers.bags import is_bag, read_bag
from vision_slam.readers.calibrations import FORWARD, calibrated_camera, read_calibration
from vision_slam.readers.datasets import (
    KITTI_IMAGES,
    RAW_CAMERAS,
    raw_camera_folder,
    read_euroc_sequence,
    read_kitti_raw,
    read_kitti_sequence,
    read_tum_sequence,
)
from vision_slam.readers.gps_files import is_receiver_log, read_gps
from vision_slam.readers.images import (
    assemble_sequence,
    image_files,
    read_numbers,
    refuse_cut_off_image,
    refuse_other_sizes,
    require_as_many,
)
from vision_slam.readers.photos import (
    Photo,
    PhotoTimes,
    checked_photos,
    frame_numbers,
    is_jpeg,
    photo_camera,
    photo_fixes,
    photo_times,
    times_in_names,
)
from vision_slam.readers.sequence import (
    GpsLog,
    ImageSequence,
    MotionRecords,
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
    antenna_m: float | None = None,
) -> RecordedDrive:
    """Open a firnline recording, a ROS bag, a folder of images, or the log of a receiver, and check it.

    `antenna_m`: height of the antenna above the ground [m]. `gps_shift_s`: added to the times of the fixes [s]. `scale_from_m`: take the scale from the first metres
    of the layout's reference [m].
    """
    place = Path(source)
    if not place.exists():
        raise InputError(f"{place} does not exist; check the path.")
    if (place / "recording.json").is_file():
        own = (antenna_m, scale_from_m)
        if camera or topics or gps or crs or frame_rate_hz or any(value is not None for value in own):
            raise ConfigError(
                f"{place} is a recording with calibration, fixes and CRS of its own; leave --camera, --topic, --gps, --crs, --frame-rate, --scale-from and --antenna out."
            )
        return _firnline_recording(place)
    if place.is_file() and not is_bag(place):
        images = (camera, topics or None, gps, frame_rate_hz, scale_from_m, gps_shift_s or None)
        return _log_of_fixes(
            place, columns, crs, antenna_m, has_image_options=any(v is not None for v in images)
        )
    if columns and gps is None:
        raise ConfigError("--columns names columns of a table of fixes; name the table with --gps.")
    lens, lens_notes = (None, ()) if camera is None else read_calibration(camera)
    sequence = _read_images(place, topics, lens, frame_rate_hz)
    if isinstance(sequence, MotionRecords):
        unused = {"--camera": camera, "--scale-from": scale_from_m}
        stated = [name for name, value in unused.items() if value is not None]
        if stated:
            raise ConfigError(f"{place} is a bag without images; leave {', '.join(stated)} out.")
        log = sequence.gps if gps is None else read_gps(gps, columns)
        return _without_images(sequence, log, crs, gps_shift_s, antenna_m)
    sequence = replace(sequence, notes=(*lens_notes, *_lens_notes(sequence.camera), *sequence.notes))
    if scale_from_m is not None:
        sequence = scale_by_reference(sequence, scale_from_m)
    log = sequence.gps if gps is None else read_gps(gps, columns)
    if log is not None:
        return _with_fixes(sequence, log, crs, gps_shift_s, antenna_m or 0.0)
    if crs is not None or gps_shift_s != 0.0 or antenna_m is not None:
        raise ConfigError(
            f"{place} holds no fixes; --crs, --gps-shift and --antenna need some, name them with --gps."
        )
    notes = sequence.notes
    if sequence.wheels is None:
        notes += ("no wheels and no fixes: lengths are no metres, the first step counts as one",)
    return RecordedDrive(sequence, notes, sequence.reference_time_s, sequence.reference)


def _read_images(
    place: Path, topics: Sequence[str], camera: Camera | None, frame_rate_hz: float | None
) -> ImageSequence | MotionRecords:
    """Read a bag or a folder; refuse topics of a folder, and a single image."""
    if topics and not is_bag(place):
        raise ConfigError(f"{place} is no bag and has no topics; leave --topic out.")
    if is_bag(place):
        if frame_rate_hz is not None:
            raise ConfigError(f"{place} is a bag, whose images have times; leave --frame-rate out.")
        sequence: ImageSequence | MotionRecords = read_bag(place, topics, camera)
    else:
        sequence = read_sequence(place, camera, frame_rate_hz)
    if sequence.frames is not None and len(sequence.frames) < 2:
        raise InputError(f"{place} holds one image; motion needs at least two.")
    _refuse_other_units(sequence, place)
    return sequence


def _without_images(
    records: MotionRecords, log: GpsLog | None, crs: CRS | str | None, shift_s: float, antenna_m: float | None
) -> RecordedDrive:
    """Open a drive of wheels, gyro and fixes, or of some of them; without fixes its path begins at 0."""
    if log is None:
        if crs is not None or shift_s != 0.0 or antenna_m is not None:
            raise ConfigError(
                "the bag holds no fixes; --crs, --gps-shift and --antenna need some, name them with --gps."
            )
        return RecordedDrive(records, records.notes)
    recording = georeference(records, log, crs, shift_s)
    return RecordedDrive.of_fixes(recording, (*records.notes, *_fix_notes(log, recording.crs)), antenna_m)


_TABLES_OF_FIXES = (".csv", ".tsv")


def _log_of_fixes(
    file: Path,
    columns: Sequence[str],
    crs: CRS | str | None,
    antenna_m: float | None,
    *,
    has_image_options: bool,
) -> RecordedDrive:
    """Open the log of a receiver as the drive of its antenna."""
    refuse_kind(file)
    if not (is_receiver_log(file) or file.suffix.lower() in _TABLES_OF_FIXES or columns):
        raise InputError(
            f"{file} is no folder of images, no bag and no log of fixes; name one of these, or a table of fixes with --columns."
        )
    if has_image_options:
        raise ConfigError(
            f"{file} is a log of fixes without images; leave --camera, --topic, --gps, --gps-shift, --frame-rate and --scale-from out."
        )
    log = read_gps(file, columns)
    if len(log.time_s) < 2:
        raise InputError(f"{file} holds {len(log.time_s)} fix; a path needs at least two, record for longer.")
    fixes, working = log.fixes(crs)
    recording = Recording(
        working, fixes.position[0], fixes, vertical_datum=log.vertical_datum, start_is_surveyed=False
    )
    return RecordedDrive.of_fixes(recording, _fix_notes(log, working), antenna_m)


def _fix_notes(log: GpsLog, working: CRS) -> tuple[str, ...]:
    """Return what was read of a log and left out."""
    without = f"{log.n_without_fix} records of the receiver without a fix are left out"
    return (*log.notes, f"works in {working.name}", *([without] if log.n_without_fix else []))


def _with_fixes(
    sequence: ImageSequence, log: GpsLog, crs: CRS | str | None, shift_s: float, antenna_m: float
) -> RecordedDrive:
    """Place images in the CRS of their fixes."""
    recording = replace(georeference(sequence, log, crs, shift_s), antenna_height_m=antenna_m)
    notes = (*sequence.notes, *_fix_notes(log, recording.crs))
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
    return RecordedDrive(recording, _lens_notes(camera))


def _lens_notes(camera: Camera | None) -> tuple[str, ...]:
    note = None if camera is None else off_centre_note(camera)
    return () if note is None else (note,)


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


def read_sequence(
    folder: str | Path, camera: Camera | None = None, frame_rate_hz: float | None = None
) -> ImageSequence:
    """Read a folder of images in one of the supported layouts.

    KITTI odometry: ``calib.txt`` beside ``image_0`` or ``image_l``; raw: ``image_00/data`` with
    ``calib_cam_to_cam.txt`` there or one folder above. TUM: ``rgb.txt``.
    EuRoC: ``mav0/cam0`` or ``cam0``. Otherwise a table ``frames.csv`` (time_s,file) in the folder
    or in its ``frames``; or images in the folder or in its ``images``, whose times stand in
    ``times.txt`` or ``timestamps.txt`` (seconds, one a line, in the natural order of the file
    names), are the file names themselves (seconds, or whole nanoseconds), or stand in EXIF or in
    names such as ``IMG_20240612_101502.jpg``; frames of a video have a rate. TUM and folders of
    images are calibrated by ``camera.toml``; photographs without one take the focal length
    that EXIF states. Positions in EXIF become fixes. Beside plain images, ``wheels.csv`` and
    ``inertial.csv`` as in a recording are read too.

    All images are checked for completeness and size before any is used.
    """
    place = Path(folder)
    if not place.is_dir():
        raise InputError(f"{place} is no folder; name the folder of a recording.")
    if frame_rate_hz is not None:
        _refuse_rate(place)
    layout = _named_layout(place, camera) if frame_rate_hz is None else None
    if layout is not None:
        return replace(layout, notes=(*layout.notes, *_unread_folders(place)))
    for inner in (place, place / "images"):
        files = image_files(inner)
        if files:
            return _with_motion(read_images(place, inner, files, camera, frame_rate_hz), place)
    refuse_other_kinds(place)
    raise InputError(
        f"{place} has no layout that is known (KITTI calib.txt or image_00/data, TUM rgb.txt, EuRoC cam0/data.csv, "
        "or images with times and camera.toml); add frames.csv with the columns time_s,file."
    )


# Folders of the layouts: those that are read, and the name of any of a kind.
_FOLDERS = (
    ("image_*", (*KITTI_IMAGES, *RAW_CAMERAS)), ("cam?", ("cam0",)), ("imu?", ("imu0",)), ("leica?", ()),
    ("vicon?", ()), ("velodyne*", ()), ("depth", ()),
)  # fmt: skip


def _unread_folders(place: Path) -> tuple[str, ...]:
    """Return a note of the folders of a layout that hold other cameras and sensors."""
    unread: list[str] = []
    for inner in (place, place / "mav0"):
        for pattern, read in _FOLDERS:
            found = sorted(folder.name for folder in inner.glob(pattern) if folder.is_dir())
            taken = next((name for name in read if name in found), None)
            unread += [name for name in found if name != taken]
    return (f"not read: {', '.join(unread)}",) if unread else ()


def _named_layout(place: Path, camera: Camera | None) -> ImageSequence | None:
    """Read a layout that a file of its own identifies; None for plain images."""
    if (place / "calib.txt").is_file():
        return read_kitti_sequence(place, camera)
    if raw_camera_folder(place) is not None:
        return read_kitti_raw(place, camera)
    if (place / "rgb.txt").is_file():
        return read_tum_sequence(place, camera)
    for table in _euroc_tables(place):
        if table.is_file():
            return read_euroc_sequence(table.parent.parent, camera)
    for table in _frame_tables(place):
        if table.is_file():
            frames = Frames.read(table.parent)
            assert isinstance(frames.images, ImageFiles)
            files = list(frames.images.files)
            return _with_motion(
                assemble_sequence(camera or calibrated_camera(place), frames.time_s, files), place
            )
    return None


def _refuse_rate(place: Path) -> None:
    """Refuse a frame rate for a layout whose images have times."""
    has_images = any((place / name).is_dir() for name in KITTI_IMAGES)
    timed = {
        "KITTI odometry": place / "calib.txt" if has_images else None,
        "raw KITTI": raw_camera_folder(place),
        "TUM": place / "rgb.txt",
        "EuRoC": next((file for file in _euroc_tables(place) if file.is_file()), None),
        "frames.csv": next((file for file in _frame_tables(place) if file.is_file()), None),
    }
    layout = next((name for name, file in timed.items() if file is not None and file.exists()), None)
    if layout is not None:
        raise ConfigError(
            f"{place} has the layout {layout}, whose images have times of their own; leave --frame-rate out."
        )


def _euroc_tables(place: Path) -> tuple[Path, Path]:
    """Return where a folder in the layout of EuRoC has its list of images."""
    return place / "mav0" / "cam0" / "data.csv", place / "cam0" / "data.csv"


def _frame_tables(place: Path) -> tuple[Path, Path]:
    """Return where a folder has its table of images."""
    return place / "frames.csv", place / "frames" / "frames.csv"


def _with_motion(sequence: ImageSequence, place: Path) -> ImageSequence:
    """Add wheels and inertial readings to images, where the folder has tables of them."""
    files = place / "wheels.csv", place / "inertial.csv"
    wheels = Wheels.read(files[0]) if files[0].exists() else None
    inertial = Inertial.read(files[1]) if files[1].exists() else None
    for file, records in zip(files, (wheels, inertial), strict=True):
        if records is not None:
            _refuse_other_times(file, records.time_s, sequence.frames.time_s)
    return replace(sequence, wheels=wheels, inertial=inertial)


def _refuse_other_times(file: Path, time_s: FloatArray, frame_s: FloatArray) -> None:
    """Refuse readings none of which fall into the time of the images."""
    if time_s[-1] <= frame_s[0] or time_s[0] >= frame_s[-1]:
        raise InputError(
            f"{file} covers {time_s[0]:.1f} to {time_s[-1]:.1f} s and the images {frame_s[0]:.1f} to {frame_s[-1]:.1f} s; "
            "put both on one clock."
        )


_LISTS_OF_TIMES = ("times.txt", "timestamps.txt")
_RAW = (".heic", ".heif", ".dng", ".nef", ".cr2", ".cr3", ".arw", ".avif", ".webp")
_BAGS = (".bag", ".mcap", ".db3")
_VIDEOS = (
    ".mp4",
    ".mov",
    ".avi",
    ".mkv",
    ".insv",
    ".360",
    ".m4v",
    ".mts",
    ".m2ts",
    ".wmv",
    ".webm",
    ".mpg",
    ".lrv",
    ".3gp",
)


def read_images(
    place: Path, inner: Path, files: list[Path], camera: Camera | None, frame_rate_hz: float | None
) -> ImageSequence:
    """Read the images of a plain folder."""
    times = _listed_times(place, inner, files)
    photos: list[Photo] = []
    if times is None:
        photos = checked_photos(files)
        times = photo_times(photos)
    if times is not None and frame_rate_hz is not None:
        raise ConfigError(f"the images in {inner} have times of their own; leave --frame-rate out.")
    if times is None:
        times = _at_rate(inner, files, frame_rate_hz)
    camera, camera_note = _camera_of_folder(place, files, photos, camera)
    sequence = assemble_sequence(camera, times.time_s, [files[index] for index in times.order])
    if not photos and all(map(is_jpeg, files)):
        photos = checked_photos(files)
    fixes, left_out = photo_fixes(photos, times) if photos else (None, ())
    return replace(
        sequence,
        gps=None if fixes is None else GpsLog(**fixes._asdict()).without_zero_places(str(inner)),
        notes=tuple(note for note in (times.note, camera_note, *sequence.notes, *left_out) if note),
    )


def refuse_other_kinds(place: Path) -> None:
    """Refuse a folder of bags, or of photographs or videos of kinds that are not read, with the next step."""
    files = [file for folder in (place, place / "images") if folder.is_dir() for file in folder.iterdir()]
    bag = next((file for file in sorted(files) if file.suffix.lower() in _BAGS), None)
    if bag is not None:
        raise InputError(
            f"{bag} is a bag in a folder that is no recording; name the bag instead of its folder."
        )
    for file in sorted(files):
        refuse_kind(file)


def refuse_kind(file: Path) -> None:
    """Refuse a photograph or video of a kind that is not read, with the conversion."""
    if file.suffix.lower() in _RAW:
        raise InputError(f"{file} is of a kind that is not read; convert the images to JPEG or PNG.")
    if file.suffix.lower() in _VIDEOS:
        raise InputError(
            f"{file} is a video; extract its images (ffmpeg -i {shlex.quote(file.name)} images/%06d.png, into a folder images that "
            "is there), name that folder and give the images per second with --frame-rate."
        )


def _listed_times(place: Path, inner: Path, files: list[Path]) -> PhotoTimes | None:
    """Return the times of a list or of names that are numbers; None where there are neither."""
    order = list(range(len(files)))
    for listed in (folder / name for folder in (inner, place) for name in _LISTS_OF_TIMES):
        if listed.is_file():
            times = read_numbers(listed, 1)[:, 0]
            require_as_many(times, files, listed)
            return PhotoTimes(times, order, "")
    if times_in_names(files) is not None or frame_numbers(files) is not None:
        return None
    try:
        times = np.array([float(file.stem) for file in files])
    except ValueError:
        return None
    return PhotoTimes(times, order, "")


def _at_rate(inner: Path, files: Sequence[Path], frame_rate_hz: float | None) -> PhotoTimes:
    """Return the times of images that come at a rate."""
    if frame_rate_hz is None:
        raise InputError(
            f"the images in {inner} have no times in a list, in EXIF or in their names (such as {files[0].name}); name "
            "--frame-rate for those of a video, or add times.txt with one time [s] a line."
        )
    counted, missing = _counted(files)
    note = f"times are those of {frame_rate_hz:g} images a second, in the order of the names{missing}"
    return PhotoTimes(counted / frame_rate_hz, list(range(len(files))), note)


def _counted(files: Sequence[Path]) -> tuple[FloatArray, str]:
    """Count images from the first one, and those that are missing in the numbers of the names, and state these."""
    numbers = frame_numbers(files)
    if numbers is None or len(files) < 3:
        return np.arange(float(len(files))), ""
    steps = np.diff(numbers) / np.diff(numbers).min()
    n_missing = int(np.rint(steps - 1.0).sum())
    counted = np.concatenate([[0.0], np.cumsum(steps)])
    return counted, f"; {n_missing} that their numbers leave out count as images" if n_missing else ""


def _camera_of_folder(
    place: Path, files: list[Path], photos: list[Photo], camera: Camera | None
) -> tuple[Camera, str]:
    """Return the calibration that is named, that of the folder, or that of EXIF, and a note of the last."""
    if camera is not None:
        return camera, ""
    if (place / "camera.toml").is_file():
        return calibrated_camera(place), ""
    found = photo_camera(photos or checked_photos(files), FORWARD)
    if found is None:
        return calibrated_camera(place), ""  # refuses with the remedy
    return found

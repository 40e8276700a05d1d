"""Folders of images: recognition of the layout, and plain folders.

`read_sequence` recognizes the layouts of KITTI, EuRoC and TUM by their files, which `vision_slam.readers.datasets` reads,
and tables ``frames.csv``. `read_images` reads plain images: their times are from a list, file names, EXIF or a frame rate, their calibration is from ``camera.toml`` or
EXIF. Videos and raw photographs are refused; the message names the conversion.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from survey import Camera, ConfigError, InputError
from survey.core import FloatArray
from survey.data.frames import Frames, ImageFiles
from survey.data.sensors.records import Inertial, Wheels
from vision_slam.readers.calibrations import FORWARD, calibrated_camera
from vision_slam.readers.datasets import (
    KITTI_IMAGES,
    raw_camera_folder,
    read_euroc_sequence,
    read_kitti_raw,
    read_kitti_sequence,
    read_tum_sequence,
)
from vision_slam.readers.images import (
    assemble_sequence,
    image_files,
    read_numbers,
    require_as_many,
)
from vision_slam.readers.photos import (
    Photo,
    PhotoTimes,
    checked_photos,
    frame_numbers,
    photo_camera,
    photo_fixes,
    photo_times,
    times_in_names,
)
from vision_slam.readers.sequence import GpsLog, ImageSequence


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
        return layout
    for inner in (place, place / "images"):
        files = image_files(inner)
        if files:
            return _with_motion(read_images(place, inner, files, camera, frame_rate_hz), place)
    refuse_other_kinds(place)
    raise InputError(
        f"{place} has no layout that is known (KITTI calib.txt or image_00/data, TUM rgb.txt, EuRoC cam0/data.csv, "
        "or images with times and camera.toml); add frames.csv with the columns time_s,file."
    )


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
_VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".insv", ".360")


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
    fixes = photo_fixes(photos, times) if photos else None
    return replace(
        sequence,
        gps=None if fixes is None else GpsLog(**fixes._asdict()).without_zero_places(str(inner)),
        notes=tuple(note for note in (times.note, camera_note, *sequence.notes) if note),
    )


def refuse_other_kinds(place: Path) -> None:
    """Refuse a folder of bags, or of photographs or videos of kinds that are not read, with the next step."""
    files = [file for folder in (place, place / "images") if folder.is_dir() for file in folder.iterdir()]
    bag = next((file for file in sorted(files) if file.suffix.lower() in _BAGS), None)
    if bag is not None:
        raise InputError(
            f"{bag} is a bag in a folder that is no recording; name the bag instead of its folder."
        )
    raw = next((file for file in sorted(files) if file.suffix.lower() in _RAW), None)
    if raw is not None:
        raise InputError(f"{raw} is of a kind that is not read; convert the images to JPEG or PNG.")
    video = next((file for file in sorted(files) if file.suffix.lower() in _VIDEOS), None)
    if video is not None:
        raise InputError(
            f"{video} is a video; extract its images (ffmpeg -i {video.name} images/%06d.png) and name --frame-rate."
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

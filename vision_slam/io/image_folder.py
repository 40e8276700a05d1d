"""Plain folders of images: times from a list, names, EXIF or a frame rate; calibration from a file or EXIF."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import ConfigError, InputError
from survey.data.camera.calibration import Camera
from vision_slam.io.gps_log import GpsLog
from vision_slam.io.photos.exif import Photo
from vision_slam.io.photos.folder import PhotoTimes, checked_photos, photo_camera, photo_fixes, photo_times
from vision_slam.io.photos.names import frame_numbers, times_in_names
from vision_slam.io.sequence import ImageSequence
from vision_slam.io.sequence_files import (
    FORWARD,
    assemble_sequence,
    calibrated_camera,
    read_numbers,
    require_as_many,
)

_LISTS_OF_TIMES = ("times.txt", "timestamps.txt")
_RAW = (".heic", ".heif", ".dng", ".nef", ".cr2", ".cr3", ".arw", ".avif", ".webp")
_BAGS = (".bag", ".mcap", ".db3")
_VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".insv", ".360")


def read_images(
    place: Path, inner: Path, files: list[Path], camera: Camera | None, frame_rate_hz: float | None
) -> ImageSequence:
    """Read the images of a plain folder.

    Parameters
    ----------
    place, inner : Path
        The recording, and its folder of images.
    files : list of Path
        Images in their natural order.
    camera : Camera, optional
        Calibration to use instead of ``camera.toml`` and EXIF.
    frame_rate_hz : float, optional
        Images per second, for images without any times.

    Raises
    ------
    InputError, ConfigError
        As `vision_slam.io.readers.read_sequence` does.
    """
    times = _listed_times(place, inner, files)
    photos: list[Photo] = []
    if times is None:
        photos = checked_photos(files)
        times = photo_times(photos)
    if times is not None and frame_rate_hz is not None:
        raise ConfigError(f"the images in {inner} have times of their own; leave --frame-rate out.")
    if times is None:
        times = _at_rate(inner, files, frame_rate_hz)
    camera, camera_note = _camera(place, files, photos, camera)
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


def _camera(place: Path, files: list[Path], photos: list[Photo], camera: Camera | None) -> tuple[Camera, str]:
    """Return the calibration that is named, that of the folder, or that of EXIF, and a note of the last."""
    if camera is not None:
        return camera, ""
    if (place / "camera.toml").is_file():
        return calibrated_camera(place), ""
    found = photo_camera(photos or checked_photos(files), FORWARD)
    if found is None:
        return calibrated_camera(place), ""  # refuses with the remedy
    return found

"""Readers of KITTI, TUM and EuRoC layouts, and of folders of images."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import ConfigError, InputError
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Frames, ImageFiles
from survey.data.sensors.aiding import Inertial, Wheels
from vision_slam.io.euroc import read_euroc_sequence
from vision_slam.io.image_folder import read_images, refuse_other_kinds
from vision_slam.io.kitti import KITTI_IMAGES, read_kitti_sequence
from vision_slam.io.kitti_raw import raw_camera_folder, read_kitti_raw
from vision_slam.io.sequence import ImageSequence
from vision_slam.io.sequence_files import (
    assemble_sequence,
    calibrated_camera,
    image_files,
    poses_of,
    read_numbers,
    require_all_there,
)
from vision_slam.io.text import read_text


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

    Parameters
    ----------
    folder : str or pathlib.Path
        The recording.
    camera : Camera, optional
        Calibration to use instead of that of the layout.
    frame_rate_hz : float, optional
        Images per second, for images without any times.

    Returns
    -------
    ImageSequence
        Images with calibration, and reference poses where the layout has them.

    Raises
    ------
    InputError
        The layout is none of these, calibration or times lack, or do not fit the images, or
        an image is cut off.
    ConfigError
        A frame rate, and images that have times.
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
        return _tum(place, camera)
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


def _tum(place: Path, camera: Camera | None) -> ImageSequence:
    times, files = [], []
    for number, line in enumerate(read_text(place / "rgb.txt", "the list of images").splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        words = line.split()
        try:
            times.append(float(words[0]))
            files.append(place / words[1].replace("\\", "/"))
        except (ValueError, IndexError) as error:
            raise InputError(
                f"{place / 'rgb.txt'}, line {number}: {line!r} is no time and file; correct it."
            ) from error
    if not files:
        raise InputError(f"{place / 'rgb.txt'} names no images; get the complete sequence.")
    require_all_there(files)
    camera = camera or calibrated_camera(place)
    reference = None
    for file in sorted(place.glob("ground*.txt"))[:1]:  # the layout's reference poses
        rows = read_numbers(file, 8)
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        reference = (
            rows[:, 0],
            poses_of(rows[:, 1:4], rows[:, 4:8], file) @ np.linalg.inv(camera.T_body_camera),
        )
    return assemble_sequence(camera, np.array(times), files, reference=reference)

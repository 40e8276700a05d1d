"""Readers of KITTI, TUM and EuRoC layouts, and of folders of images with times."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Frames, ImageFiles
from survey.data.sensors.aiding import Inertial, Wheels
from vision_slam.io.euroc import read_euroc_sequence
from vision_slam.io.kitti import read_kitti_sequence
from vision_slam.io.sequence import ImageSequence
from vision_slam.io.sequence_files import (
    assemble_sequence,
    calibrated_camera,
    image_files,
    poses_of,
    read_numbers,
    require_all_there,
    require_as_many,
)

_LISTS_OF_TIMES = ("times.txt", "timestamps.txt")
_UNIX_NS = 1e15  # a file name that counts more than this counts nanoseconds


def read_sequence(folder: str | Path, camera: Camera | None = None) -> ImageSequence:
    """Read a folder of images in one of the supported layouts.

    KITTI odometry: ``calib.txt`` beside ``image_0`` or ``image_l``. TUM: ``rgb.txt``.
    EuRoC: ``mav0/cam0`` or ``cam0``. Otherwise images with times: a table ``frames.csv``
    (time_s,file) in the folder or in its ``frames``; or images in the folder or in its
    ``images``, whose times stand in ``times.txt`` or ``timestamps.txt`` (seconds, one a line,
    in the order of the file names) or are the file names themselves (seconds, or whole
    nanoseconds). TUM and folders of images are calibrated by ``camera.toml``;
    beside plain images, ``wheels.csv`` and ``inertial.csv`` as in a recording are read too.

    All images are checked for completeness and size before any is used.

    Parameters
    ----------
    folder : str or pathlib.Path
        The recording.
    camera : Camera, optional
        Calibration to use instead of that of the layout.

    Returns
    -------
    ImageSequence
        Images with calibration, and reference poses where the layout has them.

    Raises
    ------
    InputError
        The layout is none of these, calibration or times lack, or do not fit the images, or
        an image is cut off.
    """
    place = Path(folder)
    if not place.is_dir():
        raise InputError(f"{place} is no folder; name the folder of a recording.")
    if (place / "calib.txt").is_file():
        return read_kitti_sequence(place, camera)
    if (place / "rgb.txt").is_file():
        return _tum(place, camera)
    for inner in (place / "mav0", place):
        if (inner / "cam0" / "data.csv").is_file():
            return read_euroc_sequence(inner, camera)
    for inner in (place, place / "frames"):
        if (inner / "frames.csv").is_file():
            frames = Frames.read(inner)
            assert isinstance(frames.images, ImageFiles)
            return _with_motion(
                assemble_sequence(
                    camera or calibrated_camera(place), frames.time_s, list(frames.images.files)
                ),
                place,
            )
    for inner in (place, place / "images"):
        files = image_files(inner)
        if files:
            times = _times(place, inner, files)
            return _with_motion(assemble_sequence(camera or calibrated_camera(place), times, files), place)
    raise InputError(
        f"{place} has no layout that is known (KITTI calib.txt, TUM rgb.txt, EuRoC cam0/data.csv, "
        "or images with times and camera.toml); add frames.csv with the columns time_s,file."
    )


def _with_motion(sequence: ImageSequence, place: Path) -> ImageSequence:
    """Add wheels and inertial readings to images, where the folder has tables of them."""
    wheels, inertial = place / "wheels.csv", place / "inertial.csv"
    return replace(
        sequence,
        wheels=Wheels.read(wheels) if wheels.exists() else None,
        inertial=Inertial.read(inertial) if inertial.exists() else None,
    )


def _times(place: Path, inner: Path, files: list[Path]) -> FloatArray:
    """Return the times of the images of a plain folder: from their list, else from their names."""
    for listed in (folder / name for folder in (inner, place) for name in _LISTS_OF_TIMES):
        if listed.is_file():
            times = read_numbers(listed, 1)[:, 0]
            require_as_many(times, files, listed)
            return times
    try:
        times = np.array([float(file.stem) for file in files])
    except ValueError as error:
        raise InputError(
            f"{inner} has images and no times ({error}); add frames.csv with the columns time_s,file."
        ) from error
    if len(times) > 1 and np.array_equal(times, np.arange(times[0], times[0] + len(times))):
        raise InputError(
            f"the images in {inner} are numbered and have no times; add times.txt with one time [s] a line."
        )
    return times * 1e-9 if times[0] > _UNIX_NS else times


def _tum(place: Path, camera: Camera | None) -> ImageSequence:
    times, files = [], []
    for number, line in enumerate((place / "rgb.txt").read_text(encoding="utf-8").splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        words = line.split()
        try:
            times.append(float(words[0]))
            files.append(place / words[1])
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
        reference = (
            rows[:, 0],
            poses_of(rows[:, 1:4], rows[:, 4:8], file) @ np.linalg.inv(camera.T_body_camera),
        )
    return assemble_sequence(camera, np.array(times), files, reference=reference)

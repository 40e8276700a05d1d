"""Image sequences in the layout of raw KITTI recordings."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from pyproj import Proj
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.camera.calibration import Camera
from vision_slam.io.images import read_pixels
from vision_slam.io.sequence import ImageSequence
from vision_slam.io.sequence_files import (
    FORWARD,
    assemble_sequence,
    image_files,
    read_numbers,
    require_as_many,
)
from vision_slam.io.text import read_text

_CAMERAS = ("image_00", "image_02")
_CALIBRATION = "calib_cam_to_cam.txt"
_HEIGHT_M = 1.65
_LEAST_OXTS = 6  # latitude, longitude, height, roll, pitch, yaw


def raw_camera_folder(place: Path) -> Path | None:
    """Return the folder of the left camera of a raw KITTI recording; None for other layouts."""
    return next((place / name for name in _CAMERAS if (place / name / "data").is_dir()), None)


def read_kitti_raw(place: Path, camera: Camera | None) -> ImageSequence:
    """Read images, and poses of the inertial unit as reference, in the layout of raw KITTI recordings.

    The calibration ``calib_cam_to_cam.txt`` lies in the folder or in the one above it. Images of
    the rectified size take the rectified projection, whose distortion is assumed to be zero; others
    take matrix and distortion.
    """
    seen = raw_camera_folder(place)
    assert seen is not None
    files = image_files(seen / "data")
    if not files:
        raise InputError(f"{seen / 'data'} holds no images; get the complete recording.")
    times = _times(seen / "timestamps.txt")
    require_as_many(times, files, seen / "timestamps.txt")
    camera = camera or _calibrated(place, seen.name.removeprefix("image_"), files[0])
    return assemble_sequence(camera, times, files, reference=_reference(place / "oxts"))


def _times(file: Path) -> FloatArray:
    """Return times such as ``2011-09-26 13:02:25.594360375`` in seconds since 1970."""
    if not file.is_file():
        raise InputError(f"{file} is not there; get the complete recording with its timestamps.")
    times = []
    for number, line in enumerate(read_text(file, "the list of times").split("\n"), start=1):
        if not line.strip():
            continue
        whole, _, fraction = line.strip().partition(".")
        try:
            second = datetime.strptime(whole, "%Y-%m-%d %H:%M:%S").replace(tzinfo=UTC).timestamp()
            times.append(second + float(f"0.{fraction or '0'}"))
        except ValueError as error:
            raise InputError(f"{file}, line {number}: {line!r} is no date and time; correct it.") from error
    return np.array(times)


def _calibrated(place: Path, number: str, first: Path) -> Camera:
    """Return the camera of the calibration, forward on the body."""
    file = next(
        (folder / _CALIBRATION for folder in (place, place.parent) if (folder / _CALIBRATION).is_file()), None
    )
    if file is None:
        raise InputError(
            f"{place} is a raw KITTI recording without {_CALIBRATION}, there or in the folder above; put it there or "
            "name a calibration with --camera."
        )
    height, width = read_pixels(first).shape[:2]
    mounted = FORWARD.copy()
    mounted[2, 3] = _HEIGHT_M
    is_rectified = _numbers(file, f"S_rect_{number}", 2).astype(int).tolist() == [width, height]
    if is_rectified:
        matrix = _numbers(file, f"P_rect_{number}", 12).reshape(3, 4)[:, :3]
        return Camera("pinhole", width, height, matrix, np.zeros(5), mounted, distortion_is_assumed=True)
    matrix = _numbers(file, f"K_{number}", 9).reshape(3, 3)
    return Camera("pinhole", width, height, matrix, _numbers(file, f"D_{number}", 5), mounted)


def _numbers(file: Path, key: str, n: int) -> FloatArray:
    lines = read_text(file, "the calibration").splitlines()
    words = next((line.split(":", 1)[1].split() for line in lines if line.startswith(f"{key}:")), [])
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError:
        numbers = np.zeros(0)
    if len(numbers) != n:
        raise InputError(
            f"{file} gives no {key} of {n} numbers; get the calibration of this recording again."
        )
    return numbers


def _reference(place: Path) -> tuple[FloatArray, FloatArray] | None:
    """Return times and poses of the inertial unit, which looks along x; None where they are not there."""
    files = sorted((place / "data").glob("*.txt")) if (place / "data").is_dir() else []
    if not files or not (place / "timestamps.txt").is_file():
        return None
    rows = np.array([_first_numbers(file) for file in files])
    times = _times(place / "timestamps.txt")
    require_as_many(times, files, place / "timestamps.txt")
    level = Proj(proj="tmerc", lat_0=rows[0, 0], lon_0=rows[0, 1], ellps="WGS84")
    east, north = level(rows[:, 1], rows[:, 0])
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    # Yaw counts from east, and pitch is positive with the nose down.
    poses[:, :3, :3] = Rotation.from_euler("ZYX", rows[:, [5, 4, 3]]).as_matrix()
    poses[:, :3, 3] = np.column_stack([east, north, rows[:, 2]])
    return times, poses


def _first_numbers(file: Path) -> FloatArray:
    row: FloatArray = read_numbers(file, None)[0]
    if len(row) < _LEAST_OXTS:
        raise InputError(
            f"{file} has {len(row)} numbers; latitude, longitude, height, roll, pitch and yaw were expected."
        )
    return row[:_LEAST_OXTS]

"""Image sequences in the layouts of KITTI odometry, raw KITTI, EuRoC and TUM, and reference poses.

Each function reads images, times, calibration and, where the layout has them, reference poses. Rectified KITTI images have
an assumed distortion of zero. EuRoC poses are those of the inertial unit; one that does not look ahead is rotated to the
axes of the camera. `read_poses` reads reference poses in a frame of their own: KITTI text with twelve numbers a line, or TUM
text.
"""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import yaml
from pyproj import Proj
from scipy.spatial.transform import Rotation

from survey import Camera, InputError
from survey.core import FloatArray, existing_file
from survey.data.sensors.records import Inertial
from survey.io.trajectory_files import read_tum
from vision_slam.readers.calibrations import FORWARD, calibrated_camera
from vision_slam.readers.images import (
    assemble_sequence,
    image_files,
    kitti_poses,
    poses_of,
    read_numbers,
    read_pixels,
    read_text,
    require_all_there,
    require_as_many,
)
from vision_slam.readers.sequence import ImageSequence

KITTI_IMAGES = ("image_0", "image_l", "image_2")
_CAMERA_HEIGHT_M = 1.65  # of KITTI's cameras above the ground
_KITTI_PERIOD_S = 0.1


def read_kitti_sequence(place: Path, camera: Camera | None) -> ImageSequence:
    """Read images and reference poses in the layout of KITTI odometry."""
    names = next((name for name in KITTI_IMAGES if (place / name).is_dir()), None)
    if names is None:
        raise InputError(f"{place} has calib.txt and no image_0, image_l or image_2; get the images.")
    files = image_files(place / names)
    if not files:
        raise InputError(f"{place / names} holds no images; get the complete sequence.")
    if (place / "times.txt").is_file():
        times = read_numbers(place / "times.txt", 1)[:, 0]
    else:
        times = _KITTI_PERIOD_S * np.arange(float(len(files)))
    require_as_many(times, files, place)
    if camera is None:
        mounted = FORWARD.copy()
        mounted[2, 3] = _CAMERA_HEIGHT_M
        height, width = read_pixels(files[0]).shape[:2]
        matrix = _kitti_matrix(place / "calib.txt")
        camera = Camera(
            "pinhole", width, height, matrix, np.zeros(5), mounted, distortion_is_assumed=True
        )  # images that are said to be rectified keep 10 pixels of distortion at the border
    reference = None
    if (place / "poses.txt").is_file():
        rows = read_numbers(place / "poses.txt", 12)
        require_as_many(rows, files, place / "poses.txt")
        poses = kitti_poses(rows, place / "poses.txt")
        reference = (times, camera.T_body_camera @ poses @ np.linalg.inv(camera.T_body_camera))
    return assemble_sequence(camera, times, files, reference=reference)


def _kitti_matrix(file: Path) -> FloatArray:
    """Return the left camera of a KITTI calibration: the first projection, with or without its label."""
    words = read_text(file, "the calibration").splitlines()[0].split()
    try:
        numbers = [float(word) for word in words if not word.endswith(":")]
    except ValueError:
        numbers = []
    if len(numbers) < 12:
        raise InputError(f"{file} gives no projection in its first line; 12 numbers (3 × 4) were expected.")
    matrix: FloatArray = np.array(numbers[:12]).reshape(3, 4)[:, :3]
    return matrix


def read_tum_sequence(place: Path, camera: Camera | None) -> ImageSequence:
    """Read images by the list ``rgb.txt`` of TUM, and reference poses where there are any."""
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


RAW_CAMERAS = ("image_00", "image_02")
_RAW_CALIBRATION = "calib_cam_to_cam.txt"
_LEAST_OXTS = 6  # latitude, longitude, height, roll, pitch, yaw


def raw_camera_folder(place: Path) -> Path | None:
    """Return the folder of the left camera of a raw KITTI recording; None for other layouts."""
    return next((place / name for name in RAW_CAMERAS if (place / name / "data").is_dir()), None)


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
    times = _raw_times(seen / "timestamps.txt")
    require_as_many(times, files, seen / "timestamps.txt")
    camera = camera or _raw_camera(place, seen.name.removeprefix("image_"), files[0])
    return assemble_sequence(camera, times, files, reference=_oxts_reference(place / "oxts"))


def _raw_times(file: Path) -> FloatArray:
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


def _raw_camera(place: Path, number: str, first: Path) -> Camera:
    """Return the camera of the calibration, forward on the body."""
    file = next(
        (
            folder / _RAW_CALIBRATION
            for folder in (place, place.parent)
            if (folder / _RAW_CALIBRATION).is_file()
        ),
        None,
    )
    if file is None:
        raise InputError(
            f"{place} is a raw KITTI recording without {_RAW_CALIBRATION}, there or in the folder above; put it there or "
            "name a calibration with --camera."
        )
    height, width = read_pixels(first).shape[:2]
    mounted = FORWARD.copy()
    mounted[2, 3] = _CAMERA_HEIGHT_M
    is_rectified = _raw_numbers(file, f"S_rect_{number}", 2).astype(int).tolist() == [width, height]
    if is_rectified:
        matrix = _raw_numbers(file, f"P_rect_{number}", 12).reshape(3, 4)[:, :3]
        return Camera("pinhole", width, height, matrix, np.zeros(5), mounted, distortion_is_assumed=True)
    matrix = _raw_numbers(file, f"K_{number}", 9).reshape(3, 3)
    return Camera("pinhole", width, height, matrix, _raw_numbers(file, f"D_{number}", 5), mounted)


def _raw_numbers(file: Path, key: str, n: int) -> FloatArray:
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


def _oxts_reference(place: Path) -> tuple[FloatArray, FloatArray] | None:
    """Return times and poses of the inertial unit, which looks along x; None where they are not there."""
    files = sorted((place / "data").glob("*.txt")) if (place / "data").is_dir() else []
    if not files or not (place / "timestamps.txt").is_file():
        return None
    rows = np.array([_oxts_numbers(file) for file in files])
    times = _raw_times(place / "timestamps.txt")
    require_as_many(times, files, place / "timestamps.txt")
    level = Proj(proj="tmerc", lat_0=rows[0, 0], lon_0=rows[0, 1], ellps="WGS84")
    east, north = level(rows[:, 1], rows[:, 0])
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    # Yaw counts from east, and pitch is positive with the nose down.
    poses[:, :3, :3] = Rotation.from_euler("ZYX", rows[:, [5, 4, 3]]).as_matrix()
    poses[:, :3, 3] = np.column_stack([east, north, rows[:, 2]])
    return times, poses


def _oxts_numbers(file: Path) -> FloatArray:
    row: FloatArray = read_numbers(file, None)[0]
    if len(row) < _LEAST_OXTS:
        raise InputError(
            f"{file} has {len(row)} numbers; latitude, longitude, height, roll, pitch and yaw were expected."
        )
    return row[:_LEAST_OXTS]


# Times since 1970 are larger; times since another moment have larger steps, of 1 kHz for images and 10 kHz for other readings.
_SINCE_1970_NS, _IMAGE_STEP_NS, _LEAST_STEP_NS = 1e17, 1e6, 1e5


def read_euroc_sequence(place: Path, camera: Camera | None) -> ImageSequence:
    """Read images, inertial readings and reference poses in the EuRoC layout."""
    listed = place / "cam0" / "data.csv"
    rows = _euroc_rows(listed)
    files = [place / "cam0" / "data" / row[1] for row in rows]
    require_all_there(files)
    times = _euroc_seconds(_euroc_numbers(listed, 1), listed, _IMAGE_STEP_NS)
    turn = np.eye(4)
    if camera is None:
        camera = _euroc_camera(place / "cam0" / "sensor.yaml")
        if not _looks_ahead(camera):
            turn = FORWARD @ np.linalg.inv(camera.T_body_camera)
            camera = replace(camera, T_body_camera=FORWARD)
    inertial = reference = None
    if (place / "imu0" / "data.csv").is_file():
        sensed = _euroc_numbers(place / "imu0" / "data.csv", 7)
        gyro, force = (sensed[:, k : k + 3] @ turn[:3, :3].T for k in (1, 4))
        inertial = Inertial(_euroc_seconds(sensed, place / "imu0" / "data.csv"), gyro, force)
    for estimate in sorted(place.glob("state_*_estimate0/data.csv"))[:1]:
        posed = _euroc_numbers(estimate, 8)
        poses = poses_of(posed[:, 1:4], posed[:, [5, 6, 7, 4]], estimate) @ np.linalg.inv(turn)
        reference = (_euroc_seconds(posed, estimate), poses)
    return assemble_sequence(camera, times, files, inertial, reference)


def _euroc_seconds(rows: FloatArray, path: Path, least_step_ns: float = _LEAST_STEP_NS) -> FloatArray:
    """Return the first column of a table, which holds nanoseconds, in seconds; refuse times of another unit."""
    times = rows[:, 0]
    step = float(np.median(np.diff(times))) if len(times) > 1 else np.inf
    if not (times[0] > _SINCE_1970_NS or step > least_step_ns):
        raise InputError(
            f"{path} holds times that are no nanoseconds: the first is {times[0]:.15g} and the next one comes {step:.6g} "
            "later; write nanoseconds, as the EuRoC layout has them."
        )
    return times * 1e-9


def _looks_ahead(camera: Camera) -> bool:
    """Return whether the camera looks along x and stands upright, within 45°.

    EuRoC's body is its inertial unit, however that lies; one that lies otherwise is turned to
    look where the camera looks.
    """
    mounted: FloatArray = camera.T_body_camera
    return bool(min(mounted[0, 2], -mounted[2, 1]) > np.cos(np.radians(45.0)))


def _euroc_camera(path: Path) -> Camera:
    """Return the pinhole (radial-tangential) or fisheye (equidistant), on the frame of the inertial unit."""
    text = read_text(path, "the calibration").replace("%YAML:1.0", "")
    try:
        given = yaml.safe_load(text)
        fu, fv, cu, cv = (float(value) for value in given["intrinsics"])
        width, height = (int(value) for value in given["resolution"])
        distortion = np.array([float(value) for value in given["distortion_coefficients"]])
        lens = str(given.get("distortion_model", "radial-tangential"))
        mounted = np.array(given["T_BS"]["data"], dtype=np.float64).reshape(4, 4)
    except (yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path} is no EuRoC calibration ({error}); intrinsics, resolution, distortion_coefficients and T_BS were expected."
        ) from error
    matrix = [[fu, 0.0, cu], [0.0, fv, cv], [0.0, 0.0, 1.0]]
    if lens == "equidistant":
        return Camera("fisheye", width, height, np.array(matrix), distortion, mounted)
    if lens not in {"radial-tangential", "radtan", "plumb_bob"}:
        raise InputError(
            f"{path} has the distortion model {lens!r}; radial-tangential or equidistant was expected."
        )
    return Camera("pinhole", width, height, np.array(matrix), np.r_[distortion, 0.0][:5], mounted)


def _euroc_rows(path: Path) -> list[list[str]]:
    lines = read_text(path, "the table").splitlines()
    rows = [[word.strip() for word in line.split(",")] for line in lines if line.strip() and line[0] != "#"]
    width = len(rows[0]) if rows else 0
    bad = next((number for number, row in enumerate(rows, start=1) if len(row) != width or width < 2), None)
    if bad is not None or not rows:
        raise InputError(
            f"{path} is no complete EuRoC table (row {bad or 1}); it may be cut off, get it again."
        )
    return rows


def _euroc_numbers(path: Path, n_columns: int) -> FloatArray:
    """Return the first columns of an EuRoC table."""
    numbers: list[list[float]] = []
    for number, row in enumerate(_euroc_rows(path), start=1):
        try:
            numbers.append([float(word) for word in row[:n_columns]])
        except ValueError as error:
            raise InputError(f"{path}, row {number}: {error}; correct it.") from error
    if len(numbers[0]) < n_columns:
        raise InputError(f"{path} has {len(numbers[0])} columns; {n_columns} were expected.")
    return np.array(numbers)


_KITTI_COLUMNS = 12


def is_kitti(path: str | Path) -> bool:
    """Return whether a text file has the twelve numbers a line of KITTI poses."""
    try:
        content = existing_file(path, "the reference").read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        return False
    lines = (line for line in content.splitlines() if line.strip() and not line.startswith("#"))
    return len(next(lines, "").split()) == _KITTI_COLUMNS


def read_poses(path: str | Path, frame_s: FloatArray, camera: Camera) -> tuple[FloatArray, FloatArray]:
    """Read reference poses as KITTI or TUM text.

    KITTI text has no times, one pose of the camera for each image. TUM text has times and poses
    of the body.

    `frame_s` (N,): times of the images [s]. Returns `time_s` (R,): times [s]. `poses` (R, 4, 4): body to the
    frame of the reference.
    """
    if not is_kitti(path):
        rows = read_tum(path)
        return rows[:, 0], poses_of(rows[:, 1:4], _unit_quaternions(rows[:, 4:8]), Path(path))
    numbers = read_numbers(Path(path), _KITTI_COLUMNS)
    if len(numbers) != len(frame_s):
        raise InputError(
            f"{path} has {len(numbers)} poses without times and the drive {len(frame_s)} images; name the poses of "
            "these images, or poses with times (TUM)."
        )
    poses = kitti_poses(numbers, Path(path))
    return frame_s, camera.T_body_camera @ poses @ np.linalg.inv(camera.T_body_camera)


def _unit_quaternions(quaternion: FloatArray) -> FloatArray:
    unit: FloatArray = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    return unit

"""Readers of other people's recordings: KITTI, TUM and EuRoC layouts, and folders of images with times."""

from pathlib import Path

import cv2
import numpy as np
import yaml

from survey.arrays import FloatArray
from survey.camera import Camera, Frames, Image
from survey.errors import InputError
from survey.io.files import existing_file
from survey.sensors import Inertial
from vision_slam.sequence import ImageSequence

# Where x right, y down, z forward lie on a body with x forward, y left, z up.
_FORWARD = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
_KITTI_HEIGHT_M = 1.65
_KITTI_PERIOD_S = 0.1
_PICTURES = (".png", ".jpg", ".jpeg", ".pgm", ".tif", ".tiff")


class GreyFiles:
    """Image files read when asked for: grey or colour, of 8 or 16 bits; the latter lose their lower byte."""

    def __init__(self, files: list[Path]) -> None:
        self._files = files

    def __getitem__(self, index: int) -> Image:
        return read_any_image(self._files[index])


def read_any_image(path: Path) -> Image:
    """Read an 8- or 16-bit image, grey or colour, as 8 bits.

    Raises
    ------
    InputError
        Missing, truncated, or no image.
    """
    content = existing_file(path, "the image").read_bytes()
    ends = {b"\x89PNG": b"IEND", b"\xff\xd8\xff": b"\xff\xd9"}
    cut = any(content.startswith(head) and tail not in content[-32:] for head, tail in ends.items())
    image = (
        None if cut or not content else cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    )
    if image is None:
        raise InputError(f"{path} is no whole image; it may be cut off, get it again.")
    if image.dtype == np.uint16:
        image = np.asarray(image // 256, dtype=np.uint8)
    if image.dtype != np.uint8:
        raise InputError(f"{path} has {image.dtype} pixels; 8- or 16-bit images were expected, convert it.")
    return np.asarray(image[:, :, :3] if image.ndim == 3 else image, dtype=np.uint8)


def read_sequence(folder: str | Path) -> ImageSequence:
    """Read a folder in the layout that it turns out to have.

    KITTI odometry: ``calib.txt`` beside ``image_0`` or ``image_l``. TUM: ``rgb.txt``.
    EuRoC: ``mav0/cam0`` or ``cam0``. Otherwise ``camera.toml`` and a table ``frames.csv``
    (time_s,file) in the folder or in its ``frames``.

    Raises
    ------
    InputError
        The layout is none of these, calibration or times lack, or do not fit the images.
    """
    place = Path(folder)
    if not place.is_dir():
        raise InputError(f"{place} is no folder; name the folder of a recording.")
    if (place / "calib.txt").is_file():
        return _kitti(place)
    if (place / "rgb.txt").is_file():
        return _tum(place)
    for inner in (place / "mav0", place):
        if (inner / "cam0" / "data.csv").is_file():
            return _euroc(inner)
    for inner in (place, place / "frames"):
        if (inner / "frames.csv").is_file():
            return ImageSequence(_calibrated(place), Frames.read(inner))
    raise InputError(
        f"{place} has no layout that is known (KITTI calib.txt, TUM rgb.txt, EuRoC cam0/data.csv, "
        "or camera.toml with frames.csv); add frames.csv with the columns time_s,file."
    )


def _calibrated(place: Path) -> Camera:
    if not (place / "camera.toml").is_file():
        raise InputError(f"{place} holds images and no camera.toml; calibrate the camera and put it there.")
    return Camera.read(place / "camera.toml")


def _kitti(place: Path) -> ImageSequence:
    names = next((name for name in ("image_0", "image_l", "image_2") if (place / name).is_dir()), None)
    if names is None:
        raise InputError(f"{place} has calib.txt and no image_0, image_l or image_2; get the images.")
    files = sorted(file for file in (place / names).iterdir() if file.suffix.lower() in _PICTURES)
    if not files:
        raise InputError(f"{place / names} holds no images; get the whole sequence.")
    if (place / "times.txt").is_file():
        times = _numbers(place / "times.txt", 1)[:, 0]
    else:
        times = _KITTI_PERIOD_S * np.arange(float(len(files)))
    _as_many(times, files, place)
    mounted = _FORWARD.copy()
    mounted[2, 3] = _KITTI_HEIGHT_M
    height, width = read_any_image(files[0]).shape[:2]
    camera = Camera("pinhole", width, height, _kitti_matrix(place / "calib.txt"), np.zeros(5), mounted)
    reference = None
    if (place / "poses.txt").is_file():
        reference = np.tile(np.eye(4), (len(files), 1, 1))
        rows = _numbers(place / "poses.txt", 12)
        _as_many(rows, files, place / "poses.txt")
        reference[:, :3] = rows.reshape(-1, 3, 4)
        reference = mounted @ reference @ np.linalg.inv(mounted)
    frames = Frames(times, GreyFiles(files))
    return ImageSequence(
        camera, frames, reference_time_s=None if reference is None else times, reference=reference
    )


def _kitti_matrix(file: Path) -> FloatArray:
    """Left camera of a KITTI calibration: the first projection, with or without its label."""
    words = file.read_text(encoding="utf-8").splitlines()[0].split() if file.stat().st_size else []
    try:
        numbers = [float(word) for word in words if not word.endswith(":")]
    except ValueError:
        numbers = []
    if len(numbers) < 12:
        raise InputError(f"{file} gives no projection in its first line; 12 numbers (3 × 4) were expected.")
    matrix: FloatArray = np.array(numbers[:12]).reshape(3, 4)[:, :3]
    return matrix


def _tum(place: Path) -> ImageSequence:
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
        raise InputError(f"{place / 'rgb.txt'} names no images; get the whole sequence.")
    _all_there(files)
    reference_time_s = reference = None
    for file in sorted(place.glob("ground*.txt"))[:1]:  # the layout's reference poses
        rows = _numbers(file, 8)
        camera_poses = _posed(rows[:, 1:4], rows[:, 4:8])
        reference_time_s = rows[:, 0]
        reference = camera_poses @ np.linalg.inv(_calibrated(place).T_body_camera)
    return ImageSequence(
        _calibrated(place),
        Frames(np.array(times), GreyFiles(files)),
        reference_time_s=reference_time_s,
        reference=reference,
    )


def _euroc(place: Path) -> ImageSequence:
    rows = _euroc_rows(place / "cam0" / "data.csv")
    files = [place / "cam0" / "data" / row[1] for row in rows]
    _all_there(files)
    times = np.array([float(row[0]) for row in rows]) * 1e-9
    inertial = reference_time_s = reference = None
    if (place / "imu0" / "data.csv").is_file():
        sensed = np.array(
            [[float(word) for word in row[:7]] for row in _euroc_rows(place / "imu0" / "data.csv")]
        )
        inertial = Inertial(sensed[:, 0] * 1e-9, sensed[:, 1:4], sensed[:, 4:7])
    for estimate in sorted(place.glob("state_*_estimate0/data.csv"))[:1]:
        posed = np.array([[float(word) for word in row[:8]] for row in _euroc_rows(estimate)])
        reference_time_s = posed[:, 0] * 1e-9
        reference = _posed(posed[:, 1:4], posed[:, [5, 6, 7, 4]])
    camera = _euroc_camera(place / "cam0" / "sensor.yaml")
    frames = Frames(times, GreyFiles(files))
    return ImageSequence(camera, frames, None, inertial, None, reference_time_s, reference)


def _euroc_camera(path: Path) -> Camera:
    """Pinhole (radial-tangential) or fisheye (equidistant), on the frame of the inertial unit."""
    file = existing_file(path, "the calibration")
    try:
        given = yaml.safe_load(file.read_text(encoding="utf-8").replace("%YAML:1.0", ""))
        fu, fv, cu, cv = (float(value) for value in given["intrinsics"])
        width, height = (int(value) for value in given["resolution"])
        distortion = np.array([float(value) for value in given["distortion_coefficients"]])
        lens = str(given.get("distortion_model", "radial-tangential"))
        mounted = np.array(given["T_BS"]["data"], dtype=np.float64).reshape(4, 4)
    except (yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{file} is no EuRoC calibration ({error}); intrinsics, resolution, distortion_coefficients and T_BS were expected."
        ) from error
    matrix = [[fu, 0.0, cu], [0.0, fv, cv], [0.0, 0.0, 1.0]]
    if lens == "equidistant":
        return Camera("fisheye", width, height, np.array(matrix), distortion, mounted)
    if lens not in {"radial-tangential", "radtan", "plumb_bob"}:
        raise InputError(
            f"{file} has the distortion model {lens!r}; radial-tangential or equidistant was expected."
        )
    return Camera("pinhole", width, height, np.array(matrix), np.r_[distortion, 0.0][:5], mounted)


def _euroc_rows(path: Path) -> list[list[str]]:
    lines = existing_file(path, "the table").read_text(encoding="utf-8").splitlines()
    rows = [[word.strip() for word in line.split(",")] for line in lines if line.strip() and line[0] != "#"]
    width = len(rows[0]) if rows else 0
    bad = next((number for number, row in enumerate(rows, start=1) if len(row) != width or width < 2), None)
    if bad is not None or not rows:
        raise InputError(f"{path} is no whole EuRoC table (row {bad or 1}); it may be cut off, get it again.")
    return rows


def _posed(place: FloatArray, quaternion: FloatArray) -> FloatArray:
    from scipy.spatial.transform import Rotation

    poses = np.tile(np.eye(4), (len(place), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(quaternion).as_matrix()
    poses[:, :3, 3] = place
    return poses


def _numbers(path: Path, n_columns: int) -> FloatArray:
    try:
        rows: FloatArray = np.loadtxt(path, ndmin=2)
    except ValueError as error:
        raise InputError(f"{path} holds something that is no number ({error}); correct it.") from error
    if rows.shape[1] != n_columns:
        raise InputError(f"{path} has {rows.shape[1]} numbers a line; {n_columns} were expected.")
    return rows


def _as_many(rows: FloatArray, files: list[Path], where: Path) -> None:
    if len(rows) != len(files):
        raise InputError(f"{where}: {len(rows)} lines and {len(files)} images; they must be as many.")


def _all_there(files: list[Path]) -> None:
    missing = next((file for file in files if not file.is_file()), None)
    if missing is not None:
        raise InputError(f"the list of images names {missing}, which is not there; get the whole recording.")

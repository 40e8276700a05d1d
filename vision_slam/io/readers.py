"""Readers of KITTI, TUM and EuRoC layouts, and of folders of images with times."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.core.files.reading import existing_file
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Frames, ImageFiles
from survey.data.sensors.aiding import Inertial, Wheels
from vision_slam.io.images import PICTURES, images_of, read_pixels, refuse_other_sizes
from vision_slam.io.sequence import ImageSequence

# Where x right, y down, z forward lie on a body with x forward, y left, z up.
_FORWARD = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
_KITTI_HEIGHT_M = 1.65
_KITTI_PERIOD_S = 0.1
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
        return _kitti(place, camera)
    if (place / "rgb.txt").is_file():
        return _tum(place, camera)
    for inner in (place / "mav0", place):
        if (inner / "cam0" / "data.csv").is_file():
            return _euroc(inner, camera)
    for inner in (place, place / "frames"):
        if (inner / "frames.csv").is_file():
            frames = Frames.read(inner)
            assert isinstance(frames.images, ImageFiles)
            return _with_motion(
                _sequence(camera or _calibrated(place), frames.time_s, list(frames.images.files)), place
            )
    for inner in (place, place / "images"):
        files = _pictures(inner)
        if files:
            times = _times(place, inner, files)
            return _with_motion(_sequence(camera or _calibrated(place), times, files), place)
    raise InputError(
        f"{place} has no layout that is known (KITTI calib.txt, TUM rgb.txt, EuRoC cam0/data.csv, "
        "or images with times and camera.toml); add frames.csv with the columns time_s,file."
    )


def _sequence(
    camera: Camera,
    times: FloatArray,
    files: list[Path],
    inertial: Inertial | None = None,
    reference: tuple[FloatArray, FloatArray] | None = None,
) -> ImageSequence:
    """Assemble a sequence after checking all images for completeness and size."""
    images = images_of(files)
    refuse_other_sizes(files, camera)
    time_s, poses = reference or (None, None)
    try:
        frames = Frames(times, images)
    except InputError as error:
        raise InputError(f"{files[0].parent}: {error}") from error
    return ImageSequence(
        camera,
        frames,
        inertial=inertial,
        reference_time_s=time_s,
        reference=poses,
        notes=images.notes,
    )


def _with_motion(sequence: ImageSequence, place: Path) -> ImageSequence:
    """Add wheels and inertial readings to images, where the folder has tables of them."""
    wheels, inertial = place / "wheels.csv", place / "inertial.csv"
    return replace(
        sequence,
        wheels=Wheels.read(wheels) if wheels.exists() else None,
        inertial=Inertial.read(inertial) if inertial.exists() else None,
    )


def _calibrated(place: Path) -> Camera:
    if not (place / "camera.toml").is_file():
        raise InputError(
            f"{place} holds images and no camera.toml; calibrate the camera and put it there, or name it with --camera."
        )
    return Camera.read(place / "camera.toml")


def _pictures(folder: Path) -> list[Path]:
    files = folder.iterdir() if folder.is_dir() else ()
    return sorted(file for file in files if file.suffix.lower() in PICTURES)


def _times(place: Path, inner: Path, files: list[Path]) -> FloatArray:
    """Return the times of the images of a plain folder: from their list, else from their names."""
    for listed in (folder / name for folder in (inner, place) for name in _LISTS_OF_TIMES):
        if listed.is_file():
            times = _numbers(listed, 1)[:, 0]
            _as_many(times, files, listed)
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


def _kitti(place: Path, camera: Camera | None) -> ImageSequence:
    names = next((name for name in ("image_0", "image_l", "image_2") if (place / name).is_dir()), None)
    if names is None:
        raise InputError(f"{place} has calib.txt and no image_0, image_l or image_2; get the images.")
    files = _pictures(place / names)
    if not files:
        raise InputError(f"{place / names} holds no images; get the complete sequence.")
    if (place / "times.txt").is_file():
        times = _numbers(place / "times.txt", 1)[:, 0]
    else:
        times = _KITTI_PERIOD_S * np.arange(float(len(files)))
    _as_many(times, files, place)
    if camera is None:
        mounted = _FORWARD.copy()
        mounted[2, 3] = _KITTI_HEIGHT_M
        height, width = read_pixels(files[0]).shape[:2]
        camera = Camera("pinhole", width, height, _kitti_matrix(place / "calib.txt"), np.zeros(5), mounted)
    reference = None
    if (place / "poses.txt").is_file():
        poses = np.tile(np.eye(4), (len(files), 1, 1))
        rows = _numbers(place / "poses.txt", 12)
        _as_many(rows, files, place / "poses.txt")
        poses[:, :3] = rows.reshape(-1, 3, 4)
        reference = (times, camera.T_body_camera @ poses @ np.linalg.inv(camera.T_body_camera))
    return _sequence(camera, times, files, reference=reference)


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
    _all_there(files)
    camera = camera or _calibrated(place)
    reference = None
    for file in sorted(place.glob("ground*.txt"))[:1]:  # the layout's reference poses
        rows = _numbers(file, 8)
        reference = (
            rows[:, 0],
            _posed(rows[:, 1:4], rows[:, 4:8], file) @ np.linalg.inv(camera.T_body_camera),
        )
    return _sequence(camera, np.array(times), files, reference=reference)


def _euroc(place: Path, camera: Camera | None) -> ImageSequence:
    rows = _euroc_rows(place / "cam0" / "data.csv")
    files = [place / "cam0" / "data" / row[1] for row in rows]
    _all_there(files)
    times = _euroc_numbers(place / "cam0" / "data.csv", 1)[:, 0] * 1e-9
    turn = np.eye(4)
    if camera is None:
        camera = _euroc_camera(place / "cam0" / "sensor.yaml")
        if not _looks_ahead(camera):
            turn = _FORWARD @ np.linalg.inv(camera.T_body_camera)
            camera = replace(camera, T_body_camera=_FORWARD)
    inertial = reference = None
    if (place / "imu0" / "data.csv").is_file():
        sensed = _euroc_numbers(place / "imu0" / "data.csv", 7)
        gyro, force = (sensed[:, k : k + 3] @ turn[:3, :3].T for k in (1, 4))
        inertial = Inertial(sensed[:, 0] * 1e-9, gyro, force)
    for estimate in sorted(place.glob("state_*_estimate0/data.csv"))[:1]:
        posed = _euroc_numbers(estimate, 8)
        poses = _posed(posed[:, 1:4], posed[:, [5, 6, 7, 4]], estimate) @ np.linalg.inv(turn)
        reference = (posed[:, 0] * 1e-9, poses)
    return _sequence(camera, times, files, inertial, reference)


def _looks_ahead(camera: Camera) -> bool:
    """Whether the camera looks along x and stands upright, within 45°.

    EuRoC's body is its inertial unit, however that lies; one that lies otherwise is turned to
    look where the camera looks.
    """
    mounted: FloatArray = camera.T_body_camera
    return bool(min(mounted[0, 2], -mounted[2, 1]) > np.cos(np.radians(45.0)))


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


def _posed(place: FloatArray, quaternion: FloatArray, where: Path) -> FloatArray:
    if (np.abs(np.linalg.norm(quaternion, axis=1) - 1.0) > 1e-3).any():
        raise InputError(f"{where} holds orientations that are no unit quaternions; correct them.")
    poses = np.tile(np.eye(4), (len(place), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(quaternion).as_matrix()
    poses[:, :3, 3] = place
    return poses


def _numbers(path: Path, n_columns: int) -> FloatArray:
    try:
        rows: FloatArray = np.loadtxt(existing_file(path, "the table"), ndmin=2)
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
        raise InputError(
            f"the list of images names {missing}, which is not there; get the complete recording."
        )

"""Write recordings in the layouts of TUM, EuRoC and KITTI odometry."""

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation, Slerp

from survey.core import FloatArray, InputError, write_text
from survey.data.camera import Camera
from survey.data.frames import Frames, png_of_frame
from survey.data.recording import Recording
from survey.data.sensors.lidar import LidarScans
from survey.data.sensors.records import Inertial
from survey.data.trajectory import Trajectory
from survey.io.trajectory_files import write_kitti


def write_tum_list(frames: Frames, folder: Path) -> None:
    """Write ``rgb.txt`` beside the folder ``frames`` that a `FrameWriter` wrote: a time and a file a line."""
    files = [f"frames/{k:06d}.png" for k in range(len(frames))]
    lines = [f"{time:.6f} {file}" for time, file in zip(frames.time_s, files, strict=True)]
    _write(folder / "rgb.txt", ["# timestamp [s] filename", *lines])


def write_euroc(recording: Recording, folder: Path, reference: Trajectory | None = None) -> None:
    """Write a recording in the EuRoC layout: ``mav0/cam0``, ``mav0/imu0`` and, if given, the reference poses.

    Parameters
    ----------
    recording : Recording
        With camera and frames; gyro and accelerometer if it has them.
    folder : pathlib.Path
        Is made; images are named after their time in nanoseconds.
    reference : Trajectory, optional
        Real poses of the body, for those who evaluate.

    Raises
    ------
    InputError
        No frames, or the folder exists and is not empty.

    Notes
    -----
    The body is EuRoC's frame of the inertial unit. A fisheye is called ``equidistant``, as
    Kalibr does; wheels, GPS and barometer have no place in that layout.
    """
    frames, camera = recorded_images(recording)
    _require_empty(folder)
    _write_camera(camera, frames, folder / "mav0" / "cam0")
    if recording.inertial is not None:
        _write_inertial(recording.inertial, folder / "mav0" / "imu0")
    if reference is not None:
        _write_reference(reference, folder / "mav0" / "state_groundtruth_estimate0")


def recorded_images(recording: Recording) -> tuple[Frames, Camera]:
    """Return images and calibration of a recording; refuse one without."""
    if recording.frames is None or recording.camera is None:
        raise InputError(
            "the recording has no images, which this layout needs; write another format, or simulate with fidelity = 'vision' "
            "in the mission file."
        )
    return recording.frames, recording.camera


def _require_empty(folder: Path) -> None:
    if folder.exists() and any(folder.iterdir()):
        raise InputError(f"{folder} exists and is not empty; choose another folder.")


def _write_camera(camera: Camera, frames: Frames, place: Path) -> None:
    (place / "data").mkdir(parents=True, exist_ok=True)
    names = [f"{ns}.png" for ns in _nanoseconds(frames.time_s)]
    for k, name in enumerate(names):
        (place / "data" / name).write_bytes(png_of_frame(frames[k], frames.time_s[k]))
    rows = [f"{name.removesuffix('.png')},{name}" for name in names]
    _write(place / "data.csv", ["#timestamp [ns],filename", *rows])
    matrix = camera.matrix
    kind = {"fisheye": "equidistant", "pinhole": "radial-tangential"}[camera.model]
    numbers = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]
    rate_hz = 1.0 / float(np.median(np.diff(frames.time_s))) if len(frames) > 1 else 0.0
    _write(
        place / "sensor.yaml",
        [
            "%YAML:1.0",
            "sensor_type: camera",
            "T_BS:",
            "  cols: 4",
            "  rows: 4",
            f"  data: {_listed(camera.T_body_camera.ravel())}",
            f"rate_hz: {rate_hz:.9g}",
            f"resolution: [{camera.width}, {camera.height}]",
            "camera_model: pinhole",
            f"intrinsics: {_listed(np.array(numbers))}",
            f"distortion_model: {kind}",
            f"distortion_coefficients: {_listed(camera.distortion[:4])}",
        ],
    )


def _write_inertial(inertial: Inertial, place: Path) -> None:
    place.mkdir(parents=True, exist_ok=True)
    axes = [
        f"{what}_RS_S_{axis} [{unit}]"
        for what, unit in (("w", "rad s^-1"), ("a", "m s^-2"))
        for axis in "xyz"
    ]
    readings = np.hstack([inertial.gyro_rad_s, inertial.specific_force_m_s2])
    rows = _rows(inertial.time_s, readings)
    _write(place / "data.csv", [",".join(["#timestamp [ns]", *axes]), *rows])
    rate_hz = 1.0 / float(np.median(np.diff(inertial.time_s))) if len(inertial) > 1 else 0.0
    mounting = ["T_BS:", "  cols: 4", "  rows: 4", f"  data: {_listed(np.eye(4).ravel())}"]
    _write(place / "sensor.yaml", ["%YAML:1.0", "sensor_type: imu", *mounting, f"rate_hz: {rate_hz:.9g}"])


def _write_reference(reference: Trajectory, place: Path) -> None:
    place.mkdir(parents=True, exist_ok=True)
    x, y, z, w = reference.quaternion.T
    names = ["#timestamp", *(f"p_RS_R_{axis} [m]" for axis in "xyz"), *(f"q_RS_{part} []" for part in "wxyz")]
    rows = _rows(reference.time_s, np.column_stack([reference.position, w, x, y, z]))
    _write(place / "data.csv", [",".join(names), *rows])


def write_kitti_sequence(recording: Recording, folder: Path, reference: Trajectory | None = None) -> None:
    """Write a recording in the layout of KITTI odometry: images, times, calibration, scans and, if given, real poses.

    Parameters
    ----------
    recording : Recording
        With camera and frames; scans of a LiDAR if it has them.
    folder : pathlib.Path
        Is made.
    reference : Trajectory, optional
        Real poses of the body, for ``poses.txt``.

    Raises
    ------
    InputError
        No frames, or the folder exists and is not empty.

    Notes
    -----
    Images of that layout are rectified: those of a lens with distortion are resampled to a pinhole without. Grey images are
    those of camera 0, images in colour those of camera 2. ``P1`` to
    ``P3`` of ``calib.txt`` repeat ``P0``, for there is one camera. ``Tr`` takes points of the scanner, without one those
    of the body, to the camera. Scans have times of their own in ``velodyne/times.txt``.
    """
    frames, camera = recorded_images(recording)
    _require_empty(folder)
    images = folder / ("image_0" if frames[0].ndim == 2 else "image_2")
    images.mkdir(parents=True, exist_ok=True)
    pinhole = rectified_camera(camera)
    source = None if pinhole is camera else _source_pixels(camera, pinhole)
    for k, time_s in enumerate(frames.time_s):
        image = frames[k]
        if source is not None:
            image = np.asarray(cv2.remap(image, source[0], source[1], cv2.INTER_LINEAR), dtype=np.uint8)
        (images / f"{k:06d}.png").write_bytes(png_of_frame(image, time_s))
    _write(folder / "times.txt", [f"{time_s!r}" for time_s in frames.time_s.tolist()])
    projection = np.column_stack([pinhole.matrix, np.zeros(3)])
    T_body_lidar = np.eye(4)
    if recording.lidar is not None:
        T_body_lidar[:3, 3] = recording.lidar.scanner.mount_m
        _write_scans(recording.lidar, folder / "velodyne")
    T_camera_lidar = np.linalg.inv(camera.T_body_camera) @ T_body_lidar
    calibration = [*(f"P{k}: {_spaced(projection)}" for k in range(4)), f"Tr: {_spaced(T_camera_lidar[:3])}"]
    _write(folder / "calib.txt", calibration)
    if reference is not None:
        poses = _poses_at(reference, frames.time_s) @ camera.T_body_camera
        write_kitti(folder / "poses.txt", (np.linalg.inv(poses[0]) @ poses)[:, :3])


def rectified_camera(camera: Camera) -> Camera:
    """Return a pinhole of the same size without distortion, all of whose pixels the camera sees; the camera itself if it is one.

    >>> lens = Camera("fisheye", 640, 480, [[366.0, 0, 319.5], [0, 366.0, 239.5], [0, 0, 1]], np.zeros(4), np.eye(4))
    >>> round(float(rectified_camera(lens).matrix[0, 0]), 1)
    312.2
    """
    if camera.model == "pinhole" and not camera.distortion.any():
        return camera
    across, down = 0.5 * (camera.width - 1), 0.5 * (camera.height - 1)
    u, v = np.arange(camera.width), np.arange(camera.height)
    sides = [np.column_stack([np.full(len(v), side), v]) for side in (0, camera.width - 1)]
    ends = [np.column_stack([u, np.full(len(u), end)]) for end in (0, camera.height - 1)]
    rays = [camera.rays(np.vstack(edges).astype(np.float64)) for edges in (sides, ends)]
    if not all(np.isfinite(edge).all() and (edge[:, 2] > 0.0).all() for edge in rays):
        raise InputError(
            "the camera sees 90° off its axis, which no pinhole of KITTI does; write another format, such as --as euroc."
        )
    least = [float(np.abs(edge[:, k] / edge[:, 2]).min()) for k, edge in enumerate(rays)]
    focal_px = max(across / least[0], down / least[1])
    matrix = np.array([[focal_px, 0.0, across], [0.0, focal_px, down], [0.0, 0.0, 1.0]])
    return Camera("pinhole", camera.width, camera.height, matrix, np.zeros(5), camera.T_body_camera)


def _source_pixels(camera: Camera, pinhole: Camera) -> npt.NDArray[np.float32]:
    """Return columns and rows (2, H, W) in the camera's image of the pixels of a pinhole."""
    v, u = np.mgrid[: pinhole.height, : pinhole.width].astype(np.float64)
    pixels = camera.project(pinhole.rays(np.column_stack([u.ravel(), v.ravel()])))
    return pixels.astype(np.float32).T.reshape(2, pinhole.height, pinhole.width)


def _write_scans(scans: LidarScans, place: Path) -> None:
    """Write points in the frame of the scanner, with a reflectance of 0, and the begin of each turn."""
    place.mkdir()
    for k, scan in enumerate(scans):
        points = np.column_stack([scan.xyz - scan.sensor, np.zeros(len(scan.xyz))])
        (place / f"{k:06d}.bin").write_bytes(points.astype("<f4").tobytes())
    _write(place / "times.txt", [f"{time_s!r}" for time_s in scans.time_s.tolist()])


def _poses_at(path: Trajectory, time_s: FloatArray) -> FloatArray:
    """Return the poses (N, 4, 4) of the body at times (N,) [s], between those of a path."""
    at_s = time_s.clip(path.time_s[0], path.time_s[-1])
    poses = np.tile(np.eye(4), (len(at_s), 1, 1))
    poses[:, :3, :3] = Slerp(path.time_s, Rotation.from_quat(path.quaternion))(at_s).as_matrix()
    poses[:, :3, 3] = np.column_stack([np.interp(at_s, path.time_s, axis) for axis in path.position.T])
    return poses


def _spaced(values: FloatArray) -> str:
    return " ".join(f"{value!r}" for value in values.ravel().tolist())


def _rows(time_s: FloatArray, values: FloatArray) -> list[str]:
    stamps = _nanoseconds(time_s)
    return [
        ",".join([str(ns), *(f"{v!r}" for v in row)]) for ns, row in zip(stamps, values.tolist(), strict=True)
    ]


def _nanoseconds(time_s: FloatArray) -> list[int]:
    return [round(float(t) * 1e9) for t in time_s]


def _listed(values: FloatArray) -> str:
    return "[" + ", ".join(f"{v!r}" for v in values.tolist()) + "]"


def _write(path: Path, lines: list[str]) -> None:
    write_text(path, "\n".join(lines) + "\n")

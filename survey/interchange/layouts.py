"""Write recordings in the TUM and EuRoC layouts."""

from pathlib import Path

import numpy as np

from survey.core import FloatArray, InputError, write_text
from survey.data.camera import Camera
from survey.data.frames import Frames, png_of_frame
from survey.data.recording import Recording
from survey.data.sensors.records import Inertial
from survey.data.trajectory import Trajectory


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
    if recording.frames is None or recording.camera is None:
        raise InputError(
            "the recording has no images, for which EuRoC's layout is; write another format, or name the recording of a drive with a camera folder."
        )
    if folder.exists() and any(folder.iterdir()):
        raise InputError(f"{folder} exists and is not empty; choose another folder.")
    _write_camera(recording.camera, recording.frames, folder / "mav0" / "cam0")
    if recording.inertial is not None:
        _write_inertial(recording.inertial, folder / "mav0" / "imu0")
    if reference is not None:
        _write_reference(reference, folder / "mav0" / "state_groundtruth_estimate0")


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


def _write_reference(reference: Trajectory, place: Path) -> None:
    place.mkdir(parents=True, exist_ok=True)
    x, y, z, w = reference.quaternion.T
    names = ["#timestamp", *(f"p_RS_R_{axis} [m]" for axis in "xyz"), *(f"q_RS_{part} []" for part in "wxyz")]
    rows = _rows(reference.time_s, np.column_stack([reference.position, w, x, y, z]))
    _write(place / "data.csv", [",".join(names), *rows])


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

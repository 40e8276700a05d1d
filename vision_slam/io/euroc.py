"""Image sequences in the EuRoC layout."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.camera.calibration import Camera
from survey.data.sensors.aiding import Inertial
from vision_slam.io.sequence import ImageSequence
from vision_slam.io.sequence_files import (
    FORWARD,
    assemble_sequence,
    poses_of,
    require_all_there,
)
from vision_slam.io.text import read_text

# Times since 1970 are larger; times since another moment have larger steps, of 1 kHz for images and 10 kHz for other readings.
_SINCE_1970_NS, _IMAGE_STEP_NS, _LEAST_STEP_NS = 1e17, 1e6, 1e5


def read_euroc_sequence(place: Path, camera: Camera | None) -> ImageSequence:
    """Read images, inertial readings and reference poses in the EuRoC layout."""
    listed = place / "cam0" / "data.csv"
    rows = _euroc_rows(listed)
    files = [place / "cam0" / "data" / row[1] for row in rows]
    require_all_there(files)
    times = _seconds(_euroc_numbers(listed, 1), listed, _IMAGE_STEP_NS)
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
        inertial = Inertial(_seconds(sensed, place / "imu0" / "data.csv"), gyro, force)
    for estimate in sorted(place.glob("state_*_estimate0/data.csv"))[:1]:
        posed = _euroc_numbers(estimate, 8)
        poses = poses_of(posed[:, 1:4], posed[:, [5, 6, 7, 4]], estimate) @ np.linalg.inv(turn)
        reference = (_seconds(posed, estimate), poses)
    return assemble_sequence(camera, times, files, inertial, reference)


def _seconds(rows: FloatArray, path: Path, least_step_ns: float = _LEAST_STEP_NS) -> FloatArray:
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

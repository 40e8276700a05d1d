"""Calibrations of cameras: camera.toml, and the YAML files of ROS, OpenCV, Kalibr and ORB-SLAM."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from survey import Camera, InputError
from survey.core import refusing_damage
from vision_slam.readers.images import read_text

# Where x right, y down, z forward lie on a body with x forward, y left, z up.
FORWARD = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
_CAMERA = re.compile(r"cam\d+")
_FISHEYE = {"equidistant", "fisheye", "kannalabrandt8"}
_PINHOLE = {"plumb_bob", "radtan", "radial-tangential", "rational_polynomial", "pinhole", "none", ""}


class _Lens(NamedTuple):
    """What a file states of a lens, in its own order of coefficients (k1, k2, p1, p2, k3, or k1 … k4)."""

    width: int
    height: int
    matrix: list[float]
    model: str
    coefficients: list[float]


def read_calibration(path: str | Path) -> tuple[Camera, tuple[str, ...]]:
    """Read the calibration of a camera.

    ``camera.toml``; YAML of ROS (``camera_calibration``, or a ``camera_info`` message), of OpenCV's ``FileStorage``, of Kalibr
    (the first camera of a ``camchain``, or EuRoC's ``sensor.yaml``) and of ORB-SLAM.
    """
    file = Path(path)
    if file.suffix.lower() not in {".yaml", ".yml"}:
        return Camera.read(file), ()
    given = _parsed(file)
    read = next((read for key, read in _FORMATS.items() if key in given), None)
    if read is None:
        raise InputError(
            f"{file} is no calibration of ROS, OpenCV, Kalibr or ORB-SLAM; write its numbers to a camera.toml, and name that."
        )
    try:
        with refusing_damage("the calibration", "complete one", "export it again"):
            camera = _camera(read(given))
    except InputError as error:
        raise InputError(f"{file}: {error}") from error
    note = f"{file.name}: the camera is taken to look straight ahead; its place on the body is not read from YAML"
    others = sorted(key for key in given if _CAMERA.fullmatch(key) and key != "cam0")
    unread = (f"{file.name}: the first camera is taken, not {', '.join(others)}",) if others else ()
    return camera, (note, *unread)


def calibrated_camera(place: Path) -> Camera:
    """Read the calibration beside the images of a folder."""
    if not (place / "camera.toml").is_file():
        raise InputError(
            f"{place} holds images and no camera.toml; calibrate the camera (firnline calibrate) and put it there, or name "
            "it with --camera."
        )
    return Camera.read(place / "camera.toml")


def _parsed(file: Path) -> dict[str, Any]:
    """Return the keys of a YAML file, in lower case; OpenCV's own marks are no YAML."""
    text = read_text(file, "the calibration").replace("%YAML:1.0", "").replace("!!opencv-matrix", "")
    with refusing_damage(str(file), "valid YAML", "correct that place"):
        given = yaml.safe_load(text)
    if not isinstance(given, dict):
        raise InputError(f"{file} holds no keys; a calibration was expected.")
    return {str(key).lower(): value for key, value in given.items()}


def _camera(lens: _Lens) -> Camera:
    """Return a camera with the lens that a file states."""
    known = lens.model.lower()
    n = 4 if known in _FISHEYE else 5
    if known not in _FISHEYE | _PINHOLE:
        raise InputError(
            f"the lens model is {lens.model!r}; radial-tangential (plumb_bob) or equidistant was expected."
        )
    if np.any(lens.coefficients[n:]):
        raise InputError(
            f"there are {len(lens.coefficients)} coefficients of distortion; a {'fisheye' if n == 4 else 'pinhole'} lens "
            f"has {n}, calibrate again without the others."
        )
    return Camera(
        "fisheye" if n == 4 else "pinhole",
        lens.width,
        lens.height,
        np.reshape(lens.matrix, (3, 3)),
        np.r_[lens.coefficients, np.zeros(n)][:n],
        FORWARD,
        distortion_is_assumed=not lens.coefficients,
    )


def _matrix(fx: float, fy: float, cx: float, cy: float) -> list[float]:
    return [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]


def _numbers(given: Any) -> list[float]:
    """Return the numbers of a list or of a matrix with its data."""
    if given is None:
        return []
    data = given["data"] if isinstance(given, Mapping) else given
    return [float(value) for value in np.ravel(data)]


def _opencv(given: dict[str, Any]) -> _Lens:
    """Read what ROS' camera_calibration and OpenCV's sample of a calibration write."""
    names = ("distortion_coefficients", "dist_coeffs", "distcoeffs", "dist_coeff")
    coefficients = next((given[name] for name in names if name in given), None)
    model = "fisheye" if given.get("fisheye_model") else str(given.get("distortion_model", ""))
    return _Lens(
        int(given["image_width"]),
        int(given["image_height"]),
        _numbers(given["camera_matrix"]),
        model,
        _numbers(coefficients),
    )


def _camera_info(given: dict[str, Any]) -> _Lens:
    """Read a printed message of ROS."""
    model = str(given.get("distortion_model", ""))
    return _Lens(
        int(given["width"]), int(given["height"]), _numbers(given["k"]), model, _numbers(given.get("d"))
    )


def _kalibr(given: dict[str, Any]) -> _Lens:
    """Read the camera of one file of Kalibr or EuRoC."""
    if str(given.get("camera_model", "pinhole")) != "pinhole":
        raise InputError(
            f"the camera model is {given['camera_model']!r}; Kalibr's pinhole was expected, calibrate again."
        )
    width, height = given["resolution"]
    coefficients = given.get("distortion_coeffs", given.get("distortion_coefficients"))
    fx, fy, cx, cy = _numbers(given["intrinsics"])
    model = str(given.get("distortion_model", ""))
    return _Lens(int(width), int(height), _matrix(fx, fy, cx, cy), model, _numbers(coefficients))


def _orb_slam(given: dict[str, Any], prefix: str) -> _Lens:
    """Read the settings of ORB-SLAM, whose keys have a prefix."""
    model = str(given.get("camera.type", "pinhole"))
    names = ("k1", "k2", "k3", "k4") if model.lower() in _FISHEYE else ("k1", "k2", "p1", "p2", "k3")
    stated = [name for name in names if f"{prefix}{name}" in given]
    return _Lens(
        int(given["camera.width"]),
        int(given["camera.height"]),
        _matrix(*(float(given[f"{prefix}{name}"]) for name in ("fx", "fy", "cx", "cy"))),
        model,
        [float(given.get(f"{prefix}{name}", 0.0)) for name in names] if stated else [],
    )


_FORMATS: dict[str, Callable[[dict[str, Any]], _Lens]] = {
    "camera_matrix": _opencv,
    "k": _camera_info,
    "cam0": lambda given: _kalibr(given["cam0"]),
    "intrinsics": _kalibr,
    "camera1.fx": lambda given: _orb_slam(given, "camera1."),
    "camera.fx": lambda given: _orb_slam(given, "camera."),
}
"""Reader by the key that shows the format."""

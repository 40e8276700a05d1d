"""Decoding of ROS messages: pixels, calibration, odometry and transforms."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.camera.calibration import Camera
from survey.data.sensors.aiding import Wheels
from vision_slam.io.images import decoded

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
# Channels, and how OpenCV turns them into grey or blue-green-red; None leaves them.
_ENCODINGS: dict[str, tuple[int, int | None]] = {
    "mono8": (1, None),
    "8UC1": (1, None),
    "mono16": (1, None),
    "16UC1": (1, None),
    "bgr8": (3, None),
    "8UC3": (3, None),
    "bgr16": (3, None),
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "rgb16": (3, cv2.COLOR_RGB2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2BGR),
    "rgba8": (4, cv2.COLOR_RGBA2BGR),
    "yuv422": (2, cv2.COLOR_YUV2BGR_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2BGR_YUY2),
    "yuyv": (2, cv2.COLOR_YUV2BGR_YUY2),
    "bayer_rggb8": (1, cv2.COLOR_BayerRGGB2BGR),
    "bayer_bggr8": (1, cv2.COLOR_BayerBGGR2BGR),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGBRG2BGR),
    "bayer_grbg8": (1, cv2.COLOR_BayerGRBG2BGR),
}


def decode_pixels(message: Any, msgtype: str, where: str) -> npt.NDArray[Any]:
    """Return the pixels of an image message, grey or blue-green-red."""
    if msgtype == COMPRESSED:
        return decoded(bytes(message.data), where)
    if message.encoding not in _ENCODINGS:
        raise InputError(
            f"{where} has the encoding {message.encoding!r}; one of {', '.join(_ENCODINGS)} was expected, convert it."
        )
    channels, conversion = _ENCODINGS[message.encoding]
    depth = np.dtype(np.uint16 if "16" in message.encoding else np.uint8)
    depth = depth.newbyteorder(">" if message.is_bigendian else "<")
    used = message.width * channels * depth.itemsize
    if message.step < used or len(message.data) < message.step * message.height:
        raise InputError(
            f"{where} is cut off: {len(message.data)} bytes for {message.width} × {message.height} pixels."
        )
    rows = np.frombuffer(bytes(message.data), np.uint8)[: message.step * message.height]
    rows = np.ascontiguousarray(rows.reshape(message.height, message.step)[:, :used])
    pixels: npt.NDArray[Any] = rows.view(depth).astype(depth.newbyteorder("="))
    if channels > 1:
        pixels = pixels.reshape(message.height, message.width, channels)
    return pixels if conversion is None else np.asarray(cv2.cvtColor(pixels, conversion))


def decode_camera(info: Any, mounted: FloatArray, place: Path) -> Camera:
    """Return the calibration from a CameraInfo, whose fields are named in capitals in ROS 1."""
    matrix, lens = (
        np.asarray(getattr(info, n, getattr(info, n.upper(), None)), dtype=float) for n in ("k", "d")
    )
    if matrix.size != 9 or matrix.ravel()[0] <= 0.0:
        raise InputError(
            f"{place} has a camera_info without a calibration; calibrate, or name one with --camera."
        )
    if info.distortion_model in {"equidistant", "fisheye"}:
        return Camera("fisheye", info.width, info.height, matrix.reshape(3, 3), _padded(lens, 4), mounted)
    if len(lens) > 5 and np.any(lens[5:]):
        raise InputError(
            f"{place} has the distortion model {info.distortion_model!r} with {len(lens)} coefficients; "
            "plumb_bob or equidistant was expected, rectify the images or calibrate again."
        )
    coefficients, is_assumed = _padded(lens, 5), lens.size == 0
    return Camera(
        "pinhole",
        info.width,
        info.height,
        matrix.reshape(3, 3),
        coefficients,
        mounted,
        distortion_is_assumed=is_assumed,
    )


def decode_fix_sigma_m(message: Any) -> float:
    """Return the horizontal standard deviation in each axis [m] of a NavSatFix; 0 where it states no covariance."""
    east_m2, north_m2 = message.position_covariance[0], message.position_covariance[4]
    is_stated = message.position_covariance_type > 0 and east_m2 > 0.0 and north_m2 > 0.0
    return float(np.sqrt(0.5 * (east_m2 + north_m2))) if is_stated else 0.0


def _padded(coefficients: FloatArray, n: int) -> FloatArray:
    padded: FloatArray = np.r_[coefficients, np.zeros(n)][:n]
    return padded


def decode_wheels(rows: list[tuple[float, ...]]) -> Wheels:
    """Return the distance along the body's own forward axis, summed."""
    table = np.array(rows)
    forward = Rotation.from_quat(table[:-1, 4:]).apply([1.0, 0.0, 0.0])
    steps = np.einsum("ni,ni->n", forward, np.diff(table[:, 1:4], axis=0))
    travel = np.r_[0.0, np.cumsum(steps)]
    return Wheels(table[:, 0], travel, travel)


def decode_transform(message: Any) -> tuple[str, FloatArray]:
    """Return the parent frame, and the child's pose in it."""
    shift, turn = message.transform.translation, message.transform.rotation
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    pose[:3, 3] = shift.x, shift.y, shift.z
    return message.header.frame_id.lstrip("/"), pose


def stamp_s(stamp: Any) -> float:
    """Return a time stamp in seconds."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)

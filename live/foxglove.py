"""Messages of Foxglove's schemas as JSON: the parts of the schemas that are written, and what a rover senses while it drives.

Frames and units are those of the bags (`survey.interchange.drive_bags`): ``base_link`` is the body with x forward, y left
and z up, ``camera`` an optical frame; ``map`` has east, north and up from the start; ``odom`` is turned by the heading of the
start. Two schemas are firnline's own, since Foxglove has none: inertial readings and wheel odometry.
"""

import base64
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from pyproj import CRS
from scipy.spatial.transform import Rotation

from sim.simulate.navigator import Start
from sim.vehicle.motion import RoverState
from survey.core import FloatArray
from survey.core.transformation import WGS84, transformed
from survey.data.camera import Camera
from survey.data.frames import Image
from survey.data.recording import Readings
from survey.data.sensors.records import GpsFixes, Inertial, Wheels

NANO = 10**9


def _object(**properties: Any) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


_NUMBER, _TEXT, _WHOLE = {"type": "number"}, {"type": "string"}, {"type": "integer"}
_NUMBERS = {"type": "array", "items": _NUMBER}
_BYTES = {"type": "string", "contentEncoding": "base64"}
_TIME = _object(sec=_WHOLE, nsec=_WHOLE)
_VECTOR = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER)
_TURN = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE = _object(position=_VECTOR, orientation=_TURN)
_STAMP = {"timestamp": _TIME, "frame_id": _TEXT}
_FIELD = _object(name=_TEXT, offset=_WHOLE, type=_WHOLE)
_LINK = _object(
    timestamp=_TIME, parent_frame_id=_TEXT, child_frame_id=_TEXT, translation=_VECTOR, rotation=_TURN
)
SCHEMAS: dict[str, dict[str, Any]] = {
    "PoseInFrame": _object(**_STAMP, pose=_POSE, position_covariance=_NUMBERS),
    "PosesInFrame": _object(**_STAMP, poses={"type": "array", "items": _POSE}),
    "PointCloud": _object(
        **_STAMP, pose=_POSE, point_stride=_WHOLE, fields={"type": "array", "items": _FIELD}, data=_BYTES
    ),
    "CompressedImage": _object(**_STAMP, data=_BYTES, format=_TEXT),
    "CameraCalibration": _object(
        **_STAMP, width=_WHOLE, height=_WHOLE, distortion_model=_TEXT, D=_NUMBERS, K=_NUMBERS, R=_NUMBERS, P=_NUMBERS
    ),
    "LocationFix": _object(
        **_STAMP,
        latitude=_NUMBER,
        longitude=_NUMBER,
        altitude=_NUMBER,
        position_covariance=_NUMBERS,
        position_covariance_type=_WHOLE,
    ),
    "FrameTransforms": _object(transforms={"type": "array", "items": _LINK}),
    "Imu": _object(**_STAMP, angular_velocity=_VECTOR, linear_acceleration=_VECTOR),
    "WheelOdometry": _object(**_STAMP, pose=_POSE, left_m=_NUMBER, right_m=_NUMBER),
}  # fmt: skip
"""By the name of the schema without ``foxglove.`` or ``firnline.``; σ and covariances are more than Foxglove's have."""


def named(names: str, values: FloatArray) -> dict[str, float]:
    """Return values under names of one letter, such as x, y and z."""
    return dict(zip(names, values.tolist(), strict=True))


def xyz(position: FloatArray) -> dict[str, float]:
    """Return a place (3,) as Foxglove writes it."""
    return named("xyz", position)


def stamped(time_s: float, frame: str, content: dict[str, Any]) -> dict[str, Any]:
    """Return a message with its time [s] and frame."""
    return {"timestamp": _stamp(time_s), "frame_id": frame, **content}


def _stamp(time_s: float) -> dict[str, int]:
    stamp = round(time_s * NANO)
    return {"sec": stamp // NANO, "nsec": stamp % NANO}


CHANNELS = {
    "/tf_static": "foxglove.FrameTransforms",
    "/camera/image": "foxglove.CompressedImage",
    "/camera/calibration": "foxglove.CameraCalibration",
    "/imu/data": "firnline.Imu",
    "/gps/fix": "foxglove.LocationFix",
    "/wheel/odometry": "firnline.WheelOdometry",
}
"""Schemas of what a rover senses, by topic."""
TRUTH_TOPIC = "/ground_truth/pose"
_JPEG_QUALITY = 90
_UNTURNED = np.array([0.0, 0.0, 0.0, 1.0])

_Message = tuple[str, float, dict[str, Any]]
"""Topic, time [s] and message."""


class DriveMessages:
    """Messages of a drive in progress.

    `start`: calibration and start pose. `crs`: of start and fixes. `antenna_height_m`: of the receiver above the body's
    origin [m]. `track_gauge_m`: distance between the tracks [m].
    """

    def __init__(self, start: Start, crs: CRS, antenna_height_m: float, track_gauge_m: float) -> None:
        self._start, self._crs = start, crs
        self._antenna_m, self._gauge_m = antenna_height_m, track_gauge_m
        self._first: tuple[float, float] | None = None
        self._rolled = np.zeros(4)  # x, y, heading, distance

    def transforms(self) -> dict[str, Any]:
        """Return the mountings of the sensors, and the places of ``odom`` and ``map``."""
        T_body_camera, half = self._start.camera.T_body_camera, 0.5 * self._start.heading_rad
        links = (
            ("base_link", "camera", T_body_camera[:3, 3], Rotation.from_matrix(T_body_camera[:3, :3]).as_quat()),
            ("base_link", "gps", np.array([0.0, 0.0, self._antenna_m]), _UNTURNED),
            ("base_link", "imu", np.zeros(3), _UNTURNED),
            ("map", "odom", np.zeros(3), np.array([0.0, 0.0, np.sin(half), np.cos(half)])),
            ("crs", "map", self._start.position, _UNTURNED),
        )  # fmt: skip
        return {
            "transforms": [
                {"timestamp": _stamp(0.0), "parent_frame_id": parent, "child_frame_id": child}
                | {"translation": xyz(place), "rotation": named("xyzw", turn)}
                for parent, child, place, turn in links
            ]
        }

    def of(self, readings: Readings) -> Iterator[_Message]:
        """Yield the messages of readings."""
        if readings.frame is not None:
            time_s, image = readings.frame
            yield "/camera/image", time_s, stamped(time_s, "camera", _compressed(image))
            calibration = _calibration(self._start.camera)
            yield "/camera/calibration", time_s, stamped(time_s, "camera", calibration)
        if readings.inertial is not None:
            yield from _inertial(readings.inertial)
        if readings.gps is not None:
            yield from self._fixes(readings.gps)
        if readings.wheels is not None:
            yield from self._wheels(readings.wheels)

    def truth(self, state: RoverState) -> _Message:
        """Return the message of the real pose."""
        place = np.array(state.position) - self._start.position
        pose = {"position": xyz(place), "orientation": named("xyzw", np.array(state.quaternion))}
        return TRUTH_TOPIC, state.time_s, stamped(state.time_s, "map", {"pose": pose})

    def _fixes(self, fixes: GpsFixes) -> Iterator[_Message]:
        degrees = transformed(fixes.position[:, :2], self._crs, WGS84, "the fixes")
        rows = zip(fixes.time_s.tolist(), degrees.tolist(), fixes.position[:, 2].tolist(), strict=True)
        for time_s, (longitude, latitude), altitude in rows:
            place = {"latitude": latitude, "longitude": longitude, "altitude": altitude}
            unknown = {"position_covariance": [0.0] * 9, "position_covariance_type": 0}
            yield "/gps/fix", time_s, stamped(time_s, "gps", place | unknown)

    def _wheels(self, wheels: Wheels) -> Iterator[_Message]:
        """Yield what the encoders count, and the path in the plane that they give alone."""
        for time_s, left_m, right_m in zip(*(each.tolist() for each in (wheels.time_s, wheels.left_m, wheels.right_m)), strict=True):  # fmt: skip
            self._first = self._first or (left_m, right_m)
            left, right = left_m - self._first[0], right_m - self._first[1]
            x, y, before_rad, before_m = self._rolled
            heading_rad, distance_m = (right - left) / self._gauge_m, 0.5 * (left + right)
            middle, step = 0.5 * (before_rad + heading_rad), distance_m - before_m
            x, y = x + step * np.cos(middle), y + step * np.sin(middle)
            self._rolled = np.array([x, y, heading_rad, distance_m])
            turn = np.array([0.0, 0.0, np.sin(0.5 * heading_rad), np.cos(0.5 * heading_rad)])
            pose = {"position": xyz(np.array([x, y, 0.0])), "orientation": named("xyzw", turn)}
            content = {"pose": pose, "left_m": left_m, "right_m": right_m}
            yield "/wheel/odometry", time_s, stamped(time_s, "odom", content)


def _inertial(inertial: Inertial) -> Iterator[_Message]:
    rows = zip(inertial.time_s.tolist(), inertial.gyro_rad_s, inertial.specific_force_m_s2, strict=True)
    for time_s, rate, force in rows:
        content = {"angular_velocity": xyz(rate), "linear_acceleration": xyz(force)}
        yield "/imu/data", time_s, stamped(time_s, "imu", content)


def _compressed(image: Image) -> dict[str, Any]:
    _, content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return {"data": base64.b64encode(content.tobytes()).decode(), "format": "jpeg"}


def _calibration(camera: Camera) -> dict[str, Any]:
    """Return a calibration; Foxglove's kannala_brandt is the fisheye model of OpenCV."""
    return {
        "width": camera.width,
        "height": camera.height,
        "distortion_model": {"fisheye": "kannala_brandt", "pinhole": "plumb_bob"}[camera.model],
        "D": camera.distortion.tolist(),
        "K": camera.matrix.ravel().tolist(),
        "R": np.eye(3).ravel().tolist(),
        "P": np.column_stack([camera.matrix, np.zeros(3)]).ravel().tolist(),
    }

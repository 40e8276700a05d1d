"""Logs of ArduPilot (``.bin``, telemetry ``.tlog``) and PX4 (``.ulg``) as recordings."""

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS

from live.logs.columns import LogColumns
from survey.core.errors import InputError
from survey.core.files import existing_file
from survey.data.recording import Recording

LOG_ENDINGS = (".bin", ".tlog", ".ulg")
_TOPICS = ("vehicle_gps_position", "sensor_gps", "sensor_combined", "vehicle_attitude")
_MICRO, _MILLI, _PER_DEGREE = 1e-6, 1e-3, 1e7


def read_autopilot_log(path: str | Path, crs: CRS | str | None = None) -> tuple[Recording, tuple[str, ...]]:
    """Read fixes with their quality, wheels, inertial readings and headings from the log of an autopilot.

    Parameters
    ----------
    path : str or pathlib.Path
        ``.bin`` or ``.tlog`` of ArduPilot, ``.ulg`` of PX4. Of several receivers or inertial units the first counts.
    crs : str or pyproj.CRS, optional
        Projected CRS; the UTM zone of the first fix by default.

    Returns
    -------
    tuple of Recording and tuple of str
        The recording, and notes on what was left out.

    Raises
    ------
    InputError
        A file that is missing, damaged or of another kind, or with fewer than two fixes.

    Notes
    -----
    Wheels are read from ArduPilot (WENC, WHEEL_DISTANCE); PX4 logs angles of wheels without their radius. The yaw that an
    autopilot estimated counts as its compass. Its roll and pitch are not read: localization estimates them from the inertial
    readings.
    """
    file = existing_file(path, "the log")
    reader = _READERS.get(file.suffix.lower())
    if reader is None:
        raise InputError(
            f"{file.name} ends in {file.suffix!r}; one of {', '.join(LOG_ENDINGS)} was expected."
        )
    try:
        columns = reader(file)
    except InputError:
        raise
    except Exception as error:  # readers of logs raise errors of many kinds on damaged files
        raise InputError(
            f"the log {file} is damaged or not of the format of its ending ({type(error).__name__}: {error}); get it again."
        ) from error
    return columns.recording(file, crs)


def _read_mavlink(file: Path) -> LogColumns:
    """Read every message of a log that pymavlink knows."""
    os.environ.setdefault("MAVLINK20", "1")
    from pymavlink import mavutil

    columns = LogColumns()
    log: Any = mavutil.mavlink_connection(str(file))
    try:
        while (message := log.recv_match(type=list(_TAKEN))) is not None:
            _TAKEN[message.get_type()](message, columns)
    finally:
        log.close()
    return columns


def _take_gps(message: Any, columns: LogColumns) -> None:
    if getattr(message, "I", 0) == 0:
        place = message.Lng, message.Lat, message.Alt
        columns.fixes.append((message.TimeUS * _MICRO, *place, float(message.Status), math.nan))


def _take_accuracy(message: Any, columns: LogColumns) -> None:
    """Complete the last fix by the accuracy that follows it."""
    if getattr(message, "I", 0) == 0 and columns.fixes:
        columns.fixes[-1] = (*columns.fixes[-1][:5], float(message.HAcc))


def _take_wheels(message: Any, columns: LogColumns) -> None:
    columns.wheels.append((message.TimeUS * _MICRO, message.Dist0, message.Dist1))


def _take_imu(message: Any, columns: LogColumns) -> None:
    if getattr(message, "I", 0) == 0:
        rates = message.GyrX, message.GyrY, message.GyrZ
        columns.inertial.append((message.TimeUS * _MICRO, *rates, message.AccX, message.AccY, message.AccZ))


def _take_raw_fix(message: Any, columns: LogColumns) -> None:
    place = message.lon / _PER_DEGREE, message.lat / _PER_DEGREE, message.alt * _MILLI
    stated = message.h_acc * _MILLI if message.h_acc else math.nan
    columns.fixes.append((message.time_usec * _MICRO, *place, float(message.fix_type), stated))


def _take_wheel_distance(message: Any, columns: LogColumns) -> None:
    if message.count >= 2:
        columns.wheels.append((message.time_usec * _MICRO, *message.distance[:2]))


def _take_highres_imu(message: Any, columns: LogColumns) -> None:
    rates = message.xgyro, message.ygyro, message.zgyro
    columns.inertial.append((message.time_usec * _MICRO, *rates, message.xacc, message.yacc, message.zacc))


def _take_attitude(message: Any, columns: LogColumns) -> None:
    columns.headings.append((message.TimeUS * _MICRO, math.radians(message.Yaw)))


def _take_link_attitude(message: Any, columns: LogColumns) -> None:
    columns.headings.append((message.time_boot_ms * _MILLI, message.yaw))


_TAKEN: dict[str, Callable[[Any, LogColumns], None]] = {
    "GPS": _take_gps,
    "GPA": _take_accuracy,
    "WENC": _take_wheels,
    "IMU": _take_imu,
    "ATT": _take_attitude,
    "ATTITUDE": _take_link_attitude,
    "GPS_RAW_INT": _take_raw_fix,
    "WHEEL_DISTANCE": _take_wheel_distance,
    "HIGHRES_IMU": _take_highres_imu,
}


def _read_ulog(file: Path) -> LogColumns:
    from pyulog import ULog

    columns = LogColumns()
    for dataset in ULog(str(file), list(_TOPICS)).data_list:
        data = dataset.data
        if dataset.multi_id != 0:
            continue
        if dataset.name == "vehicle_attitude":
            columns.headings += _ulog_headings(data)
        elif dataset.name == "sensor_combined":
            names = [f"gyro_rad[{k}]" for k in range(3)] + [f"accelerometer_m_s2[{k}]" for k in range(3)]
            rows = zip(data["timestamp"] * _MICRO, *(data[name] for name in names), strict=True)
            columns.inertial += [tuple(map(float, row)) for row in rows]
        elif not columns.fixes:
            columns.fixes += _ulog_fixes(data)
    return columns


def _ulog_headings(data: dict[str, Any]) -> list[tuple[float, ...]]:
    """Return yaws from quaternions (w, x, y, z) that turn forward, right, down into north, east, down."""
    w, x, y, z = (data[f"q[{k}]"].astype(np.float64) for k in range(4))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y**2 + z**2))
    return list(zip((data["timestamp"] * _MICRO).tolist(), yaw.tolist(), strict=True))


def _ulog_fixes(data: dict[str, Any]) -> list[tuple[float, ...]]:
    """Return fixes in degrees, which older logs hold as integers."""
    if "latitude_deg" in data:
        place = data["longitude_deg"], data["latitude_deg"], data["altitude_msl_m"]
    else:
        place = data["lon"] / _PER_DEGREE, data["lat"] / _PER_DEGREE, data["alt"] * _MILLI
    rows = zip(data["timestamp"] * _MICRO, *place, data["fix_type"], data["eph"], strict=True)
    return [tuple(map(float, row)) for row in rows]


_READERS: dict[str, Callable[[Path], LogColumns]] = {
    ".bin": _read_mavlink,
    ".tlog": _read_mavlink,
    ".ulg": _read_ulog,
}

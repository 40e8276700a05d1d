"""Logs of ArduPilot (``.bin``, telemetry ``.tlog``) and PX4 (``.ulg``) as recordings.

`read_autopilot_log` takes fixes, wheel distances, inertial readings and headings from the messages of a log into
`LogColumns`, which projects the fixes, estimates their errors where the receiver states none, and returns a
`Recording`. pymavlink and pyulog are imported when a log is read.
"""

import math
import mmap
import os
import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pyproj import CRS

from survey import InputError, Recording
from survey.core import BoolArray, FloatArray, existing_file, projected_crs, refusing_damage
from survey.core.transformation import WGS84, chosen_crs, transformed
from survey.data.sensors.records import Compass, GpsFixes, Inertial, Wheels

LEAST_FIX = 3
# Horizontal errors of fixes by their type, where the receiver states none: 3-D, differential, RTK float, RTK fixed [m].
_SIGMA_M = {3: 1.1, 4: 0.6, 5: 0.3, 6: 0.02}
_BEST_TYPE = 6
_UPWARD = 1.7  # error of heights over that across
# Types of vehicles as MAVLink numbers them.
_FLYING = frozenset({*range(1, 5), *range(7, 10), *range(13, 18), *range(19, 26), 28, 29, 35, 36, 43})
_ON_THE_GROUND = frozenset({10, 11, 12})
_MULTICOPTER, _ROVER = 2, 10
_NORTHWARD_DEG = 1e-3
# Headings farther from the fixes than this were stamped by another clock.
_APART_S = 60.0


@dataclass
class LogColumns:
    """Rows of fixes of each receiver, wheels and inertial readings.

    `receivers`: by name time [s], longitude, latitude [deg], height [m], type of fix, stated errors across and of the height
    [m] or NaN. `wheels`: time [s], distance of the left and of the right side [m]. `inertial`: time [s], rates [rad/s]
    and specific force [m/s²] forward, right, down. `headings`: time [s], yaw that the autopilot estimated,
    clockwise from true north [rad]. `vehicle`: what the log calls it where it is one that flies, or ``""``. `is_ground`:
    whether the log calls it one that does not. `has_flown`: whether it was seen in the air. `lost`: what the log itself lost, one
    note each. `n_cut`: bytes at the end of the file that are no whole record.
    """

    receivers: dict[str, list[tuple[float, ...]]] = field(default_factory=dict)
    wheels: list[tuple[float, ...]] = field(default_factory=list)
    inertial: list[tuple[float, ...]] = field(default_factory=list)
    headings: list[tuple[float, ...]] = field(default_factory=list)
    vehicle: str = ""
    is_ground: bool = False
    has_flown: bool = False
    lost: list[str] = field(default_factory=list)
    n_cut: int = 0

    @property
    def flown(self) -> str:
        """Why fixes of the log are no ground: the vehicle that flies, or ``""``; its type counts more than a land detector."""
        if self.vehicle or self.is_ground:
            return self.vehicle
        return "a vehicle that was in the air" if self.has_flown else ""

    def add_fix(self, receiver: str, *row: Any) -> None:
        """Add the fix of a receiver."""
        self.receivers.setdefault(receiver, []).append(tuple(map(float, row)))

    def set_vehicle(self, kind: int, name: str = "") -> None:
        """Take the type of a vehicle as MAVLink numbers it."""
        if kind in _FLYING:
            self.vehicle = name or f"a vehicle that flies (MAV_TYPE {kind})"
        elif kind in _ON_THE_GROUND:
            self.is_ground = True

    def recording(self, path: Path, crs: CRS | str | None) -> tuple[Recording, tuple[str, ...]]:
        """Return the recording, and what was left out or assumed."""
        usable = {name: _usable(rows) for name, rows in self.receivers.items()}
        chosen = max(usable, key=lambda name: len(usable[name]), default="")
        rows = usable.get(chosen, np.zeros((0, 7)))
        if len(rows) < 2:
            raise InputError(f"{path} holds {len(rows)} fixes of three dimensions; at least two are needed.")
        target = chosen_crs(rows[:1, 1], rows[:1, 2]) if crs is None else projected_crs(crs, "the log")
        xy = transformed(rows[:, 1:3], WGS84, target, "the fixes")
        gps = GpsFixes(rows[:, 0], np.column_stack([xy, rows[:, 3]]), _sigma_m(rows), _sigma_z_m(rows))
        n_bad = len(self.receivers[chosen]) - len(rows)
        others = ", ".join(f"{len(usable[name])} of {name}" for name in usable if name != chosen)
        cut = (
            f"the log was cut off: its last {self.n_cut} bytes are no whole record; the last fix before is of {rows[-1, 0] - rows[0, 0]:.1f} s after the first",
        )
        notes = (
            f"works in {target.name}",
            f"{n_bad} records of the receiver without a fix or out of order are left out",
            *self.lost,
            *(cut if self.n_cut else ()),
            *([f"{len(rows)} fixes of {chosen} are used, and left out are {others}"] if others else []),
        )
        wheels, inertial = _table(self.wheels, 3), _table(self.inertial, 7)
        recording = Recording(
            target,
            gps.position[0],
            gps,
            start_is_surveyed=False,
            wheels=None if len(wheels) == 0 else Wheels(*wheels.T),
            inertial=None if len(inertial) == 0 else _in_body_frame(inertial),
            compass=_compass(_table(self.headings, 2), rows, target),
        )
        return recording, notes


def _usable(found: list[tuple[float, ...]]) -> FloatArray:
    """Return fixes of three dimensions in the order of their times."""
    rows = np.array(found, dtype=np.float64).reshape(-1, 7)
    is_fix = (rows[:, 4] >= LEAST_FIX) & np.isfinite(rows[:, :4]).all(axis=1) & rows[:, 1:3].any(axis=1)
    rows = rows[is_fix]
    fixes: FloatArray = rows[_increasing(rows[:, 0])]
    return fixes


def _table(rows: list[tuple[float, ...]], n_columns: int) -> FloatArray:
    """Return finite rows with increasing times."""
    table = np.array(rows, dtype=np.float64).reshape(-1, n_columns)
    table = table[np.isfinite(table).all(axis=1)]
    found: FloatArray = table[_increasing(table[:, 0])]
    return found


def _increasing(time_s: FloatArray) -> BoolArray:
    """Return which times are later than all before them."""
    before = np.concatenate([[-np.inf], np.maximum.accumulate(time_s)[:-1]])
    later: BoolArray = time_s > before
    return later


def _sigma_m(rows: FloatArray) -> FloatArray:
    """Return the horizontal standard deviation of each fix: stated, or by the type of fix."""
    types = np.clip(rows[:, 4], LEAST_FIX, _BEST_TYPE).astype(int)
    by_type = np.array([_SIGMA_M[kind] for kind in types])
    stated = rows[:, 5]
    return np.where(np.isfinite(stated) & (stated > 0.0), stated, by_type)


def _sigma_z_m(rows: FloatArray) -> FloatArray:
    """Return the standard deviation of the height of each fix: stated, or 1.7 times the horizontal one."""
    stated = rows[:, 6]
    return np.where(np.isfinite(stated) & (stated > 0.0), stated, _UPWARD * _sigma_m(rows))


def _in_body_frame(rows: FloatArray) -> Inertial:
    """Turn forward, right, down into forward, left, up."""
    turned = rows[:, 1:] * np.tile([1.0, -1.0, -1.0], 2)
    return Inertial(rows[:, 0], turned[:, :3], turned[:, 3:])


def _compass(headings: FloatArray, fixes: FloatArray, crs: CRS) -> Compass | None:
    """Turn headings clockwise from true north into those counter-clockwise from grid east, by the convergence at the start."""
    is_near = (headings[:, 0] >= fixes[0, 0] - _APART_S) & (headings[:, 0] <= fixes[-1, 0] + _APART_S)
    if not is_near.any():
        return None
    ends = fixes[0, 1:3] + np.array([[0.0, 0.0], [0.0, _NORTHWARD_DEG]])
    east, north = np.diff(transformed(ends, WGS84, crs, "the fixes"), axis=0)[0]
    heading = np.arctan2(north, east) - headings[is_near, 1]
    return Compass(headings[is_near, 0], (heading + np.pi) % (2.0 * np.pi) - np.pi)


LOG_ENDINGS = (".bin", ".tlog", ".ulg")
_TOPICS = (
    *("vehicle_gps_position", "sensor_gps", "sensor_combined", "vehicle_attitude"),
    *("vehicle_status", "vehicle_land_detected"),
)
_MICRO, _MILLI, _PER_DEGREE = 1e-6, 1e-3, 1e7


class AutopilotLog(NamedTuple):
    """Recording of a log, what was left out or assumed, and what the log calls a vehicle that flies; ``""`` for others."""

    recording: Recording
    notes: tuple[str, ...]
    flown: str = ""


def read_autopilot_log(path: str | Path, crs: CRS | str | None = None) -> AutopilotLog:
    """Read fixes with their quality, wheels, inertial readings and headings from the log of an autopilot.

    Wheels are read from ArduPilot (WENC, WHEEL_DISTANCE); PX4 logs angles of wheels without their radius. The yaw that an
    autopilot estimated counts as its compass. Its roll and pitch are not read: localization estimates them from the inertial
    readings. Of several receivers that with the most fixes is used. A vehicle flies by its type, or where that is unknown by
    the autopilot's land detector.
    """
    file = existing_file(path, "the log")
    reader = _READERS.get(file.suffix.lower())
    if reader is None:
        raise InputError(
            f"{file.name} ends in {file.suffix!r}; one of {', '.join(LOG_ENDINGS)} was expected."
        )
    with refusing_damage(f"the log {file}", "log of the format of its suffix"):
        columns = reader(file)
    return AutopilotLog(*columns.recording(file, crs), columns.flown)


def _read_mavlink(file: Path) -> LogColumns:
    """Read every message of a log that pymavlink knows."""
    os.environ.setdefault("MAVLINK20", "1")
    from pymavlink import mavutil

    columns = LogColumns()
    log: Any = mavutil.mavlink_connection(str(file))
    try:
        while (message := log.recv_match(type=list(_TAKEN))) is not None:
            _TAKEN[message.get_type()](message, columns)
        formats = getattr(log, "formats", {})
    finally:
        log.close()

    def length_at(data: mmap.mmap, place: int) -> int:
        if (
            not formats
        ):  # telemetry: 8 bytes of time, and a frame of MAVLink 1 or of MAVLink 2, which may be signed
            n, is_signed = data[place + 9], data[place + 10] & 1
            return {0xFE: 16 + n, 0xFD: 20 + n + 13 * is_signed}.get(data[place + 8], 0)
        is_record = data[place] == 0xA3 and data[place + 1] == 0x95 and data[place + 2] in formats
        return int(formats[data[place + 2]].len) if is_record else 0

    columns.n_cut = _n_cut(file, 0, length_at)
    return columns


def _n_cut(file: Path, first: int, length_at: Callable[[mmap.mmap, int], int]) -> int:
    """Return how many bytes at the end of a log are no whole record; 0 where its records do not follow one another."""
    with file.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        n, place, length = len(data), first, 1
        with suppress(IndexError, struct.error):  # the head of a record may be cut off
            while place < n and 0 < (length := length_at(data, place)) <= n - place:
                place += length
        return n - place if length else 0


def _take_gps(message: Any, columns: LogColumns) -> None:
    place = message.Lng, message.Lat, message.Alt
    row = message.TimeUS * _MICRO, *place, message.Status, math.nan, math.nan
    columns.add_fix(_receiver(message), *row)


def _take_accuracy(message: Any, columns: LogColumns) -> None:
    """Complete the last fix of a receiver by the accuracy that follows it."""
    rows = columns.receivers.get(_receiver(message))
    if rows:
        rows[-1] = (*rows[-1][:5], float(message.HAcc), float(getattr(message, "VAcc", math.nan)))


def _receiver(message: Any) -> str:
    """Return the name of the receiver that a message of ArduPilot is of: GPS 0, GPS 1; before version 4.1 GPS and GPS2."""
    kind = str(message.get_type()).replace("GPA", "GPS")
    return f"{kind} {message.I}" if hasattr(message, "I") else kind


def _take_words(message: Any, columns: LogColumns) -> None:
    """Take the vehicle from the name of the program, such as ArduCopter V4.5.7."""
    words = str(message.Message)
    found = next((kind for name, kind in _PROGRAMS.items() if words.startswith(name)), None)
    if found is not None:
        columns.set_vehicle(found, words.split(" (", maxsplit=1)[0])


def _take_heartbeat(message: Any, columns: LogColumns) -> None:
    if message.autopilot != _NO_AUTOPILOT:
        columns.set_vehicle(message.type)


def _take_landed_state(message: Any, columns: LogColumns) -> None:
    columns.has_flown |= message.landed_state in _IN_THE_AIR


def _take_wheels(message: Any, columns: LogColumns) -> None:
    columns.wheels.append((message.TimeUS * _MICRO, message.Dist0, message.Dist1))


def _take_imu(message: Any, columns: LogColumns) -> None:
    if getattr(message, "I", 0) == 0:
        rates = message.GyrX, message.GyrY, message.GyrZ
        columns.inertial.append((message.TimeUS * _MICRO, *rates, message.AccX, message.AccY, message.AccZ))


def _take_raw_fix(message: Any, columns: LogColumns) -> None:
    place = message.lon / _PER_DEGREE, message.lat / _PER_DEGREE, message.alt * _MILLI
    stated = (value * _MILLI if value else math.nan for value in (message.h_acc, message.v_acc))
    name = f"{message.get_type()} of system {message.get_srcSystem()}"
    columns.add_fix(name, message.time_usec * _MICRO, *place, message.fix_type, *stated)


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


# Programs of ArduPilot by the type of their vehicle.
_PROGRAMS = {
    "ArduCopter": 2, "ArduPlane": 1, "Blimp": 7, "ArduRover": 10, "Rover": 10, "APM:Copter": 2, "APM:Plane": 1,
    "APM:Rover": 10, "ArduSub": 12,
}  # fmt: skip
_NO_AUTOPILOT, _IN_THE_AIR = 8, (2, 3, 4)
_TAKEN: dict[str, Callable[[Any, LogColumns], None]] = {
    "GPS": _take_gps, "GPS2": _take_gps, "GPA": _take_accuracy, "GPA2": _take_accuracy, "MSG": _take_words,
    "HEARTBEAT": _take_heartbeat, "EXTENDED_SYS_STATE": _take_landed_state, "GPS2_RAW": _take_raw_fix, "WENC": _take_wheels, "IMU": _take_imu, "ATT": _take_attitude,
    "ATTITUDE": _take_link_attitude, "GPS_RAW_INT": _take_raw_fix, "WHEEL_DISTANCE": _take_wheel_distance,
    "HIGHRES_IMU": _take_highres_imu,
}  # fmt: skip


def _read_ulog(file: Path) -> LogColumns:
    from pyulog import ULog

    columns = LogColumns()
    log = ULog(str(file), list(_TOPICS))
    columns.set_vehicle(int(log.initial_parameters.get("MAV_TYPE", 0)))
    if log.file_corruption:
        columns.lost.append("the log is damaged: messages that cannot be read are left out")
    elif not log.has_data_appended:
        columns.n_cut = _n_cut(file, 16, lambda data, place: 3 + struct.unpack_from("<HB", data, place)[0])
    if log.dropouts:
        lost_s = _MILLI * sum(dropout.duration for dropout in log.dropouts)
        columns.lost.append(f"the logger lost {lost_s:.1f} s in {len(log.dropouts)} gaps")
    for dataset in log.data_list:
        data = dataset.data
        if dataset.name in ("vehicle_gps_position", "sensor_gps"):
            columns.receivers[f"{dataset.name} {dataset.multi_id}"] = _ulog_fixes(data)
        elif dataset.multi_id != 0:
            continue
        elif dataset.name == "vehicle_attitude":
            columns.headings += _ulog_headings(data)
        elif dataset.name == "sensor_combined":
            names = [f"gyro_rad[{k}]" for k in range(3)] + [f"accelerometer_m_s2[{k}]" for k in range(3)]
            rows = zip(data["timestamp"] * _MICRO, *(data[name] for name in names), strict=True)
            columns.inertial += [tuple(map(float, row)) for row in rows]
        elif dataset.name == "vehicle_land_detected":
            columns.has_flown |= not data["landed"].all()
        elif "vehicle_type" in data and len(data["vehicle_type"]):
            _set_ulog_vehicle(int(data["vehicle_type"][-1]), columns)
    return columns


# Types of vehicle_status with a type of MAVLink and their name.
_ULOG_VEHICLES = {
    1: (_MULTICOPTER, "a multicopter"),
    2: (1, "an aircraft with fixed wings"),
    3: (_ROVER, ""),
    4: (7, "an airship"),
}


def _set_ulog_vehicle(kind: int, columns: LogColumns) -> None:
    """Take the type of vehicle_status, which counts more than that of the parameters."""
    if kind in _ULOG_VEHICLES:
        columns.vehicle, columns.is_ground = "", False
        columns.set_vehicle(*_ULOG_VEHICLES[kind])


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
    errors = (data.get(name, np.full(len(data["timestamp"]), np.nan)) for name in ("eph", "epv"))
    rows = zip(data["timestamp"] * _MICRO, *place, data["fix_type"], *errors, strict=True)
    return [tuple(map(float, row)) for row in rows]


_READERS: dict[str, Callable[[Path], LogColumns]] = {
    ".bin": _read_mavlink,
    ".tlog": _read_mavlink,
    ".ulg": _read_ulog,
}

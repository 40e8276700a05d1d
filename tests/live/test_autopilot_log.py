"""Logs of ArduPilot and PX4, written here as their formats say, become recordings that localize."""

import gc
import struct
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import common
from typer.testing import CliRunner

from firnline.cli.main import app
from live.autopilot_logs import read_autopilot_log
from survey.core.errors import InputError

N = 40
LATITUDE, LONGITUDE, HEIGHT_M = 58.4, -135.0, 900.0
YAW_RAD = 0.5


def place(k: int) -> tuple[float, float]:
    return LATITUDE + 1e-5 * k, LONGITUDE


def write_tlog(path: Path) -> None:
    sender, content = common.MAVLink(None, 1, 1), b""
    for k in range(N):
        latitude, longitude = (round(1e7 * value) for value in place(k))
        fix = common.MAVLink_gps_raw_int_message(
            1_000_000 * k,
            6 if k else 1,
            latitude,
            longitude,
            round(1e3 * HEIGHT_M),
            60,
            60,
            100,
            0,
            20,
            0,
            20,
            30,
            0,
            0,
        )
        wheels = common.MAVLink_wheel_distance_message(1_000_000 * k + 1, 2, [1.1 * k, 1.1 * k, *[0.0] * 14])
        attitude = common.MAVLink_attitude_message(1_000 * k, 0.1, 0.2, YAW_RAD, 0.0, 0.0, 0.0)
        for message in (fix, wheels, attitude):
            content += struct.pack(">Q", 1_000_000 * k) + message.pack(sender)
    path.write_bytes(content)


def write_bin(path: Path) -> None:
    formats = {128: ("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 89)}
    formats[129] = ("GPS", "QBLLf", "TimeUS,Status,Lat,Lng,Alt", 3 + 8 + 1 + 4 + 4 + 4)
    formats[130] = ("IMU", "Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", 3 + 8 + 24)
    formats[131] = ("WENC", "Qff", "TimeUS,Dist0,Dist1", 3 + 8 + 8)
    formats[132] = ("ATT", "Qcc", "TimeUS,Pitch,Yaw", 3 + 8 + 4)
    content = b""
    for kind, (name, form, columns, length) in formats.items():
        content += b"\xa3\x95\x80" + struct.pack(
            "<BB4s16s64s", kind, length, name.encode(), form.encode(), columns.encode()
        )
    for k in range(N):
        latitude, longitude = (round(1e7 * value) for value in place(k))
        content += b"\xa3\x95\x81" + struct.pack("<QBiif", 1_000_000 * k, 5, latitude, longitude, HEIGHT_M)
        content += b"\xa3\x95\x82" + struct.pack("<Qffffff", 1_000_000 * k, 0.1, 0.2, 0.3, 0.0, 1.0, -9.8)
        content += b"\xa3\x95\x83" + struct.pack("<Qff", 1_000_000 * k, 1.1 * k, 1.1 * k)
        yaw = round(100.0 * np.degrees(YAW_RAD))
        content += b"\xa3\x95\x84" + struct.pack("<Qhh", 1_000_000 * k, 0, yaw)
    path.write_bytes(content)


def write_ulog(path: Path) -> None:
    def message(kind: bytes, data: bytes) -> bytes:
        return struct.pack("<HB", len(data), kind[0]) + data

    fields = "uint64_t timestamp;double latitude_deg;double longitude_deg;double altitude_msl_m;uint8_t fix_type;float eph;"
    content = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    content += message(b"B", bytes(40))
    content += message(b"F", b"vehicle_gps_position:" + fields.encode())
    content += message(b"F", b"vehicle_attitude:uint64_t timestamp;float[4] q;")
    content += message(b"A", struct.pack("<BH", 0, 0) + b"vehicle_gps_position")
    content += message(b"A", struct.pack("<BH", 0, 1) + b"vehicle_attitude")
    for k in range(N):
        row = struct.pack("<QdddBf", 1_000_000 * k, *place(k), HEIGHT_M, 6, 0.05)
        content += message(b"D", struct.pack("<H", 0) + row)
        turned = struct.pack("<Qffff", 1_000_000 * k, np.cos(0.5 * YAW_RAD), 0.0, 0.0, np.sin(0.5 * YAW_RAD))
        content += message(b"D", struct.pack("<H", 1) + turned)
    path.write_bytes(content)


WRITERS = {"a.tlog": write_tlog, "a.bin": write_bin, "a.ulg": write_ulog}
SIGMA_M = {"a.tlog": 0.02, "a.bin": 0.3, "a.ulg": 0.05}


@pytest.mark.parametrize("name", WRITERS)
def test_a_log_becomes_a_recording_with_the_quality_of_its_fixes(name, tmp_path):
    WRITERS[name](tmp_path / name)
    recording, notes = read_autopilot_log(tmp_path / name, "EPSG:32608")
    assert len(recording.gps.time_s) >= N - 1
    np.testing.assert_allclose(np.diff(recording.gps.position[:, 1]), 1.114, atol=0.01)
    np.testing.assert_allclose(recording.gps.position[:, 2], HEIGHT_M, atol=1e-3)
    np.testing.assert_allclose(recording.gps.sigma_m, SIGMA_M[name], atol=1e-6)
    assert any("works in" in note for note in notes)
    assert (recording.wheels is None) == (name == "a.ulg")


@pytest.mark.parametrize("name", WRITERS)
def test_the_yaw_of_the_autopilot_is_a_heading_from_grid_east(name, tmp_path):
    WRITERS[name](tmp_path / name)
    recording, _ = read_autopilot_log(tmp_path / name, "EPSG:32609")
    convergence = np.radians(LONGITUDE + 129.0) * np.sin(np.radians(LATITUDE))
    np.testing.assert_allclose(recording.compass.heading_rad, 0.5 * np.pi - YAW_RAD + convergence, atol=2e-3)


def test_inertial_readings_are_turned_to_forward_left_up(tmp_path):
    write_bin(tmp_path / "a.bin")
    recording, _ = read_autopilot_log(tmp_path / "a.bin")
    np.testing.assert_allclose(recording.inertial.specific_force_m_s2[0], [0.0, -1.0, 9.8], atol=1e-5)
    np.testing.assert_allclose(recording.inertial.gyro_rad_s[0], [0.1, -0.2, -0.3], atol=1e-6)


def test_localize_reads_a_log(tmp_path):
    write_tlog(tmp_path / "a.tlog")
    result = CliRunner().invoke(
        app, ["localize", str(tmp_path / "a.tlog"), "-o", str(tmp_path / "out"), "-q"]
    )
    assert result.exit_code == 0, result.output
    assert (tmp_path / "out" / "trajectory.csv").exists()
    refused = CliRunner().invoke(app, ["localize", str(tmp_path / "a.tlog"), "--gps", "x.nmea"])
    assert refused.exit_code == 4


# pymavlink does not close a log that it cannot open.
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("name", WRITERS)
def test_damaged_logs_are_refused_or_read_as_far_as_they_are_sound(name, tmp_path):
    WRITERS[name](tmp_path / name)
    content = (tmp_path / name).read_bytes()
    for cut in (0, 3, 40, len(content) // 2):
        (tmp_path / name).write_bytes(content[:cut])
        try:
            recording, _ = read_autopilot_log(tmp_path / name)
        except InputError:
            continue
        assert len(recording.gps.time_s) < N
    (tmp_path / name).write_bytes(bytes(range(256)) * 40)
    with pytest.raises(InputError):
        read_autopilot_log(tmp_path / name)
    gc.collect()

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
from survey import SurfacePoints, Trajectory
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


def write_bin(path: Path, program: str = "") -> None:
    formats = {128: ("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 89)}
    formats[129] = ("GPS", "QBLLf", "TimeUS,Status,Lat,Lng,Alt", 3 + 8 + 1 + 4 + 4 + 4)
    formats[130] = ("IMU", "Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", 3 + 8 + 24)
    formats[131] = ("WENC", "Qff", "TimeUS,Dist0,Dist1", 3 + 8 + 8)
    formats[132] = ("ATT", "Qcc", "TimeUS,Pitch,Yaw", 3 + 8 + 4)
    formats[133] = ("MSG", "QZ", "TimeUS,Message", 3 + 8 + 64)
    content = b""
    for kind, (name, form, columns, length) in formats.items():
        content += b"\xa3\x95\x80" + struct.pack(
            "<BB4s16s64s", kind, length, name.encode(), form.encode(), columns.encode()
        )
    if program:
        content += b"\xa3\x95\x85" + struct.pack("<Q64s", 0, program.encode())
    for k in range(N):
        latitude, longitude = (round(1e7 * value) for value in place(k))
        content += b"\xa3\x95\x81" + struct.pack("<QBiif", 1_000_000 * k, 5, latitude, longitude, HEIGHT_M)
        content += b"\xa3\x95\x82" + struct.pack("<Qffffff", 1_000_000 * k, 0.1, 0.2, 0.3, 0.0, 1.0, -9.8)
        content += b"\xa3\x95\x83" + struct.pack("<Qff", 1_000_000 * k, 1.1 * k, 1.1 * k)
        yaw = round(100.0 * np.degrees(YAW_RAD))
        content += b"\xa3\x95\x84" + struct.pack("<Qhh", 1_000_000 * k, 0, yaw)
    path.write_bytes(content)


def write_ulog(
    path: Path, receivers: tuple[int, ...] = (N,), vehicle: int = 0, *, landed: bool = True
) -> None:
    """Write a log with so many fixes of each receiver, the type of the vehicle, and its land detector."""

    def message(kind: bytes, data: bytes) -> bytes:
        return struct.pack("<HB", len(data), kind[0]) + data

    fields = "uint64_t timestamp;double latitude_deg;double longitude_deg;double altitude_msl_m;uint8_t fix_type;float eph;float epv;"
    content = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    content += message(b"B", bytes(40))
    content += message(b"F", b"vehicle_gps_position:" + fields.encode())
    content += message(b"F", b"vehicle_attitude:uint64_t timestamp;float[4] q;")
    content += message(b"F", b"vehicle_status:uint64_t timestamp;uint8_t vehicle_type;")
    content += message(b"F", b"vehicle_land_detected:uint64_t timestamp;bool landed;")
    names = (b"vehicle_attitude", b"vehicle_status", b"vehicle_land_detected")
    for number, name in enumerate(names):
        content += message(b"A", struct.pack("<BH", 0, number) + name)
    for number in range(len(receivers)):
        content += message(b"A", struct.pack("<BH", number, 10 + number) + b"vehicle_gps_position")
    content += message(b"D", struct.pack("<HQB", 1, 0, vehicle))
    content += message(b"D", struct.pack("<HQ?", 2, 0, landed))
    for k in range(N):
        for number, n in enumerate(receivers):
            if k < n:
                row = struct.pack(
                    "<QdddBff", 1_000_000 * k, *place(k), HEIGHT_M, 6, 0.05 + number, 0.08 + number
                )
                content += message(b"D", struct.pack("<H", 10 + number) + row)
        turned = struct.pack("<Qffff", 1_000_000 * k, np.cos(0.5 * YAW_RAD), 0.0, 0.0, np.sin(0.5 * YAW_RAD))
        content += message(b"D", struct.pack("<H", 0) + turned)
    path.write_bytes(content)


WRITERS = {"a.tlog": write_tlog, "a.bin": write_bin, "a.ulg": write_ulog}
SIGMA_M = {"a.tlog": 0.02, "a.bin": 0.3, "a.ulg": 0.05}


@pytest.mark.parametrize("name", WRITERS)
def test_a_log_becomes_a_recording_with_the_quality_of_its_fixes(name, tmp_path):
    WRITERS[name](tmp_path / name)
    recording, notes, _ = read_autopilot_log(tmp_path / name, "EPSG:32608")
    assert len(recording.gps.time_s) >= N - 1
    np.testing.assert_allclose(np.diff(recording.gps.position[:, 1]), 1.114, atol=0.01)
    np.testing.assert_allclose(recording.gps.position[:, 2], HEIGHT_M, atol=1e-3)
    np.testing.assert_allclose(recording.gps.sigma_m, SIGMA_M[name], atol=1e-6)
    assert any("works in" in note for note in notes)
    assert (recording.wheels is None) == (name == "a.ulg")


@pytest.mark.parametrize("n_lost", [1, 12, 60])
@pytest.mark.parametrize("name", WRITERS)
def test_a_log_that_was_cut_off_is_read_to_there_and_says_so(name, n_lost, tmp_path):
    WRITERS[name](tmp_path / name)
    whole, notes, _ = read_autopilot_log(tmp_path / name)
    assert not any("cut off" in note for note in notes)
    content = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(content[:-n_lost])
    recording, notes, _ = read_autopilot_log(tmp_path / name)
    last_s = recording.gps.time_s[-1] - recording.gps.time_s[0]
    assert whole.gps.time_s[-1] - whole.gps.time_s[0] - 1.0 <= last_s
    assert any(
        f"bytes are no whole record; the last fix before is of {last_s:.1f} s" in note for note in notes
    )


@pytest.mark.parametrize("name", WRITERS)
def test_the_yaw_of_the_autopilot_is_a_heading_from_grid_east(name, tmp_path):
    WRITERS[name](tmp_path / name)
    recording, *_ = read_autopilot_log(tmp_path / name, "EPSG:32609")
    convergence = np.radians(LONGITUDE + 129.0) * np.sin(np.radians(LATITUDE))
    np.testing.assert_allclose(recording.compass.heading_rad, 0.5 * np.pi - YAW_RAD + convergence, atol=2e-3)


def test_inertial_readings_are_turned_to_forward_left_up(tmp_path):
    write_bin(tmp_path / "a.bin")
    recording, *_ = read_autopilot_log(tmp_path / "a.bin")
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
            recording, *_ = read_autopilot_log(tmp_path / name)
        except InputError:
            continue
        assert len(recording.gps.time_s) < N
    (tmp_path / name).write_bytes(bytes(range(256)) * 40)
    with pytest.raises(InputError):
        read_autopilot_log(tmp_path / name)
    gc.collect()


def test_errors_that_a_log_states_are_those_of_its_path(tmp_path):
    write_ulog(tmp_path / "a.ulg", vehicle=3)
    args = ["localize", str(tmp_path / "a.ulg"), "--antenna", "0.5", "-o", str(tmp_path / "out"), "-q"]
    assert CliRunner().invoke(app, args).exit_code == 0
    points = SurfacePoints.read(tmp_path / "out" / "landmarks.gpkg")
    np.testing.assert_allclose(np.sqrt(points.covariance[:, 0, 0]), 0.05, rtol=1e-6)
    np.testing.assert_allclose(points.sigma_z, 0.08, rtol=1e-6)
    np.testing.assert_allclose(points.xyz[:, 2], HEIGHT_M - 0.5, atol=1e-3)
    path = Trajectory.read(tmp_path / "out" / "trajectory.csv", points.crs)
    ends = path.error.rows(path.error.keyframe_at(path.time_s[[0, -1]]), np.tile(np.eye(6)[2], (2, 1)))
    covariance = path.error.covariance(ends)
    assert covariance[0, 1] > 0.8 * covariance[0, 0]


def test_the_receiver_with_most_fixes_is_used_and_the_others_are_named(tmp_path):
    write_ulog(tmp_path / "a.ulg", (2, 30))
    recording, notes, _ = read_autopilot_log(tmp_path / "a.ulg")
    assert len(recording.gps) == 30
    np.testing.assert_allclose(recording.gps.sigma_m, 1.05, rtol=1e-6)
    assert any("left out are 2 of vehicle_gps_position 0" in note for note in notes)


@pytest.mark.parametrize(
    ("vehicle", "landed", "word"),
    [
        (1, True, "multicopter"),
        (2, True, "fixed wings"),
        (0, False, "in the air"),
        (3, False, ""),
        (0, True, ""),
    ],
)
def test_places_in_the_air_are_no_ground(vehicle, landed, word, tmp_path):
    log, out = tmp_path / "a.ulg", tmp_path / "out"
    write_ulog(log, vehicle=vehicle, landed=landed)
    result = CliRunner().invoke(app, ["localize", str(log), "-o", str(out), "-q"])
    assert result.exit_code == 0, result.output
    assert word in result.output
    assert (out / "track.gpkg").exists()
    assert not (out / "landmarks.gpkg").exists()
    for command in ("localize", "reconstruct"):
        args = [command, str(log), "--antenna", "1", "-o", str(tmp_path / command), "-q"]
        made = CliRunner().invoke(app, args)
        assert word in made.output
        assert (made.exit_code == 3) == bool(word or command == "reconstruct"), (
            made.output
        )  # a line is no area


def test_the_program_of_an_ardupilot_log_says_what_it_drives(tmp_path):
    write_bin(tmp_path / "a.bin", "ArduCopter V4.5.7 (2a3dc4b7)")
    assert read_autopilot_log(tmp_path / "a.bin").flown == "ArduCopter V4.5.7"
    write_bin(tmp_path / "a.bin", "ArduRover V4.5.7")
    assert read_autopilot_log(tmp_path / "a.bin").flown == ""


def test_what_a_log_itself_lost_is_noted(tmp_path):
    log = tmp_path / "a.ulg"
    write_ulog(log, vehicle=3)
    content = log.read_bytes()
    log.write_bytes(content + struct.pack("<HBH", 2, ord("O"), 250))
    assert any("0.2 s in 1 gaps" in note for note in read_autopilot_log(log).notes)
    middle = content.rindex(struct.pack("<HB", 26, ord("D")))  # a heading
    log.write_bytes(content[:middle] + bytes(40) + content[middle:])
    assert any("damaged" in note for note in read_autopilot_log(log).notes)

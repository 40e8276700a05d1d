"""Bags of a drive: every message read by rosbags, and all records by our own reader."""

from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from survey.core.errors import InputError
from survey.data.camera import Camera
from survey.data.frames import Frames
from survey.data.recording import Recording
from survey.data.sensors.lidar import LidarReturns, LidarScans, Scanner
from survey.data.sensors.odometry import Odometry
from survey.data.sensors.records import Barometer, GpsFixes, Inertial, Wheels
from survey.data.trajectory import Trajectory
from survey.interchange.bags import bag_clouds
from survey.interchange.drive_bags import bag_notes, write_bag
from vision_slam.readers.bags import _chosen_topics, read_bag

TIMES = np.arange(0.0, 3.0, 0.25)
N = len(TIMES)
RNG = np.random.default_rng(1)
IMAGES = [RNG.integers(0, 255, (4, 6), dtype=np.uint8) for _ in TIMES]
START = np.array([526000.0, 6478000.0, 100.0])
EAST = np.column_stack([TIMES, 0.0 * TIMES, 0.0 * TIMES])
NAMES = ("drive.bag", "drive", "drive.mcap")
GAUGE_M = 0.5


def mounted() -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
    pose[:3, 3] = 0.2, 0.0, 0.7
    return pose


def recording() -> Recording:
    scanner = Scanner(elevation_deg=(-30.0,), n_columns=16, mount_m=(0.0, 0.0, 1.5))
    returns = LidarReturns.of([0, 0, 1], [0, 4, 3], [0, 0, 0], np.array([2.0, 3.0, 4.0]))
    return Recording(
        "EPSG:32608",
        START,
        gps=GpsFixes(TIMES, START + EAST, np.full(N, 2.0), np.full(N, 3.0)),
        camera=Camera("fisheye", 6, 4, [[4, 0, 3], [0, 4, 2], [0, 0, 1]], [0.1, 0, 0, 0], mounted()),
        frames=Frames(TIMES, IMAGES),
        inertial=Inertial(TIMES, RNG.normal(size=(N, 3)), np.tile([0.0, 0.0, 9.81], (N, 1))),
        wheels=Wheels(TIMES, TIMES, 1.2 * TIMES),
        lidar=LidarScans(scanner, [0.5, 1.0], [returns]),
        antenna_height_m=0.5,
        vertical_datum="ellipsoidal height",
    )


def truth() -> Trajectory:
    north = np.tile([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)], (N, 1))
    return Trajectory(TIMES, START + EAST[:, [1, 0, 2]], north, np.zeros((N, 3, 3)), "EPSG:32608")


def messages(path: Path) -> dict[str, list]:
    found: dict[str, list] = {}
    with AnyReader([path]) as reader:
        for connection, time_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append((time_ns, message))
    return found


@pytest.mark.parametrize("name", NAMES)
def test_rosbags_reads_every_message(tmp_path: Path, name: str) -> None:
    counts = write_bag(recording(), tmp_path / name, truth=truth(), track_gauge_m=GAUGE_M)
    found = messages(tmp_path / name)
    assert {topic: len(rows) for topic, rows in found.items()} == counts
    assert Counter(counts) == Counter(
        {
            **dict.fromkeys(("/camera/image_raw", "/camera/camera_info", "/imu/data", "/gps/fix"), N),
            **dict.fromkeys(("/wheel/odometry", "/ground_truth/odometry"), N),
            "/lidar/points": 2,
            "/tf_static": 1,
            "/clock": 56,
        }
    )
    stamped = [
        (time_ns, m.header.stamp) for rows in found.values() for time_ns, m in rows if hasattr(m, "header")
    ]
    assert all(time_ns == stamp.sec * 10**9 + stamp.nanosec for time_ns, stamp in stamped)
    assert min(time_ns for time_ns, _ in stamped) == 10**9
    _, fix = found["/gps/fix"][0]
    assert fix.position_covariance.reshape(3, 3).tolist() == np.diag([4.0, 4.0, 9.0]).tolist()
    _, real = found["/ground_truth/odometry"][4]
    assert (real.header.frame_id, real.child_frame_id) == ("map", "base_link")
    at, speed = real.pose.pose.position, real.twist.twist.linear
    np.testing.assert_allclose([at.x, at.y, at.z], [0.0, 1.0, 0.0], atol=1e-9)
    # The rover looks north and drives north: forward in its own frame.
    np.testing.assert_allclose([speed.x, speed.y, speed.z], [1.0, 0.0, 0.0], atol=1e-9)
    _, rolled = found["/wheel/odometry"][4]
    assert rolled.twist.twist.linear.x == pytest.approx(1.1, rel=2e-3)
    assert rolled.twist.twist.angular.z == pytest.approx(0.2 / GAUGE_M)


@pytest.mark.parametrize("name", NAMES)
def test_our_reader_gives_back_the_records_without_the_truth(tmp_path: Path, name: str) -> None:
    drive = recording()
    write_bag(drive, tmp_path / name, truth=truth(), track_gauge_m=GAUGE_M)
    found = read_bag(tmp_path / name)
    assert "not read: /clock" in found.notes[-1]
    assert "/ground_truth/odometry" in found.notes[-1]
    np.testing.assert_allclose(found.frames.time_s, TIMES + 1.0)
    assert all(np.array_equal(found.frames[k], IMAGES[k]) for k in range(N))
    np.testing.assert_allclose(found.camera.T_body_camera, mounted(), atol=1e-12)
    np.testing.assert_array_equal(found.camera.distortion, drive.camera.distortion)
    np.testing.assert_allclose(found.inertial.gyro_rad_s, drive.inertial.gyro_rad_s, atol=1e-12)
    np.testing.assert_allclose(np.diff(found.wheels.left_m), 0.275, rtol=2e-3)
    fixes, _ = found.gps.fixes("EPSG:32608")
    np.testing.assert_allclose(fixes.position, drive.gps.position, atol=1e-6)
    assert found.gps.sigma_m.tolist() == [2.0] * N


def test_clouds_are_in_the_frame_of_the_scanner(tmp_path: Path) -> None:
    write_bag(recording(), tmp_path / "drive")
    (time_s, first), _ = bag_clouds(tmp_path / "drive")
    assert time_s == 1.5
    down, flat = 2.0 * np.sin(np.radians(30.0)), 2.0 * np.cos(np.radians(30.0))
    np.testing.assert_allclose(first[0], [flat, 0.0, -down], atol=1e-6)
    (_, cloud), _ = messages(tmp_path / "drive")["/lidar/points"]
    delay_s = np.frombuffer(cloud.data.tobytes(), "<f4").reshape(-1, 4)[:, 3]
    np.testing.assert_allclose(delay_s, [0.0, 0.025], atol=1e-7)


def test_a_bag_has_the_same_bytes_each_time_and_replaces_an_old_one(tmp_path: Path) -> None:
    drive = recording()
    for name, inner in zip(NAMES, ("", "drive.db3", ""), strict=True):
        contents = []
        for _ in range(2):
            write_bag(drive, tmp_path / name, truth=truth(), track_gauge_m=GAUGE_M)
            contents.append(
                (tmp_path / name / inner).read_bytes() if inner else (tmp_path / name).read_bytes()
            )
        assert contents[0] == contents[1]
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(NAMES)


def test_a_drive_without_images_is_read_back_too(tmp_path: Path) -> None:
    turning = np.column_stack([np.zeros(N), np.zeros(N), 0.1 * TIMES])
    drive = Recording(
        "EPSG:32608",
        START,
        gps=GpsFixes(TIMES + 100.0, START + EAST),
        odometry=Odometry(TIMES + 100.0, np.tile([0.25, 0.0, 0.0], (N - 1, 1)), turning),
    )
    counts = write_bag(drive, tmp_path / "drive")
    assert set(counts) == {"/clock", "/tf_static", "/gps/fix", "/visual/odometry"}
    found = read_bag(tmp_path / "drive")
    np.testing.assert_allclose(found.wheels.time_s, TIMES + 100.0)
    np.testing.assert_allclose(np.diff(found.wheels.left_m), 0.25)
    assert found.gps.sigma_m is None


def test_what_a_bag_does_not_hold_is_said(tmp_path: Path) -> None:
    drive = replace(recording(), barometer=Barometer(TIMES, TIMES), vertical_datum="")
    lost, shifted, datum = bag_notes(drive, truth(), None)
    assert lost.endswith(": barometer, wheels (no track gauge)")
    assert shifted.startswith("time stamps are 1 s later")
    assert "/gps/fix count from a datum that the recording does not state" in datum
    with pytest.raises(InputError, match="distance above 0"):
        write_bag(drive, tmp_path / "drive", track_gauge_m=0.0)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("topic", ["/ground_truth/odom", "/Ground_Truth/odom", "/robot/GroundTruth"])
def test_topics_of_real_poses_are_not_wheels_however_they_are_written(topic: str, tmp_path: Path) -> None:
    both = [SimpleNamespace(topic=name, msgtype="nav_msgs/msg/Odometry") for name in (topic, "/wheels")]
    assert _chosen_topics(both, (), tmp_path) == {"odometry": "/wheels"}
    assert _chosen_topics(both[:1], (), tmp_path) == {}
    assert _chosen_topics(both, (topic,), tmp_path) == {"odometry": topic}

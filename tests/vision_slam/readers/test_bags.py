"""Bags as rosbags writes them, read back."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rosbags.rosbag1 import Writer as FirstWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as SecondWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from survey.core.errors import InputError
from survey.data.camera import Camera
from vision_slam.readers.bags import is_bag, read_bag
from vision_slam.readers.sequence import georeference
from vision_slam.recordings import open_recording, read_sequence

NOISE = np.random.default_rng(3).integers(0, 255, (4, 12, 16), dtype=np.uint8)


class Bag:
    """Writes messages of one typestore to topics, whichever the format is."""

    def __init__(self, writer: Any, store: Any, *, is_first: bool) -> None:
        self.writer, self.store, self.is_first = writer, store, is_first
        self.topics: dict[str, Any] = {}
        self.caller = "first"
        links = "tf2_msgs/msg/TFMessage"
        if links not in store.types:
            store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", links))

    def make(self, kind: str, **fields: Any) -> Any:
        return self.store.types[kind](**fields)

    def header(self, second: float, frame: str = "") -> Any:
        whole = int(second)
        stamp = self.make("builtin_interfaces/msg/Time", sec=whole, nanosec=round(1e9 * (second - whole)))
        counted = {"seq": 0} if self.is_first else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **counted)

    def add(self, topic: str, second: float, message: Any) -> None:
        kind = message.__msgtype__
        if topic not in self.topics:
            named = {"callerid": self.caller} if self.is_first else {}
            self.topics[topic] = self.writer.add_connection(topic, kind, typestore=self.store, **named)
        to_bytes = self.store.serialize_ros1 if self.is_first else self.store.serialize_cdr
        self.writer.write(self.topics[topic], int(second * 1e9), bytes(to_bytes(message, kind)))

    def image(self, topic: str, second: float, pixels: np.ndarray, encoding: str, padding: int = 0) -> None:
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
        rows = np.pad(rows, ((0, 0), (0, padding)))
        message = self.make(
            "sensor_msgs/msg/Image",
            header=self.header(second, "eye"),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=rows.shape[1],
            data=rows.ravel(),
        )
        self.add(topic, second, message)

    def calibration(self, topic: str, width: int = 16, model: str = "plumb_bob", n: int = 5) -> None:
        window = self.make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        numbers = {
            "d": 0.01 * np.arange(1.0, n + 1.0),
            "k": np.array([20.0, 0, 8, 0, 21.0, 6, 0, 0, 1]),
            "r": np.eye(3).ravel(),
            "p": np.zeros(12),
        }
        named = {(key.upper() if self.is_first else key): value for key, value in numbers.items()}
        message = self.make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(0.0),
            height=12,
            width=width,
            distortion_model=model,
            binning_x=0,
            binning_y=0,
            roi=window,
            **named,
        )
        self.add(topic, 0.0, message)

    def vector(self, x: float, y: float, z: float) -> Any:
        return self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def turn(self, x: float, y: float, z: float, w: float) -> Any:
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def fix(
        self, second: float, latitude: float, status: int, sigma_m: float = 0.0, altitude: float = 7.0
    ) -> None:
        fix_status = self.make("sensor_msgs/msg/NavSatStatus", status=status, service=1)
        message = self.make(
            "sensor_msgs/msg/NavSatFix",
            header=self.header(second),
            status=fix_status,
            latitude=latitude,
            longitude=0.0 if latitude == 0.0 else -135.0,
            altitude=altitude,
            position_covariance=np.diag([sigma_m**2, sigma_m**2, 4.0 * sigma_m**2]).ravel(),
            position_covariance_type=2 if sigma_m > 0.0 else 0,
        )
        self.add("/gps/fix", second, message)

    def inertial(self, second: float, frame: str, turn: float = 1.0, up: float = -9.81) -> None:
        message = self.make(
            "sensor_msgs/msg/Imu",
            header=self.header(second, frame),
            orientation=self.turn(0.0, 0.0, 0.0, 1.0),
            orientation_covariance=np.zeros(9),
            angular_velocity=self.vector(0.1 * turn, 0.2 * turn, 0.3 * turn),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=self.vector(0.0, 0.0, up),
            linear_acceleration_covariance=np.zeros(9),
        )
        self.add("/imu", second, message)

    def odometry(self, second: float, x: float) -> None:
        place = self.make("geometry_msgs/msg/Point", x=x, y=0.0, z=0.0)
        pose = self.make("geometry_msgs/msg/Pose", position=place, orientation=self.turn(0.0, 0.0, 0.0, 1.0))
        still = self.make(
            "geometry_msgs/msg/Twist", linear=self.vector(0.0, 0.0, 0.0), angular=self.vector(0.0, 0.0, 0.0)
        )
        message = self.make(
            "nav_msgs/msg/Odometry",
            header=self.header(second),
            child_frame_id="base_link",
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=still, covariance=np.zeros(36)),
        )
        self.add("/odom", second, message)

    def mounting(self, child: str, shift: tuple[float, float, float], turn: tuple[float, ...]) -> None:
        transform = self.make(
            "geometry_msgs/msg/Transform", translation=self.vector(*shift), rotation=self.turn(*turn)
        )
        link = self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(0.0, "base_link"),
            child_frame_id=child,
            transform=transform,
        )
        self.add("/tf_static", 0.0, self.make("tf2_msgs/msg/TFMessage", transforms=[link]))


@contextmanager
def second_bag(path: Path, plugin: StoragePlugin = StoragePlugin.SQLITE3) -> Iterator[Bag]:
    with SecondWriter(path, version=9, storage_plugin=plugin) as writer:
        yield Bag(writer, get_typestore(Stores.LATEST), is_first=False)


@contextmanager
def first_bag(path: Path) -> Iterator[Bag]:
    with FirstWriter(path) as writer:
        yield Bag(writer, get_typestore(Stores.ROS1_NOETIC), is_first=True)


@pytest.mark.parametrize("kind", ["ros1", "ros2", "mcap"])
def test_a_bag_gives_back_what_was_written(tmp_path: Path, kind: str) -> None:
    path = tmp_path / ("drive.bag" if kind == "ros1" else "drive")
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with first_bag(path) if kind == "ros1" else second_bag(path, plugin) as bag:
        bag.calibration("/cam/camera_info")
        # 180° about x: the inertial unit hangs upside down.
        bag.mounting("unit", (0.0, 0.0, 0.5), (1.0, 0.0, 0.0, 0.0))
        bag.mounting("eye", (0.2, 0.0, 0.7), (-0.5, 0.5, -0.5, 0.5))
        for k in range(4):
            second = 1000.0 + 0.25 * k
            bag.image("/cam/image_raw", second, NOISE[k], "mono8", padding=3)
            bag.inertial(second, "unit")
            bag.odometry(second, 0.1 * k)
            bag.fix(second, 58.4 + 1e-5 * k, -1 if k == 1 else 0)
    assert is_bag(path)
    sequence = read_bag(path)
    assert sequence.frames.time_s.tolist() == [1000.0, 1000.25, 1000.5, 1000.75]
    for k in (0, 1, 2, 3, 3, 1):
        assert np.array_equal(sequence.frames[k], NOISE[k])
    assert sequence.camera.matrix[1].tolist() == [0.0, 21.0, 6.0]
    assert sequence.camera.distortion.tolist() == pytest.approx([0.01, 0.02, 0.03, 0.04, 0.05])
    # The optical frame looks along z, which the rover calls x.
    assert sequence.camera.T_body_camera[:3, 2].tolist() == pytest.approx([1.0, 0.0, 0.0])
    assert sequence.camera.T_body_camera[:3, 3].tolist() == pytest.approx([0.2, 0.0, 0.7])
    assert sequence.inertial is not None
    assert sequence.inertial.specific_force_m_s2[0].tolist() == pytest.approx([0.0, 0.0, 9.81])
    assert sequence.inertial.gyro_rad_s[0].tolist() == pytest.approx([0.1, -0.2, -0.3])
    assert sequence.wheels is not None
    assert sequence.wheels.left_m.tolist() == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert sequence.gps is not None
    assert sequence.gps.n_without_fix == 1
    recording = georeference(sequence, sequence.gps)
    assert recording.crs.to_epsg() == 32608
    assert recording.vertical_datum == "ellipsoidal height"
    assert len(recording.gps) == 3


def test_fixes_that_state_a_covariance_keep_it(tmp_path: Path) -> None:
    named = {"stated": (0.02, 0.3), "partly": (0.02, 0.3, 0.0), "seldom": (0.02, 0.0, 0.0)}
    for name, sigmas_m in named.items():
        with second_bag(tmp_path / name) as bag:
            bag.calibration("/camera_info")
            bag.image("/image", 1.0, NOISE[0], "mono8")
            for k, sigma_m in enumerate(sigmas_m):
                bag.fix(1.0 + k, 58.4, 0, sigma_m)
    stated, partly, seldom = (read_bag(tmp_path / name).gps for name in named)
    assert stated is not None
    assert stated.sigma_m is not None
    assert stated.sigma_m.tolist() == pytest.approx([0.02, 0.3])
    assert stated.notes == ()
    assert partly is not None
    assert partly.sigma_m is not None
    assert partly.sigma_m.tolist() == pytest.approx([0.02, 0.3, 0.3])
    assert partly.notes == (
        "1 of 3 fixes state no covariance and take the largest standard deviation of the others, 0.3 m",
    )
    assert seldom is not None
    assert seldom.sigma_m is None
    assert seldom.notes == ("1 of 3 fixes state a covariance, which is not used",)


def test_a_fix_without_an_altitude_is_left_out_and_counted(tmp_path: Path) -> None:
    with second_bag(tmp_path / "drive") as bag:
        bag.calibration("/camera_info")
        bag.image("/image", 1.0, NOISE[0], "mono8")
        for k, altitude in enumerate((7.0, np.nan, 8.0)):
            bag.fix(1.0 + k, 58.4, 0, altitude=altitude)
    gps = read_bag(tmp_path / "drive").gps
    assert gps is not None
    assert gps.place[:, 2].tolist() == [7.0, 8.0]
    assert gps.n_without_fix == 1


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_file_of_a_bag_without_its_folder_is_read(tmp_path: Path, plugin: StoragePlugin) -> None:
    with second_bag(tmp_path / "drive", plugin) as bag:
        bag.calibration("/camera_info")
        bag.image("/image", 1.0, NOISE[0], "mono8")
    file = next(file for file in (tmp_path / "drive").iterdir() if file.name != "metadata.yaml")
    (tmp_path / "drive" / "metadata.yaml").unlink()
    sequence = read_bag(file)
    assert np.array_equal(sequence.frames[0], NOISE[0])
    with pytest.raises(InputError, match=rf"{file.name} is a bag .* name the bag instead of its folder"):
        read_sequence(tmp_path / "drive")


def test_a_calibration_that_is_not_beside_the_images_is_noted(tmp_path: Path) -> None:
    with second_bag(tmp_path / "drive") as bag:
        bag.calibration("/left/camera_info")
        bag.image("/left/image_raw", 1.0, NOISE[0], "mono8")
        bag.image("/right/image_raw", 1.0, NOISE[0], "mono8")
    words = "no camera_info is beside /right/image_raw: that of /left/camera_info is taken"
    assert any(note.startswith(words) for note in read_bag(tmp_path / "drive", ["/right/image_raw"]).notes)
    assert not any("beside" in note for note in read_bag(tmp_path / "drive", ["/left/image_raw"]).notes)


def test_fixes_of_a_bag_at_longitude_and_latitude_zero_are_left_out(tmp_path: Path) -> None:
    with second_bag(tmp_path / "bag") as bag:
        bag.calibration("/camera_info")
        bag.image("/image", 1.0, NOISE[0], "mono8")
        for k, latitude in enumerate((0.0, 58.4, 58.5)):
            bag.fix(1.0 + k, latitude, 0, 0.02)
    log = read_bag(tmp_path / "bag").gps
    assert log is not None
    assert log.place[:, 1].tolist() == [58.4, 58.5]
    assert log.notes == ("1 fixes at longitude and latitude 0 are left out",)


@pytest.mark.parametrize("is_split", [False, True])
def test_publishers_that_were_restarted_and_split_bags_lose_no_message(
    tmp_path: Path, is_split: bool
) -> None:
    parts = ["drive_2024-06-12_0.bag", "drive_2024-06-12_1.bag"] if is_split else ["drive_3.bag"]
    for number, part in enumerate(parts):
        with first_bag(tmp_path / part) as bag:
            bag.calibration("/camera_info")
            for k in range(2 * number, 4 if not is_split else 2 * number + 2):
                if k == 2:
                    bag.topics, bag.caller = {}, "restarted"
                bag.image("/image", 1.0 + k, NOISE[k], "mono8")
                bag.fix(1.0 + k, 58.4, 0)
    path = tmp_path if is_split else tmp_path / "drive_3.bag"
    assert is_bag(path)
    sequence = read_bag(path)
    assert sequence.frames.time_s.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert all(np.array_equal(sequence.frames[k], NOISE[k]) for k in range(4))
    assert sequence.gps is not None
    assert len(sequence.gps.time_s) == 4


def test_messages_that_are_repeated_or_late_are_left_out_and_said(tmp_path: Path) -> None:
    with first_bag(tmp_path / "drive.bag") as bag:
        bag.calibration("/camera_info")
        for k in range(4):
            bag.image("/image", 1.0 + k, NOISE[k], "mono8")
            if k == 1:
                bag.image("/image", 2.0, NOISE[0], "mono8")
            bag.fix(1.0 + k, 58.4, 0)
            bag.fix(1.0 + k, 58.4, 0)
    sequence = read_bag(tmp_path / "drive.bag")
    assert sequence.frames.time_s.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert all(np.array_equal(sequence.frames[k], NOISE[k]) for k in (0, 1, 2, 3, 1))
    assert sequence.gps is not None
    assert sequence.gps.time_s.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert "4 messages of /gps/fix repeat a time or come late, and are left out" in sequence.notes
    assert "1 messages of /image repeat a time or come late, and are left out" in sequence.notes


def test_a_folder_of_other_bags_is_no_split_bag(tmp_path: Path) -> None:
    (tmp_path / "morning.bag").touch()
    (tmp_path / "evening.bag").touch()
    assert not is_bag(tmp_path)


@pytest.mark.parametrize("encoding", ["yuv422", "yuv422_yuy2"])
def test_images_of_usb_cameras_become_blue_green_red(tmp_path: Path, encoding: str) -> None:
    is_first = encoding == "yuv422"
    pixels = np.full((12, 16, 2), 128, np.uint8)
    pixels[..., 1 if is_first else 0] = 81
    pixels[:, 1::2, 0 if is_first else 1] = 240
    pixels[:, 0::2, 0 if is_first else 1] = 90
    with second_bag(tmp_path / "drive") as bag:
        bag.calibration("/camera_info")
        bag.image("/image", 1.0, pixels, encoding)
    red = read_bag(tmp_path / "drive").frames[0]
    assert red.shape == (12, 16, 3)
    assert np.abs(red[0, 0].astype(int) - [0, 0, 255]).max() <= 3


@pytest.mark.parametrize("encoding", ["bgr8", "rgb8", "bgra8", "mono16", "png"])
def test_images_of_every_kind_become_8_bits(tmp_path: Path, encoding: str) -> None:
    pixels = np.zeros((12, 16, 4 if encoding == "bgra8" else 3), np.uint8)
    pixels[..., 0] = 200
    with second_bag(tmp_path / "drive") as bag:
        bag.calibration("/cam/camera_info", model="equidistant", n=4)
        if encoding == "png":
            whole = cv2.imencode(".png", pixels)[1].ravel()
            header = bag.header(1.0)
            message = bag.make("sensor_msgs/msg/CompressedImage", header=header, format="png", data=whole)
            bag.add("/cam/image_raw/compressed", 1.0, message)
        elif encoding == "mono16":
            bag.image("/cam/image_raw", 1.0, np.full((12, 16), 0x0ABC, np.uint16), encoding)
        else:
            bag.image("/cam/image_raw", 1.0, pixels, encoding)
    sequence = read_bag(tmp_path / "drive")
    assert sequence.camera.model == "fisheye"
    image = sequence.frames[0]
    if encoding == "mono16":
        assert image.max() == 0x0ABC >> 4  # 12 bits are in use
        assert any("12 bits were divided by 16" in note for note in sequence.notes)
    else:
        assert image[0, 0].tolist() == ([0, 0, 200] if encoding == "rgb8" else [200, 0, 0])


def test_ambiguous_topics_and_wrong_sizes_in_a_bag_are_refused(tmp_path: Path, camera: Camera) -> None:
    with second_bag(tmp_path / "two") as bag:
        bag.calibration("/left/camera_info")
        bag.calibration("/right/camera_info", width=18)
        for side in ("left", "right"):
            bag.image(f"/{side}/image_raw", 1.0, NOISE[0], "mono8")
    with pytest.raises(InputError, match=r"2 topics of images .*choose one with --topic"):
        read_bag(tmp_path / "two")
    with pytest.raises(InputError, match="no topic /middle"):
        read_bag(tmp_path / "two", ["/middle"])
    assert len(read_bag(tmp_path / "two", ["/left/image_raw"]).frames) == 1
    with pytest.raises(InputError, match="16 × 12 pixels, their calibration 18 × 12"):
        read_bag(tmp_path / "two", ["/right/image_raw"])
    with second_bag(tmp_path / "blind") as bag:
        bag.calibration("/camera_info")
    with pytest.raises(InputError, match=r"neither images .* nor wheels .* nor fixes .*name another bag"):
        read_bag(tmp_path / "blind")
    with second_bag(tmp_path / "bare") as bag:
        bag.image("/image", 1.0, NOISE[0], "mono8")
        bag.fix(1.0, 58.4, -1)
    with pytest.raises(InputError, match="no camera_info"):
        read_bag(tmp_path / "bare")
    with pytest.raises(InputError, match="1 NavSatFix messages and no fix"):
        read_bag(tmp_path / "bare", camera=camera.scaled(0.05))


@pytest.mark.parametrize(
    "kinds", [("odometry", "inertial", "fix"), ("odometry", "fix"), ("odometry", "inertial"), ("fix",)]
)
def test_a_bag_without_images_is_localized_by_what_it_has(tmp_path: Path, kinds: tuple[str, ...]) -> None:
    with second_bag(tmp_path / "rover") as bag:
        for k in range(400):
            if "odometry" in kinds:
                bag.odometry(1.0 + 0.1 * k, 0.1 * k)
            if "inertial" in kinds:
                bag.inertial(1.0 + 0.1 * k, "base_link", turn=0.0, up=9.81)
            if "fix" in kinds and k % 10 == 0:
                bag.fix(1.0 + 0.1 * k, 58.4 + 0.1 * k / 111_400.0, 0)
    estimate = open_recording(tmp_path / "rover").localize()
    travel_m = float(np.linalg.norm(estimate.position[-1] - estimate.position[0]))
    assert travel_m == pytest.approx(39.9, abs=1.0)
    assert (estimate.trajectory is not None) == ("fix" in kinds)
    assert estimate.covariance is not None
    assert np.linalg.eigvalsh(estimate.covariance[-1])[-1] > 0.0


@pytest.mark.parametrize("kind", ["ros1", "ros2", "mcap"])
def test_a_bag_that_is_cut_off_is_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / ("drive.bag" if kind == "ros1" else "drive")
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with first_bag(path) if kind == "ros1" else second_bag(path, plugin) as bag:
        bag.calibration("/camera_info")
        for k in range(20):
            bag.image("/image", 1.0 + k, NOISE[0], "mono8")
    file = path if kind == "ros1" else next(path.glob("drive.*"))
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="damaged or no bag"):
        read_bag(path)


def test_without_rosbags_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with second_bag(tmp_path / "drive") as bag:
        bag.image("/image", 1.0, NOISE[0], "mono8")
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(InputError, match=r"install firnline\[bags\]"):
        read_bag(tmp_path / "drive")

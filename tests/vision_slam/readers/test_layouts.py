"""One drive in every layout: each is read by the same command and gives the same path."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rosbags.rosbag1 import Writer as FirstWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as SecondWriter
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from firnline.cli.main import app
from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.camera import Camera
from survey.data.frames import Image
from survey.io.trajectory_files import read_tum, write_kitti, write_tum
from vision_slam.readers.datasets import read_poses
from vision_slam.recordings import read_sequence

N, STEP_M, PERIOD_S = 10, 0.05, 0.1
TIMES = PERIOD_S * np.arange(N)


@pytest.fixture(scope="module")
def poses() -> FloatArray:
    """Poses of the body (N, 4, 4): forward, with a turn of 1° a step."""
    found = np.tile(np.eye(4), (N, 1, 1))
    for k in range(1, N):
        step = np.eye(4)
        step[:3, :3] = Rotation.from_euler("z", 1.0, degrees=True).as_matrix()
        step[0, 3] = STEP_M
        found[k] = found[k - 1] @ step
    return found


@pytest.fixture(scope="module")
def images(plane_world: Any, poses: FloatArray) -> list[Image]:
    return [plane_world.image(pose) for pose in poses]


def _written(folder: Path, images: list[Image], name: str = "{:06d}") -> list[str]:
    folder.mkdir(parents=True)
    names = [f"{name.format(k)}.png" for k in range(N)]
    for file, image in zip(names, images, strict=True):
        assert cv2.imwrite(str(folder / file), image)
    return names


def _kitti(place: Path, images: list[Image]) -> Path:
    _written(place / "image_0", images)
    (place / "times.txt").write_text("".join(f"{time_s:.6e}\n" for time_s in TIMES))
    (place / "calib.txt").write_text("P0: 240 0 159.5 0 0 240 119.5 0 0 0 1 0\n")
    return place


def _kitti_raw(place: Path, images: list[Image]) -> Path:
    drive = place / "2011_09_26_drive_0001_sync"
    _written(drive / "image_00" / "data", images, "{:010d}")
    stamps = "".join(f"2011-09-26 13:02:{25.0 + time_s:012.9f}\n" for time_s in TIMES)
    (drive / "image_00" / "timestamps.txt").write_text(stamps)
    (place / "calib_cam_to_cam.txt").write_text(
        "calib_time: 09-Jan-2012 13:57:47\nS_00: 400 300\nK_00: 250 0 200 0 250 150 0 0 1\nD_00: -0.3 0.1 0 0 0\n"
        "S_rect_00: 320 240\nP_rect_00: 240 0 159.5 0 0 240 119.5 0 0 0 1 0\n"
    )
    (drive / "oxts" / "data").mkdir(parents=True)
    (drive / "oxts" / "timestamps.txt").write_text(stamps)
    for k in range(N):
        (drive / "oxts" / "data" / f"{k:010d}.txt").write_text(
            f"49.0 {8.0 + 1e-6 * k} 115.0 0.0 0.0 0.1 5 6 7\n"
        )
    return drive


def _tum(place: Path, images: list[Image]) -> Path:
    names = _written(place / "rgb", images)
    rows = (f"{time_s:.6f} rgb/{name}\n" for time_s, name in zip(1e9 + TIMES, names, strict=True))
    (place / "rgb.txt").write_text("# timestamp filename\n" + "".join(rows))
    return place


def _euroc(place: Path, images: list[Image]) -> Path:
    cam0 = place / "mav0" / "cam0"
    names = _written(cam0 / "data", images)
    rows = (f"{round(1e9 * time_s)},{name}\n" for time_s, name in zip(100.0 + TIMES, names, strict=True))
    (cam0 / "data.csv").write_text("#timestamp [ns],filename\n" + "".join(rows))
    return place


def _folder(place: Path, images: list[Image]) -> Path:
    _written(place, images)
    (place / "times.txt").write_text("".join(f"{time_s:.3f}\n" for time_s in TIMES))
    return place


def _first_bag(place: Path, images: list[Image]) -> Path:
    with FirstWriter(place.with_suffix(".bag")) as writer:
        _fill(writer, get_typestore(Stores.ROS1_NOETIC), images, {"seq": 0})
    return place.with_suffix(".bag")


def _second_bag(place: Path, images: list[Image]) -> Path:
    with SecondWriter(place, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        _fill(writer, get_typestore(Stores.LATEST), images, {})
    return place


def _fill(writer: Any, store: Any, images: list[Image], counted: dict[str, int]) -> None:
    kind = "sensor_msgs/msg/Image"
    topic = writer.add_connection("/camera/image_raw", kind, typestore=store)
    to_bytes = store.serialize_ros1 if counted else store.serialize_cdr
    for k, image in enumerate(images):
        stamp = store.types["builtin_interfaces/msg/Time"](sec=1000 + k // 10, nanosec=10**8 * (k % 10))
        header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="eye", **counted)
        message = store.types[kind](
            header=header, height=240, width=320, encoding="mono8", is_bigendian=0, step=320, data=image.ravel()
        )  # fmt: skip
        writer.write(topic, (1000 * 10 + k) * 10**8, bytes(to_bytes(message, kind)))


def _localized(source: Path, calibration: Path, out: Path, *more: str) -> tuple[FloatArray, dict[str, Any]]:
    """Run the command; return the poses it wrote and the figures it printed."""
    words = [
        "localize",
        str(source),
        "--camera",
        str(calibration),
        "--out",
        str(out),
        "--json",
        "--quiet",
        *more,
    ]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    return read_tum(out / "trajectory.tum"), json.loads(result.stdout)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory, images: list[Image], camera: Camera) -> FloatArray:
    """Poses of the images as a plain folder (N, 8)."""
    place = tmp_path_factory.mktemp("plain")
    camera.write(place / "camera.toml")
    return _localized(_folder(place / "drive", images), place / "camera.toml", place / "out")[0]


@pytest.mark.parametrize("write", [_kitti, _kitti_raw, _tum, _euroc, _first_bag, _second_bag])
def test_every_layout_gives_the_same_path(
    tmp_path: Path,
    images: list[Image],
    camera: Camera,
    plain: FloatArray,
    write: Callable[[Path, list[Image]], Path],
) -> None:
    camera.write(tmp_path / "camera.toml")
    found, _ = _localized(write(tmp_path / "drive", images), tmp_path / "camera.toml", tmp_path / "out")
    assert found.shape == (N, 8)
    np.testing.assert_allclose(found[:, 1:], plain[:, 1:], atol=1e-6)
    turned = Rotation.from_quat(found[-1, 4:]).as_euler("zyx", degrees=True)[0]
    assert turned == pytest.approx(N - 1.0, abs=0.5)


def test_a_raw_recording_has_the_calibration_of_its_size_and_the_poses_of_its_inertial_unit(
    tmp_path: Path, images: list[Image]
) -> None:
    place = _kitti_raw(tmp_path, images)
    sequence = read_sequence(place)
    assert sequence.camera.matrix[0].tolist() == [240.0, 0.0, 159.5]
    assert sequence.camera.distortion_is_assumed
    assert sequence.reference is not None
    # A millionth of a degree of longitude at 49° north is 73 mm.
    assert sequence.reference[1, 0, 3] == pytest.approx(0.0731, abs=1e-3)
    calibration = tmp_path / "calib_cam_to_cam.txt"
    calibration.write_text(calibration.read_text().replace("S_rect_00: 320 240", "S_rect_00: 300 200").replace("S_00: 400 300", "S_00: 320 240"))  # fmt: skip
    assert read_sequence(place).camera.distortion[0] == -0.3
    calibration.unlink()
    with pytest.raises(InputError, match=r"without calib_cam_to_cam\.txt"):
        read_sequence(place)


@pytest.mark.long
def test_a_reference_is_read_as_kitti_or_tum_text_of_body_or_camera(
    tmp_path: Path, images: list[Image], camera: Camera, poses: FloatArray
) -> None:
    camera.write(tmp_path / "camera.toml")
    of_camera = np.linalg.inv(camera.T_body_camera) @ poses @ camera.T_body_camera
    write_kitti(tmp_path / "poses.txt", of_camera[:, :3])
    for name, given in (("body.tum", poses), ("camera.tum", of_camera)):
        turns = Rotation.from_matrix(given[:, :3, :3]).as_quat()
        write_tum(tmp_path / name, np.column_stack([TIMES, given[:, :3, 3], turns]))
    place, figures = _folder(tmp_path / "drive", images), []
    for name in ("poses.txt", "body.tum", "camera.tum"):
        out = tmp_path / f"out-{name}"
        figures.append(
            _localized(place, tmp_path / "camera.toml", out, "--reference", str(tmp_path / name))[1]
        )
    assert figures[0]["yaw_rms_deg"] < 0.5
    for other in figures[1:]:
        assert other["end_error_m"] == pytest.approx(figures[0]["end_error_m"], rel=1e-6)


def test_kitti_poses_of_another_number_than_the_images_are_refused(
    tmp_path: Path, camera: Camera, poses: FloatArray
) -> None:
    write_kitti(tmp_path / "poses.txt", poses[:4, :3])
    with pytest.raises(InputError, match=r"has 4 poses without times and the drive 10 images"):
        read_poses(tmp_path / "poses.txt", TIMES, camera)

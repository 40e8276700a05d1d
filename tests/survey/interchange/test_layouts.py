"""Recordings in the layouts of EuRoC and KITTI, read by the field's own rules and by our readers."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from survey.core.errors import InputError
from survey.data.camera import Camera
from survey.data.frames import Frames
from survey.data.recording import Recording
from survey.data.sensors.lidar import LidarReturns, LidarScans, Scanner
from survey.data.sensors.records import GpsFixes, Inertial
from survey.data.trajectory import Trajectory
from survey.interchange.layouts import rectified_camera, write_euroc, write_kitti_sequence, write_tum_list
from survey.interchange.scans import read_sensor_scans
from vision_slam.recordings import read_sequence

TIMES = [10.0, 10.25, 10.5]
IMAGES = tuple(np.random.default_rng(1).integers(0, 255, (4, 6), dtype=np.uint8) for _ in TIMES)


def recording(**parts) -> Recording:
    gps = GpsFixes(TIMES, np.zeros((3, 3)))
    return Recording("EPSG:32608", np.zeros(3), gps=gps, **parts)


@pytest.fixture
def written(tmp_path: Path) -> Path:
    camera = Camera("pinhole", 6, 4, [[4, 0, 3], [0, 4.5, 2], [0, 0, 1]], [0.1, 0, 0, 0, 0], np.eye(4))
    inertial = Inertial(TIMES, np.full((3, 3), 0.25), np.full((3, 3), -9.5))
    write_euroc(recording(camera=camera, frames=Frames(TIMES, IMAGES), inertial=inertial), tmp_path / "drive")
    return tmp_path / "drive" / "mav0"


def test_images_are_named_by_their_time_in_nanoseconds(written: Path) -> None:
    lines = (written / "cam0" / "data.csv").read_text().splitlines()
    assert lines[1:] == [f"{ns},{ns}.png" for ns in (10_000_000_000, 10_250_000_000, 10_500_000_000)]
    image = cv2.imread(str(written / "cam0" / "data" / "10250000000.png"), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(image, IMAGES[1])


def test_the_camera_has_four_intrinsics_and_its_rate(written: Path) -> None:
    text = (written / "cam0" / "sensor.yaml").read_text()
    assert "intrinsics: [4.0, 4.5, 3.0, 2.0]" in text
    assert "rate_hz: 4\n" in text
    assert "resolution: [6, 4]" in text
    assert "distortion_model: radial-tangential" in text


def test_inertial_readings_have_gyro_before_accelerometer(written: Path) -> None:
    header, first, *_ = (written / "imu0" / "data.csv").read_text().splitlines()
    assert header.startswith("#timestamp [ns],w_RS_S_x [rad s^-1]")
    assert first == "10000000000,0.25,0.25,0.25,-9.5,-9.5,-9.5"


def test_a_folder_that_is_not_empty_and_a_drive_without_images_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no images"):
        write_euroc(recording(), tmp_path / "a")
    (tmp_path / "file").write_text("mine")
    camera = Camera("pinhole", 6, 4, [[4, 0, 3], [0, 4, 2], [0, 0, 1]], np.zeros(5), np.eye(4))
    with pytest.raises(InputError, match="not empty; choose another folder"):
        write_euroc(recording(camera=camera, frames=Frames(TIMES, IMAGES)), tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


def test_the_list_of_tum_names_a_file_for_each_time(tmp_path: Path) -> None:
    write_tum_list(Frames(TIMES, IMAGES), tmp_path)
    assert (tmp_path / "rgb.txt").read_text().splitlines()[1:] == [
        "10.000000 frames/000000.png",
        "10.250000 frames/000001.png",
        "10.500000 frames/000002.png",
    ]


FORWARD = np.array([[0.0, 0, 1, 0.2], [-1, 0, 0, 0], [0, -1, 0, 0.7], [0, 0, 0, 1]])


def fisheye() -> Camera:
    matrix = [[48.0, 0, 31], [0, 48, 24], [0, 0, 1]]
    return Camera("fisheye", 64, 48, matrix, [-0.02, 0.004, 0, 0], FORWARD)


def ray_images(camera: Camera) -> tuple[np.ndarray, ...]:
    """Return images whose grey values are linear in the direction of a ray: 128 + 60 x / z."""
    v, u = np.mgrid[: camera.height, : camera.width].astype(float)
    rays = camera.rays(np.column_stack([u.ravel(), v.ravel()]))
    grey = 128.0 + 60.0 * rays[:, 0] / rays[:, 2]
    return tuple(np.rint(grey).clip(0, 255).astype(np.uint8).reshape(v.shape) for _ in TIMES)


def test_a_sequence_of_kitti_is_rectified_and_read_back(tmp_path: Path) -> None:
    lens = fisheye()
    scanner = Scanner(elevation_deg=(-30.0,), n_columns=4, mount_m=(0.0, 0.0, 1.5))
    scans = LidarScans(scanner, [10.1], [LidarReturns.of([0], [0], [0], np.array([2.0]))])
    drive = recording(camera=lens, frames=Frames(TIMES, ray_images(lens)), lidar=scans)
    north = np.tile([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)], (3, 1))
    position = 1e5 + np.column_stack([np.zeros(3), np.array(TIMES), np.zeros(3)])
    real = Trajectory(TIMES, position, north, np.zeros((3, 3, 3)), "EPSG:32608")
    write_kitti_sequence(drive, tmp_path / "drive", real)
    found = read_sequence(tmp_path / "drive")
    pinhole = rectified_camera(lens)
    np.testing.assert_array_equal(found.camera.matrix, pinhole.matrix)
    np.testing.assert_allclose(found.time_s, TIMES)
    expected = 128.0 + 60.0 * (np.arange(64) - pinhole.matrix[0, 2]) / pinhole.matrix[0, 0]
    assert np.abs(found.frames[1].astype(float) - expected).max() < 1.0
    # The camera drives along its axis, a metre a second.
    poses = np.loadtxt(tmp_path / "drive" / "poses.txt").reshape(-1, 3, 4)
    np.testing.assert_allclose(poses[:, :, 3], [[0, 0, 0], [0, 0, 0.25], [0, 0, 0.5]], atol=1e-9)
    (scan,) = read_sensor_scans(tmp_path / "drive", found.time_s, sigma_m=0.1).scans
    assert scan.time_s.tolist() == [10.1]
    np.testing.assert_allclose(scan.xyz[0], [2.0 * np.cos(np.pi / 6), 0.0, -1.0], atol=1e-6)
    turned = np.array((tmp_path / "drive" / "calib.txt").read_text().splitlines()[4].split()[1:], dtype=float)
    to_camera = turned.reshape(3, 4)
    # A point ahead of the scanner and as high as it lies before and above the camera.
    np.testing.assert_allclose(to_camera @ [5.0, 0.0, 0.0, 1.0], [0.0, -0.8, 4.8], atol=1e-12)


def test_every_pixel_of_a_rectified_camera_is_seen() -> None:
    lens, pinhole = fisheye(), rectified_camera(fisheye())
    corners = np.array([[0.0, 0.0], [63.0, 0.0], [0.0, 47.0], [63.0, 47.0], [0.0, 23.5], [31.5, 0.0]])
    seen = lens.project(pinhole.rays(corners))
    assert (seen >= -1e-6).all()
    assert (seen <= np.array([63.0, 47.0]) + 1e-6).all()
    assert rectified_camera(pinhole) is pinhole


def test_euroc_is_read_back_with_its_reference(tmp_path: Path) -> None:
    lens = fisheye()
    inertial = Inertial(TIMES, np.full((3, 3), 0.25), np.full((3, 3), 9.5))
    drive = recording(camera=lens, frames=Frames(TIMES, ray_images(lens)), inertial=inertial)
    level = np.tile([0.0, 0.0, 0.0, 1.0], (3, 1))
    real = Trajectory(TIMES, np.zeros((3, 3)), level, np.zeros((3, 3, 3)), "EPSG:32608")
    write_euroc(drive, tmp_path / "drive", real)
    found = read_sequence(tmp_path / "drive")
    assert (found.camera.model, len(found.frames), len(found.inertial)) == ("fisheye", 3, 3)
    np.testing.assert_allclose(found.camera.T_body_camera, FORWARD)
    np.testing.assert_allclose(found.reference[:, :3, 3], 0.0, atol=1e-12)
    text = (tmp_path / "drive" / "mav0" / "imu0" / "sensor.yaml").read_text()
    assert "sensor_type: imu" in text
    assert "rate_hz: 4\n" in text

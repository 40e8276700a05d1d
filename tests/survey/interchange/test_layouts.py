"""Recordings in EuRoC's layout, read by the field's own rules."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from survey.core.errors import InputError
from survey.data.camera import Camera
from survey.data.frames import Frames
from survey.data.recording import Recording
from survey.data.sensors.records import GpsFixes, Inertial
from survey.interchange.layouts import write_euroc, write_tum_list

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

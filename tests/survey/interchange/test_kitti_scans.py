"""KITTI scans are read in the sensor's frame and placed by the trajectory."""

from pathlib import Path

import numpy as np
import pytest

from survey.core.errors import InputError
from survey.interchange.scans import SensorPath, kitti_time_s, read_kitti_scan, read_scans, scan_files

POINTS = np.array([[1.0, 0.0, -2.0, 0.3], [0.0, 0.0, 0.0, 0.0], [0.0, 4.0, -2.0, 0.1]], dtype="<f4")


@pytest.fixture
def track(tmp_path: Path) -> SensorPath:
    """Two poses: facing east at the origin, then facing north 10 m to the east."""
    half = np.sqrt(0.5)
    (tmp_path / "track.txt").write_text(f"5 0 0 2 0 0 0 1\n6 10 0 2 0 0 {half} {half}\n", encoding="utf-8")
    return SensorPath.read(tmp_path / "track.txt")


def _scan(folder: Path, name: str) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / name).write_bytes(POINTS.tobytes())
    return folder / name


def test_missing_returns_are_left_out(tmp_path: Path) -> None:
    np.testing.assert_array_equal(read_kitti_scan(_scan(tmp_path, "000000.bin")), [[1, 0, -2], [0, 4, -2]])


def test_a_scan_is_placed_by_the_pose_of_its_number(tmp_path: Path, track: SensorPath) -> None:
    for name in ("000000.bin", "000001.bin"):
        _scan(tmp_path / "velodyne", name)
    files = scan_files([tmp_path / "velodyne"])
    first, second = read_scans(files, crs="EPSG:32608", sigma_m=0.03, track=track)
    np.testing.assert_allclose(first.xyz, [[1, 0, 0], [0, 4, 0]], atol=1e-9)
    np.testing.assert_allclose(second.xyz, [[10, 1, 0], [6, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(second.origins, [[10, 0, 2], [10, 0, 2]])


def test_times_beside_the_scans_come_before_the_poses(tmp_path: Path, track: SensorPath) -> None:
    file = _scan(tmp_path / "velodyne", "000002.bin")
    (tmp_path / "times.txt").write_text("0.0\n1.0\n5.5\n", encoding="utf-8")
    assert kitti_time_s(file, track.time_s) == 5.5


def test_dates_beside_the_scans_are_seconds_since_1970(tmp_path: Path, track: SensorPath) -> None:
    file = _scan(tmp_path, "0000000001.bin")
    dates = "2011-09-26 13:02:25.594360375\n2011-09-26 13:02:25.694360375\n"
    (tmp_path / "timestamps.txt").write_text(dates, encoding="utf-8")
    assert kitti_time_s(file, track.time_s) == pytest.approx(1317042145.694360375, abs=1e-6)
    (tmp_path / "timestamps.txt").write_text("13:02 at noon\n", encoding="utf-8")
    with pytest.raises(InputError, match="one date and time in each line"):
        kitti_time_s(file, track.time_s)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (POINTS.tobytes()[:-4], "no multiple of the 16"),
        (np.full((2, 4), np.nan, dtype="<f4").tobytes(), "NaN or beyond"),
        (np.full((2, 4), 1e20, dtype="<f4").tobytes(), "NaN or beyond"),
        (np.zeros((2, 4), dtype="<f4").tobytes(), "no return"),
        (b"", "empty"),
    ],
    ids=["cut off", "NaN", "too far", "no return", "empty"],
)
def test_damaged_scans_are_refused(tmp_path: Path, content: bytes, words: str) -> None:
    (tmp_path / "000000.bin").write_bytes(content)
    with pytest.raises(InputError, match=words):
        read_kitti_scan(tmp_path / "000000.bin")


def test_a_scan_without_a_pose_is_refused(tmp_path: Path, track: SensorPath) -> None:
    with pytest.raises(InputError, match="has the number 7, and the trajectory has 2 times"):
        kitti_time_s(_scan(tmp_path, "000007.bin"), track.time_s)
    with pytest.raises(InputError, match="no number as its name"):
        kitti_time_s(_scan(tmp_path, "scan.bin"), track.time_s)
    with pytest.raises(InputError, match="--trajectory"):
        list(read_scans([_scan(tmp_path, "000000.bin")], crs="EPSG:32608", sigma_m=0.1))


def test_times_that_are_no_numbers_are_refused(tmp_path: Path, track: SensorPath) -> None:
    (tmp_path / "times.txt").write_text("noon\n", encoding="utf-8")
    with pytest.raises(InputError, match="no time"):
        kitti_time_s(_scan(tmp_path, "000000.bin"), track.time_s)

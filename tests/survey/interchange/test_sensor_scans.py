"""Scans in the frame of their sensor are recognised in folders of recordings, KITTI drives and ROS 2 bags."""

from pathlib import Path

import numpy as np
import pytest

from survey.core.errors import InputError
from survey.interchange.scans import holds_sensor_scans, read_sensor_scans
from tests.survey.interchange.cloud_bags import write_cloud_bag

XYZ = np.array([[1.0, 2.0, -2.0], [4.0, 5.0, -1.0]])


def test_the_folder_of_a_ros_2_bag_and_the_file_in_it_are_the_same_scans(tmp_path: Path) -> None:
    write_cloud_bag(tmp_path / "bag", {1: XYZ, 2: XYZ + 1.0})
    (file,) = (tmp_path / "bag").glob("*.db3")
    for source in (tmp_path / "bag", file):
        assert holds_sensor_scans(source)
        first, second = read_sensor_scans(source, np.zeros(0), 0.03).scans
        np.testing.assert_allclose(first.xyz, XYZ)
        np.testing.assert_allclose(second.xyz, XYZ + 1.0)
        assert (first.time_s[0], second.time_s[0]) == (1.0, 2.0)


def test_a_ros_1_bag_holds_scans(tmp_path: Path) -> None:
    write_cloud_bag(tmp_path / "drive.bag", {1: XYZ, 2: XYZ + 1.0})
    assert holds_sensor_scans(tmp_path / "drive.bag")
    first, second = read_sensor_scans(tmp_path / "drive.bag", np.zeros(0), 0.03).scans
    np.testing.assert_allclose(first.xyz, XYZ)
    assert (first.time_s[0], second.time_s[0]) == (1.0, 2.0)


@pytest.mark.parametrize("name", ["drive.bag", "drive"])
def test_a_bag_of_clouds_that_is_cut_off_is_refused(tmp_path: Path, name: str) -> None:
    write_cloud_bag(tmp_path / name, dict.fromkeys(range(1, 400), XYZ))
    file = tmp_path / name if name.endswith(".bag") else next((tmp_path / name).glob("*.db3"))
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(InputError, match="damaged or no bag"):
        list(read_sensor_scans(tmp_path / name, np.zeros(0), 0.03).scans)


def test_clouds_of_several_topics_are_refused(tmp_path: Path) -> None:
    write_cloud_bag(tmp_path / "two", {1: XYZ}, ("/front/points", "/rear/points"))
    scans = read_sensor_scans(tmp_path / "two", np.zeros(0), 0.03).scans
    with pytest.raises(InputError, match=r"2 topics of clouds \(/front/points, /rear/points\)"):
        next(scans)


@pytest.mark.parametrize("inside", [".", "velodyne", "velodyne_points/data"])
def test_a_kitti_drive_holds_scans_in_the_folder_of_its_layout(tmp_path: Path, inside: str) -> None:
    folder = tmp_path / "drive" / inside
    folder.mkdir(parents=True)
    np.column_stack([XYZ, np.zeros(2)]).astype("<f4").tofile(folder / "0000000001.bin")
    assert holds_sensor_scans(tmp_path / "drive")
    (scan,) = read_sensor_scans(tmp_path / "drive", np.array([5.0, 6.0]), 0.03).scans
    np.testing.assert_allclose(scan.xyz, XYZ)
    assert scan.time_s.tolist() == [6.0, 6.0]


def test_other_folders_hold_none(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text("a: 1\n", encoding="utf-8")
    assert not holds_sensor_scans(tmp_path)
    assert not holds_sensor_scans(tmp_path / "cloud.laz")

"""Read LiDAR scans in the frame of the sensor: those of a recording, KITTI .bin, ROS 2 PointCloud2."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.core.files.reading import existing_file
from survey.data.scans.lidar_scans import LidarScans, is_lidar_folder
from survey.data.scans.returns import SensorScan
from survey.interchange.kitti_scans import kitti_time_s, read_kitti_scan
from survey.interchange.point_clouds import bag_clouds

_KITTI, _BAGS = ".bin", (".db3", ".mcap", ".bag")
_METADATA = "metadata.yaml"  # of the folder of a ROS 2 bag
_KITTI_FOLDERS = (
    ".",
    "velodyne_points/data",
    "velodyne",
)  # scans, a raw drive, a sequence of the odometry set
_ANGLE_SIGMA_DEG = 0.05
_LIDAR = "lidar"


class SensorScans(NamedTuple):
    """Scans in the frame of the vehicle or of the sensor, with the stated errors of a range [m] and a direction [deg]."""

    scans: Iterator[SensorScan]
    range_sigma_m: float
    angle_sigma_deg: float


def holds_sensor_scans(source: str | Path) -> bool:
    """Return whether a path holds scans in the frame of their sensor: a recording, its scans, KITTI scans or a bag.

    Parameters
    ----------
    source : str or pathlib.Path
        File or folder.

    Returns
    -------
    bool
        False for points in a CRS.
    """
    place = Path(source)
    if place.is_dir():
        is_recorded = is_lidar_folder(place) or is_lidar_folder(place / _LIDAR)
        return is_recorded or _is_bag(place) or _kitti_folder(place) is not None
    return place.suffix == _KITTI or _is_bag(place)


def read_sensor_scans(
    source: str | Path, pose_times_s: FloatArray, sigma_m: float | None = None
) -> SensorScans:
    """Read scans in the frame of their sensor, one after the other.

    Those of a recording are in the frame of the vehicle, and each return has its time. KITTI scans and clouds have
    one time for all returns, and the path has to be that of the scanner.

    Parameters
    ----------
    source : str or pathlib.Path
        Recording or its folder ``lidar``; KITTI ``.bin``, a folder of them, or a raw drive with ``velodyne_points``;
        ``.bag`` of ROS 1; ROS 2 bag, its folder or the ``.db3`` or ``.mcap`` in it.
    pose_times_s : (N,) ndarray
        Times of the poses of the path [s], for KITTI scans without ``times.txt``.
    sigma_m : float, optional
        Standard deviation of a range [m]; needed where the source states none.

    Returns
    -------
    SensorScans
        Read when they are used.

    Raises
    ------
    InputError
        Missing or damaged files, or no standard deviation.
    """
    place = Path(source)
    for folder in (place, place / _LIDAR):
        if is_lidar_folder(folder):
            recorded = LidarScans.read(folder)
            stated = recorded.scanner
            return SensorScans(iter(recorded), sigma_m or stated.range_sigma_m, stated.angle_sigma_deg)
    if sigma_m is None:
        raise InputError(
            f"the scans {place} state no standard deviation of their ranges; give one with --sigma."
        )
    scans = _clouds(place) if _is_bag(place) else _kitti(place, pose_times_s)
    return SensorScans(scans, sigma_m, _ANGLE_SIGMA_DEG)


def _is_bag(place: Path) -> bool:
    """Return whether a path is a ROS 1 bag, the folder of a ROS 2 bag, or the file in it."""
    if place.is_dir():
        return (place / _METADATA).is_file() and any(file.suffix in _BAGS for file in place.iterdir())
    return place.suffix in _BAGS


def _kitti_folder(place: Path) -> Path | None:
    """Return the folder of KITTI scans in a folder; None where there are none."""
    folders = (place / name for name in _KITTI_FOLDERS)
    return next((folder for folder in folders if any(folder.glob(f"*{_KITTI}"))), None)


def _kitti(place: Path, pose_times_s: FloatArray) -> Iterator[SensorScan]:
    folder = _kitti_folder(place) if place.is_dir() else None
    files = [existing_file(place, "the scan")] if folder is None else sorted(folder.glob(f"*{_KITTI}"))
    for file in files:
        yield _at_once(kitti_time_s(file, pose_times_s), read_kitti_scan(file))


def _clouds(place: Path) -> Iterator[SensorScan]:
    for time_s, xyz in bag_clouds(place if place.is_dir() else existing_file(place, "the recording")):
        yield _at_once(time_s, xyz)


def _at_once(time_s: float, xyz: FloatArray) -> SensorScan:
    """Return a scan whose returns have one time, seen from the origin."""
    return SensorScan(np.full(len(xyz), time_s), xyz, np.zeros(3))

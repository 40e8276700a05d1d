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

_KITTI, _BAGS = ".bin", (".db3", ".mcap")
_ANGLE_SIGMA_DEG = 0.05
_LIDAR = "lidar"


class SensorScans(NamedTuple):
    """Scans in the frame of the vehicle or of the sensor, with the stated errors of a range [m] and a direction [deg]."""

    scans: Iterator[SensorScan]
    range_sigma_m: float
    angle_sigma_deg: float


def holds_sensor_scans(source: str | Path) -> bool:
    """Return whether a path holds scans in the frame of their sensor: a recording, its scans, KITTI .bin or a ROS 2 bag.

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
        return is_recorded or any(file.suffix == _KITTI for file in place.iterdir())
    return place.suffix in (_KITTI, *_BAGS)


def read_sensor_scans(
    source: str | Path, pose_times_s: FloatArray, sigma_m: float | None = None
) -> SensorScans:
    """Read scans in the frame of their sensor, one after the other.

    Those of a recording are in the frame of the vehicle, and each return has its time. KITTI scans and clouds have
    one time for all returns, and the path has to be that of the scanner.

    Parameters
    ----------
    source : str or pathlib.Path
        Recording or its folder ``lidar``, KITTI ``.bin`` or a folder of them, ``.db3`` or ``.mcap`` of a ROS 2 bag.
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
    scans = _clouds(place) if place.suffix in _BAGS else _kitti(place, pose_times_s)
    return SensorScans(scans, sigma_m, _ANGLE_SIGMA_DEG)


def _kitti(place: Path, pose_times_s: FloatArray) -> Iterator[SensorScan]:
    files = sorted(place.glob(f"*{_KITTI}")) if place.is_dir() else [existing_file(place, "the scan")]
    for file in files:
        yield _at_once(kitti_time_s(file, pose_times_s), read_kitti_scan(file))


def _clouds(place: Path) -> Iterator[SensorScan]:
    for time_s, xyz in bag_clouds(existing_file(place, "the recording")):
        yield _at_once(time_s, xyz)


def _at_once(time_s: float, xyz: FloatArray) -> SensorScan:
    """Return a scan whose returns have one time, seen from the origin."""
    return SensorScan(np.full(len(xyz), time_s), xyz, np.zeros(3))

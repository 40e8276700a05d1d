"""Reading of LiDAR scans one by one: npz, LAS/LAZ, PLY, KITTI .bin, ROS bags and recordings.

`read_scans` returns scans in the world, with the poses of the sensor; `read_sensor_scans` those in the frame of the sensor.
A KITTI Velodyne scan (``.bin``) has x, y, z and reflectance of each point as 32-bit floats.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from survey.core import UNSTATED, FloatArray, InputError, checked, existing_file, same_vertical_datum
from survey.core.crs import datum_of_file, vertical_datum_of
from survey.core.time_units import LONGEST_STEP_S, refuse_other_unit
from survey.core.transformation import metric_crs
from survey.data.sensors.lidar import LidarScans, SensorScan, is_lidar_folder
from survey.data.surface_points import SurfacePoints
from survey.interchange.bags import bag_clouds
from survey.io.arrays_file import load_npz
from survey.io.point_files import read_point_table
from survey.io.point_table import PLACE
from survey.io.trajectory_files import read_tum

_NPZ, _TABLES, _BAGS, _KITTI = (".npz",), (".las", ".laz", ".ply"), (".db3", ".mcap", ".bag"), (".bin",)
_TIMES = ("gps_time", "time_s", "time", "t")


class SensorPath(NamedTuple):
    """Where the sensor was: times (N,) [s], ascending, positions (N, 3) [m] and attitudes, as a TUM file has them."""

    time_s: FloatArray
    position: FloatArray
    attitude: Rotation

    @classmethod
    def read(cls, path: str | Path) -> "SensorPath":
        """Read a TUM file."""
        rows = read_tum(path)
        if len(rows) < 2 or (np.diff(rows[:, 0]) <= 0).any():
            raise InputError(
                f"the trajectory {path} holds {len(rows)} poses or times that do not ascend; at least two in order of time are needed."
            )
        return cls(rows[:, 0], rows[:, 1:4], Rotation.from_quat(rows[:, 4:8]))

    def place(self, time_s: FloatArray, what: str) -> FloatArray:
        """Return the positions (M, 3) [m] at times (M,), or refuse times that the track does not cover."""
        if time_s.min() < self.time_s[0] or time_s.max() > self.time_s[-1]:
            raise InputError(
                f"{what} was taken between {time_s.min():.3f} and {time_s.max():.3f} s, and the trajectory covers "
                f"{self.time_s[0]:.3f} to {self.time_s[-1]:.3f} s; give the trajectory of the same drive."
            )
        return np.column_stack([np.interp(time_s, self.time_s, axis) for axis in self.position.T])

    def turned(self, xyz: FloatArray, time_s: float) -> FloatArray:
        """Turn points from the sensor's frame to the world's, without its position."""
        turned: FloatArray = Slerp(self.time_s, self.attitude)(time_s).apply(xyz)
        return turned


def scan_files(sources: Sequence[str | Path]) -> list[Path]:
    """Return the scan files among paths, folders opened and sorted by name."""
    known = _NPZ + _TABLES + _BAGS + _KITTI
    files: list[Path] = []
    for source in map(Path, sources):
        if source.is_dir():
            files += sorted(file for file in source.iterdir() if file.suffix.lower() in known)
        elif source.suffix.lower() in known:
            files.append(existing_file(source, "the scan"))
        else:
            raise InputError(f"{source} is no scan; a folder or one of {', '.join(known)} was expected.")
    if not files:
        raise InputError(f"there is no scan in {', '.join(map(str, sources))}; {', '.join(known)} are read.")
    return files


def read_scans(
    files: Sequence[Path],
    *,
    crs: Any,
    sigma_m: float | None,
    track: SensorPath | None = None,
    units: str | None = None,
) -> Iterator[SurfacePoints]:
    """Read scans one after the other.

    Every scan carries its sensor's place: an ``.npz`` as `origin` (3,) or `origins` (N, 3)
    beside `points` (N, 3); LAS, LAZ and PLY as the columns ``origin_x_m``, ``origin_y_m`` and
    ``origin_z_m``, or as a time per point where a trajectory is given; messages of a ROS 2
    recording and KITTI scans are in the sensor's frame and need the trajectory's attitude too. The
    time of a KITTI scan is described at `survey.interchange.scans.kitti_time_s`.

    `sigma_m`: standard deviation of heights [m] for files that state none. `units`: unit of heights of LAS, LAZ and PLY
    files that state none; the others are in metres.
    """
    datum = UNSTATED
    for file in files:
        for scan in _read(file, crs, sigma_m, track, units):
            same_vertical_datum(datum, scan.vertical_datum, f"{file} and the scans before it")
            datum = datum or scan.vertical_datum
            yield scan


def _read(
    file: Path, crs: Any, sigma_m: float | None, track: SensorPath | None, units: str | None
) -> Iterator[SurfacePoints]:
    """Read the scans of one file."""
    suffix = file.suffix.lower()
    if suffix in _BAGS:
        yield from _read_bag(file, crs, sigma_m, track)
    elif suffix in _NPZ:
        yield _read_npz(file, crs, sigma_m)
    elif suffix in _KITTI:
        yield _read_kitti(file, crs, sigma_m, track)
    else:
        yield _read_table(file, crs, sigma_m, track, units)


def _read_npz(path: Path, crs: Any, sigma_m: float | None) -> SurfacePoints:
    file = existing_file(path, "the scan")
    arrays = load_npz(file, "the scan", "get it again")
    if "points" not in arrays:
        raise InputError(f"the scan {file} holds {', '.join(arrays) or 'nothing'}; `points` was expected.")
    xyz = checked(arrays["points"], (None, 3), f"the points of the scan {file}")
    origin = arrays.get("origins", arrays.get("origin"))
    origins = None if origin is None else np.broadcast_to(np.asarray(origin, dtype=np.float64), xyz.shape)
    return _points(file, xyz, origins, arrays.get("sigma_m", sigma_m), crs)


def _read_table(
    file: Path, crs: Any, sigma_m: float | None, track: SensorPath | None, units: str | None
) -> SurfacePoints:
    if track is None:
        return SurfacePoints.read(file, crs=crs, sigma_m=sigma_m, units=units, ground=None)
    table = read_point_table(file, crs=crs, units=units)
    crs = None if crs is None else metric_crs(crs, f"the scan {file}").crs
    columns = table.columns
    time = next((columns[name] for name in _TIMES if name in columns), None)
    if time is None:
        raise InputError(
            f"the scan {file} has no time per point ({', '.join(_TIMES)}); a trajectory needs it to place the sensor."
        )
    xyz = np.column_stack([columns[name] for name in PLACE])
    origins = track.place(time, f"the scan {file}")
    datum = datum_of_file(table.vertical_datum, crs, f"the scan {file}")
    return _points(file, xyz, origins, columns.get("sigma_z_m", sigma_m), table.crs or crs, datum=datum)


def _read_kitti(file: Path, crs: Any, sigma_m: float | None, track: SensorPath | None) -> SurfacePoints:
    if track is None:
        raise InputError(
            f"the points of {file} are in the sensor's frame; give the trajectory of the sensor (TUM) with --trajectory."
        )
    time_s = kitti_time_s(file, track.time_s)
    xyz, origins = _in_world(read_kitti_scan(file), time_s, file, track)
    return _points(file, xyz, origins, sigma_m, crs)


def _read_bag(
    path: Path, crs: Any, sigma_m: float | None, track: SensorPath | None
) -> Iterator[SurfacePoints]:
    if track is None:
        raise InputError(
            f"the points of {path} are in the sensor's frame; give the trajectory of the sensor (TUM) with --trajectory."
        )
    for time_s, xyz in bag_clouds(path):
        world, origins = _in_world(xyz, time_s, path, track)
        yield _points(path, world, origins, sigma_m, crs)


def _in_world(xyz: FloatArray, time_s: float, path: Path, track: SensorPath) -> tuple[FloatArray, FloatArray]:
    """Return the points (N, 3) [m] of one moment in the world, and the place of the sensor for each."""
    place = track.place(np.array([time_s]), f"a scan of {path}")
    world: FloatArray = track.turned(xyz, time_s) + place
    return world, np.broadcast_to(place, world.shape)


def _points(
    path: Path, xyz: FloatArray, origins: Any, sigma_m: Any, crs: Any, *, datum: str | None = None
) -> SurfacePoints:
    if sigma_m is None:
        raise InputError(f"the scan {path} states no standard deviation; give one with --sigma.")
    if crs is None:
        raise InputError(f"the scan {path} names no CRS; give it with --crs.")
    try:
        stated = vertical_datum_of(crs) if datum is None else datum
        return SurfacePoints(xyz, sigma_m=sigma_m, origins=origins, crs=crs, vertical_datum=stated)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


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
    """Return whether a path holds scans in the frame of their sensor: a recording, its scans, KITTI scans or a bag."""
    place = Path(source)
    if place.is_dir():
        is_recorded = is_lidar_folder(place) or is_lidar_folder(place / _LIDAR)
        return is_recorded or _is_bag(place) or _kitti_folder(place) is not None
    return place.suffix in _KITTI or _is_bag(place)


def read_sensor_scans(
    source: str | Path, pose_times_s: FloatArray, sigma_m: float | None = None
) -> SensorScans:
    """Read scans in the frame of their sensor, one after the other.

    Those of a recording are in the frame of the vehicle, and each return has its time. KITTI scans and clouds have
    one time for all returns, and the path has to be that of the scanner.

    `pose_times_s` (N,): times of the poses of the path [s], for KITTI scans without ``times.txt``. `sigma_m`:
    standard deviation of a range [m]; needed where the source states none.
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
    return next((folder for folder in folders if any(folder.glob("*.bin"))), None)


def _kitti(place: Path, pose_times_s: FloatArray) -> Iterator[SensorScan]:
    folder = _kitti_folder(place) if place.is_dir() else None
    files = [existing_file(place, "the scan")] if folder is None else sorted(folder.glob("*.bin"))
    for file in files:
        yield _at_once(kitti_time_s(file, pose_times_s), read_kitti_scan(file))


def _clouds(place: Path) -> Iterator[SensorScan]:
    for time_s, xyz in bag_clouds(place if place.is_dir() else existing_file(place, "the recording")):
        yield _at_once(time_s, xyz)


def _at_once(time_s: float, xyz: FloatArray) -> SensorScan:
    """Return a scan whose returns have one time, seen from the origin."""
    return SensorScan(np.full(len(xyz), time_s), xyz, np.zeros(3))


_POINT_BYTES = 16
# No scanner of a rover or car measures farther; what does is no scan.
_FARTHEST_M = 5000.0
_TIMESTAMPS, _DATES = "times.txt", "timestamps.txt"


def read_kitti_scan(path: str | Path) -> FloatArray:
    """Read the points of one scan.

    Returns (N, 3): points in the sensor's frame (x forward, y left, z up) [m]; points at the sensor itself
    mark missing returns and are left out.
    """
    file = existing_file(path, "the scan")
    size = file.stat().st_size
    if size % _POINT_BYTES:
        raise InputError(
            f"the scan {file} has {size} bytes, no multiple of the {_POINT_BYTES} of a point; it was cut off or is no KITTI scan."
        )
    xyz = np.fromfile(file, dtype="<f4").reshape(-1, 4)[:, :3].astype(np.float64)
    if not (np.isfinite(xyz).all() and np.abs(xyz).max() <= _FARTHEST_M):
        raise InputError(
            f"the scan {file} holds coordinates that are NaN or beyond {_FARTHEST_M:g} m; it is damaged or no KITTI scan."
        )
    points: FloatArray = xyz[(xyz != 0.0).any(axis=1)]
    if len(points) == 0:
        raise InputError(f"the scan {file} holds no return; leave it out.")
    return points


def kitti_time_s(path: str | Path, pose_times_s: FloatArray) -> float:
    """Return the time of a scan by the number in its name.

    `pose_times_s` (N,): times of the poses of the trajectory [s]. Returns: the line of that number in
    ``times.txt``, or in ``timestamps.txt`` with dates in UTC (seconds since 1970), in the folder of the scan
    or the one above; where there is none, the time of the pose of that number, for KITTI has one pose for
    each scan [s].
    """
    file = Path(path)
    if not file.stem.isdecimal():
        raise InputError(
            f"the scan {file} has no number as its name; KITTI scans are named 000000.bin, 000001.bin …"
        )
    number, where, times = int(file.stem), "the trajectory", pose_times_s
    beside = (folder / name for folder in (file.parent, file.parent.parent) for name in (_TIMESTAMPS, _DATES))
    stated = next((table for table in beside if table.is_file()), None)
    if stated is not None:
        where, times = str(stated), _times_s(stated)
    if number >= len(times):
        raise InputError(
            f"the scan {file} has the number {number}, and {where} has {len(times)} times; give that of the same drive."
        )
    return float(times[number])


def _times_s(path: Path) -> FloatArray:
    lines = [line.strip() for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    try:
        if path.name == _DATES:
            since = np.array(lines, dtype="datetime64[ns]").astype(np.int64)
            return np.asarray(1e-9 * since, dtype=np.float64)
        times_s = np.array([float(line) for line in lines])
    except ValueError as error:
        expected = "one date and time" if path.name == _DATES else "one number"
        raise InputError(
            f"{path} holds something that is no time ({error}); {expected} in each line was expected."
        ) from error
    refuse_other_unit(times_s, f"the times in {path}", LONGEST_STEP_S)
    return times_s

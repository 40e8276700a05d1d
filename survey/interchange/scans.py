"""Read LiDAR scans one by one: npz, LAS/LAZ, PLY, KITTI .bin, and ROS recordings."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from survey.core.arrays import FloatArray, checked
from survey.core.crs.vertical_datum import UNSTATED, datum_of_file, same_vertical_datum, vertical_datum_of
from survey.core.errors import InputError
from survey.core.files.reading import existing_file
from survey.data.surface_points import SurfacePoints
from survey.interchange.kitti_scans import kitti_time_s, read_kitti_scan
from survey.interchange.point_clouds import bag_clouds
from survey.io.arrays_file import load_npz
from survey.io.point_columns import PLACE
from survey.io.points.formats import read_point_table
from survey.io.pose_files import read_tum

_NPZ, _TABLES, _BAGS, _KITTI = (".npz",), (".las", ".laz", ".ply"), (".db3", ".mcap", ".bag"), (".bin",)
_ORIGIN = ("origin_x_m", "origin_y_m", "origin_z_m")
_TIMES = ("gps_time", "time_s", "time", "t")


class SensorPath(NamedTuple):
    """Where the sensor was: times (N,) [s], ascending, positions (N, 3) [m] and attitudes, as a TUM file has them."""

    time_s: FloatArray
    position: FloatArray
    attitude: Rotation

    @classmethod
    def read(cls, path: str | Path) -> "SensorPath":
        """Read a TUM file.

        Raises
        ------
        InputError
            Missing or damaged, fewer than two poses, or times that do not ascend.
        """
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
    """Return the scan files among paths, folders opened and sorted by name.

    Raises
    ------
    InputError
        A path that does not exist or whose ending is not known, or no scan at all.
    """
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
    files: Sequence[Path], *, crs: Any, sigma_m: float | None, track: SensorPath | None = None
) -> Iterator[SurfacePoints]:
    """Read scans one after the other.

    Every scan carries its sensor's place: an ``.npz`` as `origin` (3,) or `origins` (N, 3)
    beside `points` (N, 3); LAS, LAZ and PLY as the columns ``origin_x_m``, ``origin_y_m`` and
    ``origin_z_m``, or as a time per point where a trajectory is given; messages of a ROS 2
    recording and KITTI scans are in the sensor's frame and need the trajectory's attitude too. The
    time of a KITTI scan is described at `survey.interchange.kitti_scans.kitti_time_s`.

    Parameters
    ----------
    files : sequence of pathlib.Path
        As `scan_files` gives them.
    crs : str or pyproj.CRS
        Of points whose file names none.
    sigma_m : float, optional
        Standard deviation of heights [m] for files that state none.
    track : Track, optional
        Where the sensor was.

    Yields
    ------
    SurfacePoints
        One scan. A scan without place of its sensor has no origins.

    Raises
    ------
    InputError
        Damaged or empty files, NaN, no CRS, no standard deviation, times beyond the trajectory.
    """
    datum = UNSTATED
    for file in files:
        for scan in _read(file, crs, sigma_m, track):
            same_vertical_datum(datum, scan.vertical_datum, f"{file} and the scans before it")
            datum = datum or scan.vertical_datum
            yield scan


def _read(file: Path, crs: Any, sigma_m: float | None, track: SensorPath | None) -> Iterator[SurfacePoints]:
    """Read the scans of one file."""
    suffix = file.suffix.lower()
    if suffix in _BAGS:
        yield from _read_bag(file, crs, sigma_m, track)
    elif suffix in _NPZ:
        yield _read_npz(file, crs, sigma_m)
    elif suffix in _KITTI:
        yield _read_kitti(file, crs, sigma_m, track)
    else:
        yield _read_table(file, crs, sigma_m, track)


def _read_npz(path: Path, crs: Any, sigma_m: float | None) -> SurfacePoints:
    file = existing_file(path, "the scan")
    arrays = load_npz(file, "the scan", "get it again")
    if "points" not in arrays:
        raise InputError(f"the scan {file} holds {', '.join(arrays) or 'nothing'}; `points` was expected.")
    xyz = checked(arrays["points"], (None, 3), f"the points of the scan {file}")
    origin = arrays.get("origins", arrays.get("origin"))
    origins = None if origin is None else np.broadcast_to(np.asarray(origin, dtype=np.float64), xyz.shape)
    return _points(file, xyz, origins, arrays.get("sigma_m", sigma_m), crs)


def _read_table(file: Path, crs: Any, sigma_m: float | None, track: SensorPath | None) -> SurfacePoints:
    if track is None:
        return SurfacePoints.read(file, crs=crs, sigma_m=sigma_m)
    table = read_point_table(file)
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

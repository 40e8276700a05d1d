"""Read KITTI Velodyne scans (``.bin``): x, y, z and reflectance of each point as 32-bit floats."""

from pathlib import Path

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.core.files.reading import existing_file

_POINT_BYTES = 16
# No scanner of a rover or car measures farther; what does is no scan.
_FARTHEST_M = 5000.0
_TIMES, _DATES = "times.txt", "timestamps.txt"


def read_kitti_scan(path: str | Path) -> FloatArray:
    """Read the points of one scan.

    Parameters
    ----------
    path : str or pathlib.Path
        A ``.bin`` file.

    Returns
    -------
    (N, 3) ndarray
        Points in the sensor's frame (x forward, y left, z up) [m]; points at the sensor itself mark missing
        returns and are left out.

    Raises
    ------
    InputError
        Missing, empty, cut off, no point with a return, or numbers that are no distances.
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

    Parameters
    ----------
    path : str or pathlib.Path
        The scan, such as ``velodyne/000012.bin``.
    pose_times_s : (N,) ndarray
        Times of the poses of the trajectory [s].

    Returns
    -------
    float
        The line of that number in ``times.txt``, or in ``timestamps.txt`` with dates in UTC (seconds since 1970), in
        the folder of the scan or the one above; where there is none, the time of the pose of that number, for
        KITTI has one pose for each scan [s].

    Raises
    ------
    InputError
        A name that is no number, or a number without a time.
    """
    file = Path(path)
    if not file.stem.isdecimal():
        raise InputError(
            f"the scan {file} has no number as its name; KITTI scans are named 000000.bin, 000001.bin …"
        )
    number, where, times = int(file.stem), "the trajectory", pose_times_s
    beside = (folder / name for folder in (file.parent, file.parent.parent) for name in (_TIMES, _DATES))
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
        return np.array([float(line) for line in lines])
    except ValueError as error:
        expected = "one date and time" if path.name == _DATES else "one number"
        raise InputError(
            f"{path} holds something that is no time ({error}); {expected} in each line was expected."
        ) from error

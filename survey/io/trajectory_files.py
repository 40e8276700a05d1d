"""Trajectory files: poses as TUM and KITTI text, places as GPX and GeoPackage.

TUM has a time, a position and a quaternion a line; KITTI the first three rows of the pose matrix. Files of firnline carry
the number of poses and a checksum in comments, which readers of TUM skip. GPX holds degrees and dates; GeoPackage holds
points in the CRS of the survey.
"""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from pyproj import CRS

from survey.core import FloatArray, InputError, existing_file, replacing
from survey.core.time_units import LONGEST_STEP_S, refuse_other_unit
from survey.core.transformation import WGS84, transformed
from survey.io.arrays_file import checksum, refuse_altered
from survey.io.vector import read_features, write_features

TUM_COLUMNS = ("time_s", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
KITTI_COLUMNS = tuple(
    f"{'xyz'[row] if column == 3 else 'r'}{row}{column}" for row in range(3) for column in range(4)
)
# TUM readers skip lines like these; they show that a file was cut off at the end of a line, or altered.
_COUNT, _CRC = "# poses: ", "# crc32: "
_SHORTEST = 1e-6


def write_tum(path: str | Path, rows: FloatArray) -> None:
    """Write poses (N, 8) as TUM text; numbers read back exactly as they were.

    `rows` (N, 8): time [s], position [m], quaternion x y z w.
    """
    lines = _lines(rows)
    _write_lines(
        path, [f"# {' '.join(TUM_COLUMNS)}", f"{_COUNT}{len(rows)}", f"{_CRC}{checksum(lines)}", *lines]
    )


def read_tum(path: str | Path) -> FloatArray:
    """Read TUM text into (N, 8): time, position, quaternion x y z w.

    Returns (N, 8): time [s], position [m], quaternion x y z w.
    """
    rows = _read_rows(path, TUM_COLUMNS, "TUM")
    refuse_other_unit(rows[:, 0], f"the times of the trajectory {path}", LONGEST_STEP_S)
    no_turn = np.flatnonzero(np.linalg.norm(rows[:, 4:8], axis=1) < _SHORTEST)
    if len(no_turn):
        raise InputError(
            f"pose {no_turn[0] + 1} of {path} has a quaternion of length 0, which is no orientation; check the columns."
        )
    return rows


def write_kitti(path: str | Path, poses: FloatArray) -> None:
    """Write poses (N, 3, 4), rotation and position, as KITTI text, which has no times.

    Numbers read back exactly as they were.

    `poses` (N, 3, 4): rotations, and positions [m] in the last column.
    """
    _write_lines(path, _lines(poses.reshape(-1, 12)))


def read_kitti(path: str | Path) -> FloatArray:
    """Read KITTI text into (N, 3, 4): rotation and position.

    Returns (N, 3, 4): rotations, and positions [m] in the last column.
    """
    poses = _read_rows(path, KITTI_COLUMNS, "KITTI").reshape(-1, 3, 4)
    turn = poses[:, :, :3]
    off = np.abs(turn @ turn.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    bad = np.flatnonzero(~(off < 1e-3) | (np.linalg.det(turn) < 0.0))
    if len(bad):
        raise InputError(
            f"the trajectory {path}, pose {bad[0] + 1}: its nine numbers are no rotation; correct it."
        )
    return poses


def _lines(rows: FloatArray) -> list[str]:
    return [" ".join(map(repr, row)) for row in rows.tolist()]


def _write_lines(path: str | Path, lines: Sequence[str]) -> None:
    with replacing(path) as draft, draft.open("w", encoding="utf-8") as file:
        file.writelines(f"{line}\n" for line in lines)


def _read_rows(path: str | Path, columns: Sequence[str], kind: str) -> FloatArray:
    file = existing_file(path, "the trajectory")
    try:
        content = file.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InputError(
            f"the trajectory {file} is no text ({error.reason}); a {kind} file was expected."
        ) from error
    if not content.endswith("\n"):
        raise InputError(
            f"the trajectory {file} ends in the middle of a line; it may be cut off, make it again or end it with a line break."
        )
    numbered = [
        (number, line)
        for number, line in enumerate(content.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    rows = [_row(line, columns, f"the trajectory {file}, line {number}") for number, line in numbered]
    _refuse_incomplete(file, content, [line for _, line in numbered])
    if not rows:
        raise InputError(
            f"the trajectory {file} holds no poses; {len(columns)} numbers a line were expected."
        )
    array: FloatArray = np.array(rows)
    return array


def _refuse_incomplete(file: Path, content: str, lines: Sequence[str]) -> None:
    """Hold the poses against the count and the checksum that the file's comments state, where they do."""
    stated = {
        mark: line.removeprefix(mark)
        for line in content.splitlines()
        for mark in (_COUNT, _CRC)
        if line.startswith(mark)
    }
    if stated.get(_COUNT, str(len(lines))) != str(len(lines)):
        raise InputError(
            f"the trajectory {file} holds {len(lines)} of {stated[_COUNT][:16]} poses; it was cut off or joined, make it again."
        )
    if _CRC in stated:
        refuse_altered(file, stated[_CRC], lines, f"its line {_CRC.strip()!r}")


def _row(line: str, columns: Sequence[str], where: str) -> list[float]:
    try:
        numbers = [float(word) for word in line.replace(",", " ").split()]
    except ValueError as error:
        raise InputError(f"{where}: {error}; {' '.join(columns)} were expected.") from error
    if len(numbers) != len(columns):
        raise InputError(f"{where}: {len(numbers)} numbers; {' '.join(columns)} were expected.")
    return numbers


# Times of less than _UNIX_FROM_S count from here where a format requires a date; larger ones are Unix times.
_EPOCH_S = datetime(2000, 1, 1, tzinfo=UTC).timestamp()
_UNIX_FROM_S = 1e8
_TIME, _HEIGHT = "time_s", "elevation_m"


def write_track(path: str | Path, time_s: FloatArray, xyz: FloatArray, crs: CRS) -> None:
    """Write a track of places (N, 3) [m]: ``.gpx`` in degrees for hand-helds, ``.gpkg`` as points in its CRS.

    GPX requires dates, in whole milliseconds: times that are all above 1e8 s are Unix times, others count from the
    beginning of the year 2000.
    Degrees are written to nine decimals, a tenth of a millimetre.

    `time_s` (N,): times [s]. `xyz` (N, 3): easting, northing, height [m].
    """
    if Path(path).suffix.lower() == ".gpx":
        _write_gpx(path, time_s, xyz, crs)
        return
    columns = {_TIME: time_s, _HEIGHT: xyz[:, 2]}
    write_features(path, shapely.points(xyz), columns, crs, layer="track")


def read_track(path: str | Path, crs: CRS) -> tuple[FloatArray, FloatArray]:
    """Read times (N,) [s] and places (N, 3) [m] of a ``.gpx`` or ``.gpkg`` track into a projected CRS.

    Returns `time_s, xyz`: times (N,) [s] and places (N, 3) [m]. Dates of GPX that lie within 1e8 s of the
    beginning of the year 2000 count from there, as `write_track` writes times that are no dates; others
    become Unix times.
    """
    if Path(path).suffix.lower() == ".gpx":
        unix_s, xyz = read_gpx(path, crs)
        since_2000 = unix_s - _EPOCH_S
        return (since_2000 if (np.abs(since_2000) <= _UNIX_FROM_S).all() else unix_s), xyz
    features = read_features(path, what="the track")
    heights = _numbers(features.attributes.get(_HEIGHT), path, f"a column {_HEIGHT}")
    time_s = _numbers(features.attributes.get(_TIME), path, f"a column {_TIME}")
    refuse_other_unit(time_s, f"the times of the track {path}", LONGEST_STEP_S)
    return time_s, _places(features.geometry, heights, features.crs, crs, path)


def read_gpx(path: str | Path, crs: CRS) -> tuple[FloatArray, FloatArray]:
    """Read the Unix times (N,) [s] and the places (N, 3) [m] of a GPX track into a CRS.

    Returns `unix_s, xyz`: unix times (N,) [s], of UTC where the file states no offset, and places (N, 3).
    """
    features = read_features(path, layer="track_points", what="the track", dates_as_text=True)
    heights = _numbers(features.attributes.get("ele"), path, "heights (<ele>)")
    unix_s = _seconds(features.attributes.get("time"), path)
    return unix_s, _places(features.geometry, heights, WGS84, crs, path)


def _places(shapes: Any, heights: FloatArray, source: Any, crs: CRS, path: str | Path) -> FloatArray:
    """Return the points of a track with their heights (N, 3) in a CRS."""
    if source is None or any(shape is None or shape.geom_type != "Point" for shape in shapes):
        raise InputError(
            f"the track {path} is no series of points in a coordinate reference system; save it as one."
        )
    xy = transformed(shapely.get_coordinates(shapes), source, crs, f"the track {path}")
    return np.column_stack([xy, heights])


def track_crs(path: str | Path) -> CRS | None:
    """Return the CRS of a ``.gpx`` or ``.gpkg`` track as its file states it.

    Returns: WGS 84 for ``.gpx``; None where the file states none.
    """
    if Path(path).suffix.lower() == ".gpx":
        return WGS84
    stated = read_features(path, what="the track").crs
    return None if stated is None else CRS(stated)


def _write_gpx(path: str | Path, time_s: FloatArray, xyz: FloatArray, crs: CRS) -> None:
    degrees = np.round(transformed(xyz[:, :2], crs, WGS84, "the track"), 9)
    unix_s = time_s if (time_s > _UNIX_FROM_S).all() else time_s + _EPOCH_S
    columns = {
        "track_fid": np.zeros(len(xyz), dtype=np.int32),
        "track_seg_id": np.zeros(len(xyz), dtype=np.int32),
        "ele": xyz[:, 2],
        "time": np.rint(1e3 * unix_s).astype("int64").astype("datetime64[ms]"),
    }
    write_features(path, shapely.points(degrees), columns, WGS84, layer="track_points")


def _seconds(column: Any, path: str | Path) -> FloatArray:
    """Return the Unix times (N,) [s] of dates as text; those without an offset are of UTC, as GPX requires."""
    if column is None or not all(column):
        raise InputError(f"the track {path} lacks times; record them, or take the places alone.")
    try:
        dates = [datetime.fromisoformat(str(text)) for text in column]
    except ValueError as error:
        raise InputError(f"the track {path} has a time that is no date ({error}); correct it.") from error
    return np.array([(date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp() for date in dates])


def _numbers(column: Any, path: str | Path, what: str) -> FloatArray:
    try:
        values = np.asarray(column, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.array([np.nan])
    if values.ndim != 1 or not np.isfinite(values).all():
        raise InputError(f"the track {path} lacks {what}; save it with them.")
    return values

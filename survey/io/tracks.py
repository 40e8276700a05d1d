"""Tracks: GPX and GeoPackage."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from pyproj import CRS

from survey.core.arrays import FloatArray
from survey.core.crs.transformation import transformed
from survey.core.errors import InputError
from survey.io.vector import read_features, write_features

# Times of less than _UNIX_FROM_S count from here where a format requires a date; larger ones are Unix times.
_EPOCH_S = datetime(2000, 1, 1, tzinfo=UTC).timestamp()
_UNIX_FROM_S = 1e8
_WGS84 = CRS.from_epsg(4326)
_TIME, _HEIGHT = "time_s", "elevation_m"


def write_track(path: str | Path, time_s: FloatArray, xyz: FloatArray, crs: CRS) -> None:
    """Write a track of places (N, 3) [m]: ``.gpx`` in degrees for hand-helds, ``.gpkg`` as points in its CRS.

    GPX requires dates, in whole milliseconds: times that are all above 1e8 s are Unix times, others count from the
    beginning of the year 2000.
    Degrees are written to nine decimals, a tenth of a millimetre.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    time_s : (N,) ndarray
        Times [s].
    xyz : (N, 3) ndarray
        Easting, northing, height [m].
    crs : pyproj.CRS
        Projected CRS of the places.
    """
    if Path(path).suffix.lower() == ".gpx":
        _write_gpx(path, time_s, xyz, crs)
        return
    columns = {_TIME: time_s, _HEIGHT: xyz[:, 2]}
    write_features(path, shapely.points(xyz), columns, crs, layer="track")


def read_track(path: str | Path, crs: CRS) -> tuple[FloatArray, FloatArray]:
    """Read times (N,) [s] and places (N, 3) [m] of a ``.gpx`` or ``.gpkg`` track into a projected CRS.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    crs : pyproj.CRS
        Projected CRS of the result.

    Returns
    -------
    time_s, xyz : tuple of ndarray
        Times (N,) [s] and places (N, 3) [m]. Dates of GPX that lie within 1e8 s of the beginning of the year 2000
        count from there, as `write_track` writes times that are no dates; others become Unix times.

    Raises
    ------
    InputError
        Missing, damaged, no track, points without a height or without a time.
    """
    if Path(path).suffix.lower() == ".gpx":
        unix_s, xyz = read_gpx(path, crs)
        since_2000 = unix_s - _EPOCH_S
        return (since_2000 if (np.abs(since_2000) <= _UNIX_FROM_S).all() else unix_s), xyz
    features = read_features(path, what="the track")
    heights = _numbers(features.attributes.get(_HEIGHT), path, f"a column {_HEIGHT}")
    time_s = _numbers(features.attributes.get(_TIME), path, f"a column {_TIME}")
    return time_s, _places(features.geometry, heights, features.crs, crs, path)


def read_gpx(path: str | Path, crs: CRS) -> tuple[FloatArray, FloatArray]:
    """Read the Unix times (N,) [s] and the places (N, 3) [m] of a GPX track into a CRS.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    crs : pyproj.CRS
        CRS of the result.

    Returns
    -------
    unix_s, xyz : tuple of ndarray
        Unix times (N,) [s], of UTC where the file states no offset, and places (N, 3).

    Raises
    ------
    InputError
        Missing, damaged, no track, points without a height or without a time.
    """
    features = read_features(path, layer="track_points", what="the track", dates_as_text=True)
    heights = _numbers(features.attributes.get("ele"), path, "heights (<ele>)")
    unix_s = _seconds(features.attributes.get("time"), path)
    return unix_s, _places(features.geometry, heights, _WGS84, crs, path)


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

    Parameters
    ----------
    path : str or pathlib.Path
        The file.

    Returns
    -------
    pyproj.CRS or None
        WGS 84 for ``.gpx``; None where the file states none.
    """
    if Path(path).suffix.lower() == ".gpx":
        return _WGS84
    stated = read_features(path, what="the track").crs
    return None if stated is None else CRS(stated)


def _write_gpx(path: str | Path, time_s: FloatArray, xyz: FloatArray, crs: CRS) -> None:
    degrees = np.round(transformed(xyz[:, :2], crs, _WGS84, "the track"), 9)
    unix_s = time_s if (time_s > _UNIX_FROM_S).all() else time_s + _EPOCH_S
    columns = {
        "track_fid": np.zeros(len(xyz), dtype=np.int32),
        "track_seg_id": np.zeros(len(xyz), dtype=np.int32),
        "ele": xyz[:, 2],
        "time": np.rint(1e3 * unix_s).astype("int64").astype("datetime64[ms]"),
    }
    write_features(path, shapely.points(degrees), columns, _WGS84, layer="track_points")


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

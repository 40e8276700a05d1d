"""Tracks: GPX and GeoPackage."""

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from pyproj import CRS

from survey.core.arrays import FloatArray
from survey.core.crs.transformation import transformed
from survey.core.errors import InputError
from survey.io.vector import read_features, write_features

# Times count from here where a format requires a date and the track has none.
_EPOCH = datetime(2000, 1, 1, tzinfo=UTC)
_WGS84 = CRS.from_epsg(4326)
_TIME, _HEIGHT = "time_s", "elevation_m"


def write_track(path: str | Path, time_s: FloatArray, xyz: FloatArray, crs: CRS) -> None:
    """Write a track of places (N, 3) [m]: ``.gpx`` in degrees for hand-helds, ``.gpkg`` as points in its CRS.

    GPX requires dates: times count from the beginning of the year 2000, in whole milliseconds.
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
        Times (N,) [s] and places (N, 3) [m].

    Raises
    ------
    InputError
        Missing, damaged, no track, points without a height or without a time.
    """
    if Path(path).suffix.lower() == ".gpx":
        features = read_features(path, layer="track_points", what="the track")
        heights = _numbers(features.attributes.get("ele"), path, "heights (<ele>)")
        time_s = _seconds(features.attributes.get("time"), path)
        source: Any = _WGS84
    else:
        features = read_features(path, what="the track")
        heights = _numbers(features.attributes.get(_HEIGHT), path, f"a column {_HEIGHT}")
        time_s = _numbers(features.attributes.get(_TIME), path, f"a column {_TIME}")
        source = features.crs
    if source is None or any(shape is None or shape.geom_type != "Point" for shape in features.geometry):
        raise InputError(
            f"the track {path} is no series of points in a coordinate reference system; save it as one."
        )
    xy = transformed(shapely.get_coordinates(features.geometry), source, crs, f"the track {path}")
    return time_s, np.column_stack([xy, heights])


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
    dates = [_EPOCH + timedelta(milliseconds=round(1e3 * t)) for t in time_s.tolist()]
    columns = {
        "track_fid": np.zeros(len(xyz), dtype=np.int32),
        "track_seg_id": np.zeros(len(xyz), dtype=np.int32),
        "ele": xyz[:, 2],
        "time": np.array([date.replace(tzinfo=None) for date in dates], dtype="datetime64[ms]"),
    }
    write_features(path, shapely.points(degrees), columns, _WGS84, layer="track_points")


def _seconds(column: Any, path: str | Path) -> FloatArray:
    if column is None or np.isnat(np.asarray(column, dtype="datetime64[ms]")).any():
        raise InputError(f"the track {path} lacks times; record them, or take the places alone.")
    since = np.asarray(column, dtype="datetime64[ms]") - np.datetime64(_EPOCH.replace(tzinfo=None), "ms")
    seconds: FloatArray = since.astype(np.float64) / 1e3
    return seconds


def _numbers(column: Any, path: str | Path, what: str) -> FloatArray:
    try:
        values = np.asarray(column, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.array([np.nan])
    if values.ndim != 1 or not np.isfinite(values).all():
        raise InputError(f"the track {path} lacks {what}; save it with them.")
    return values

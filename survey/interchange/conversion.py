"""Conversion of rasters, points, tracks and areas from one file format to another, values and CRS unchanged.

`kind_of` finds what a file holds by its ending, the ending of the file to write, or its content; `convert` reads and
writes it. Routes are converted by `survey.interchange.route_formats`.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from survey.core import InputError, agreed_crs, existing_file, projected_crs
from survey.core.crs import datum_of_file
from survey.core.transformation import chosen_crs, metric_crs
from survey.data.area import SurveyArea
from survey.data.surface_points import project_table
from survey.data.trajectory import Trajectory
from survey.interchange.route_readers import READERS
from survey.io.point_files import read_point_table, write_point_table
from survey.io.raster import LARGEST_CELLS, band_count, band_names, raster_header, read_raster, write_raster
from survey.io.raster.large import convert_in_windows
from survey.io.trajectory_files import read_track, track_crs, write_kitti, write_track, write_tum
from survey.io.vector import geometry_types

_TRACKS = (".gpx", ".gpkg")
FileKind = Literal["raster", "points", "track", "area"]


def convert(
    source: str | Path,
    out: str | Path,
    kind: FileKind,
    *,
    crs: Any = None,
    units: str | None = None,
    select: Sequence[str] = (),
) -> None:
    """Write what a file holds in the format that the other's ending names; feet become metres.

    `select`: which outlines of an area.
    """
    if kind == "raster":
        _raster(source, out, crs, units)
    elif kind == "points":
        read = read_point_table(source, crs=crs, units=units)
        crs = None if crs is None else metric_crs(crs, str(source)).crs
        table = project_table(read, crs, str(source))
        datum = datum_of_file(table.vertical_datum, crs, str(source))
        write_point_table(out, table._replace(crs=_one(table.crs, crs, source), vertical_datum=datum))
    elif kind == "area":
        SurveyArea.read(source, crs=crs, select=select).write(out)
    elif Path(source).suffix.lower() in _TRACKS:
        _places(source, Path(out), crs)
    else:
        _track(Trajectory.read(source, projected_crs(crs, str(source))), Path(out))


def _raster(source: str | Path, out: str | Path, crs: Any, units: str | None) -> None:
    header = raster_header(source)
    if math.prod(header.shape) > LARGEST_CELLS:
        convert_in_windows(source, out, projected_crs(_one(header.crs, crs, source), str(source)), units)
        return
    first = read_raster(source, units=units)
    names = band_names(source)
    bands = [first.values] + [
        read_raster(source, band=k, units=units).values for k in range(2, band_count(source) + 1)
    ]
    system = _one(first.crs, crs, source)
    datum = datum_of_file(first.vertical_datum, crs, str(source))
    write_raster(out, dict(zip(names, bands, strict=True)), first.transform, system, datum)


def _track(path: Trajectory, out: Path) -> None:
    suffix = out.suffix.lower()
    if suffix == ".tum":
        write_tum(out, np.column_stack([path.time_s, path.position, path.quaternion]))
    elif suffix == ".txt":
        turn = Rotation.from_quat(path.quaternion).as_matrix()
        write_kitti(out, np.concatenate([turn, path.position[:, :, None]], axis=2))
    elif suffix in _TRACKS:
        write_track(out, path.time_s, path.position, path.crs)
    else:
        raise InputError(
            f"{out.name} ends in {suffix!r}; a track is written as .tum, .txt (KITTI), .gpx or .gpkg."
        )


def _places(source: str | Path, out: Path, crs: Any) -> None:
    """Write a track that has times and places, but no attitudes."""
    if out.suffix.lower() not in _TRACKS:
        raise InputError(
            f"{source} holds places without attitudes, and {out.name} needs both; export the trajectory.csv that firnline "
            "localize writes beside track.gpkg, or write .gpx or .gpkg."
        )
    stated = track_crs(source)
    if stated is not None and stated.is_geographic:
        degrees = read_track(source, stated)[1]
        working = (
            chosen_crs(degrees[:1, 0], degrees[:1, 1], stated) if crs is None else projected_crs(crs, "--crs")
        )
    else:
        working = projected_crs(_one(stated, crs, source), str(source))
    write_track(out, *read_track(source, working), working)


def _one(stated: Any, named: Any, source: str | Path) -> Any:
    return agreed_crs(stated, named, str(source))


ContentKind = Literal["raster", "route", "points", "track", "area", "stac"]
_RASTERS = (".tif", ".tiff", ".asc", ".nc")
_CLOUDS = (".las", ".laz", ".ply")
# Endings of routes whose files may hold something else.
_SHARED = (".csv", ".geojson", ".gpkg", ".json", ".kml", ".kmz")
_TRACK = {"time_s", "x_m", "y_m", "z_m", "qw", "var_xx_m2"}
_ROUTE = {"leg", "kind", "rover", "easting_m", "northing_m"}


def kind_of(source: str | Path, out: str | Path) -> ContentKind:
    """Return what a file holds, by its ending and that of the file to write, else by its content.

    The columns of a text table decide, and the geometries of a vector file: lines are a route,
    polygons an area, points alone are points.

    >>> kind_of("map.nc", "map.tif"), kind_of("path.tum", "path.gpx"), kind_of("survey.plan", "a.kml")
    ('raster', 'track', 'route')
    """
    endings = Path(source).suffix.lower(), Path(out).suffix.lower()
    if endings[1] in _RASTERS:
        return "raster"
    if endings[0] in _RASTERS and endings[1] == ".json":
        return "stac"
    if endings[0] in _CLOUDS or endings[1] in _CLOUDS:
        return "points"
    if ".tum" in endings:
        return "track"
    if endings[0] in READERS and endings[0] not in _SHARED:
        return "route"
    return _kind_of_table(Path(source)) if endings[0] == ".csv" else _kind_of_features(Path(source))


def _kind_of_table(path: Path) -> ContentKind:
    """Return the kind whose columns the first line names; other tables hold points."""
    with existing_file(path, "the file").open(encoding="utf-8-sig", errors="replace") as text:
        columns = {cell.strip().strip('"') for cell in text.readline().split(",")}
    if columns >= _TRACK:
        return "track"
    return "route" if columns >= _ROUTE else "points"


def _kind_of_features(path: Path) -> ContentKind:
    """Return the kind that the geometries of a vector file stand for."""
    types = geometry_types(path, what="the file")
    if "LineString" in types:
        return "route"
    return "area" if "Polygon" in types else "points"

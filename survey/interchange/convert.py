"""Convert rasters, points, tracks and areas from one file format to another, values and CRS unchanged."""

import math
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from survey.core.crs.agreement import agreed_crs
from survey.core.crs.checks import projected_crs
from survey.core.crs.choice import chosen_crs
from survey.core.crs.vertical_datum import datum_of_file
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.parts.point_columns import projected_table
from survey.data.trajectory import Trajectory
from survey.io.points.formats import read_point_table, write_point_table
from survey.io.pose_files import write_kitti, write_tum
from survey.io.raster import (
    LARGEST_CELLS,
    band_count,
    band_names,
    raster_header,
    read_raster,
    write_raster,
)
from survey.io.raster.large.conversion import convert_in_windows
from survey.io.tracks import read_track, track_crs, write_track

_TRACKS = (".gpx", ".gpkg")
FileKind = Literal["raster", "points", "track", "area"]


def convert(source: str | Path, out: str | Path, kind: FileKind, *, crs: Any = None) -> None:
    """Write what a file holds in the format that the other's ending names.

    Parameters
    ----------
    source, out : str or pathlib.Path
        Rasters are read from whatever GDAL knows and written as .tif, .asc or .nc; points as .csv, .gpkg,
        .geojson, .las, .laz or .ply; trajectories (.csv, .tum) as .tum, .txt (KITTI), .gpx or .gpkg; tracks of
        places (.gpx, .gpkg) as .gpx or .gpkg; areas
        as .geojson, .gpkg, .kml or .shp.
    kind : {"raster", "points", "track", "area"}
        What the source holds.
    crs : str or pyproj.CRS, optional
        Of files that carry none; for areas, the projected CRS to write in.

    Raises
    ------
    InputError
        A source that is damaged or names no CRS, an ending that no format has.
    """
    if kind == "raster":
        _raster(source, out, crs)
    elif kind == "points":
        table = projected_table(read_point_table(source), crs, str(source))
        datum = datum_of_file(table.vertical_datum, crs, str(source))
        write_point_table(out, table._replace(crs=_one(table.crs, crs, source), vertical_datum=datum))
    elif kind == "area":
        SurveyArea.read(source, crs=crs).write(out)
    elif Path(source).suffix.lower() in _TRACKS:
        _places(source, Path(out), crs)
    else:
        _track(Trajectory.read(source, projected_crs(crs, str(source))), Path(out))


def _raster(source: str | Path, out: str | Path, crs: Any) -> None:
    header = raster_header(source)
    if math.prod(header.shape) > LARGEST_CELLS:
        convert_in_windows(source, out, projected_crs(_one(header.crs, crs, source), str(source)))
        return
    first = read_raster(source)
    names = band_names(source)
    bands = [first.values] + [read_raster(source, band=k).values for k in range(2, band_count(source) + 1)]
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

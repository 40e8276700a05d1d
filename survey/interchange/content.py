"""Kind of content of a file: raster, route, points, track or area."""

from pathlib import Path
from typing import Literal

from survey.core.files.reading import existing_file
from survey.interchange.route_readers import READERS
from survey.io.vector import geometry_types

ContentKind = Literal["raster", "route", "points", "track", "area"]
_RASTERS = (".tif", ".tiff", ".asc", ".nc")
_CLOUDS = (".las", ".laz", ".ply")
# Endings of routes whose files may hold something else.
_SHARED = (".csv", ".geojson", ".gpkg", ".json", ".kml")
_TRACK = {"time_s", "x_m", "y_m", "z_m", "qw", "var_xx_m2"}
_ROUTE = {"leg", "kind", "rover", "easting_m", "northing_m"}


def kind_of(source: str | Path, out: str | Path) -> ContentKind:
    """Return what a file holds, by its ending and that of the file to write, else by its content.

    The columns of a text table decide, and the geometries of a vector file: lines are a route,
    polygons an area, points alone are points.

    Parameters
    ----------
    source : str or pathlib.Path
        The file; read where its ending stands for several kinds.
    out : str or pathlib.Path
        The file to write; only its ending is used.

    Returns
    -------
    {"raster", "route", "points", "track", "area"}
        What `source` holds.

    Raises
    ------
    InputError
        The content decides, and the file is missing, empty or damaged.

    Examples
    --------
    >>> kind_of("map.nc", "map.tif"), kind_of("path.tum", "path.gpx"), kind_of("survey.plan", "a.kml")
    ('raster', 'track', 'route')
    """
    endings = Path(source).suffix.lower(), Path(out).suffix.lower()
    if endings[1] in _RASTERS:
        return "raster"
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

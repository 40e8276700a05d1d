"""Reference of file formats, from the registries of readers and writers and the columns of the tables."""

from collections.abc import Iterable
from dataclasses import fields

from generate.models import unit_by_name
from generate.tables import code, table
from survey.data.sensors.odometry import DriveTies, LoopClosures
from survey.data.sensors.records import Barometer, Compass, GpsFixes, Inertial, SensorRecords, Weather, Wheels
from survey.data.sensors.stakes import StakeSightings
from survey.data.surface_points import COVARIANCE, ORIGIN
from survey.data.trajectory import _COLUMNS as TRAJECTORY
from survey.interchange.route_readers import READERS
from survey.interchange.route_writers import _CSV_COLUMNS as ROUTE
from survey.interchange.route_writers import WRITERS
from survey.io.column_names import SPELLINGS
from survey.io.file_kinds import RASTER_DRIVERS, VECTOR_SUFFIXES
from survey.io.point_files import READ_ENDINGS as POINTS
from survey.io.point_files import WRITERS as POINT_WRITERS
from survey.io.point_table import PLACE, SIGMA
from survey.io.trajectory_files import TUM_COLUMNS
from survey.scoring.differencing.change_files import BAND_COLUMNS as BANDS
from survey.scoring.differencing.change_files import TABLE_COLUMNS as CHANGE
from survey.scoring.differencing.cloud_change import POINT_COLUMNS

_HEAD = """\
# File formats

Names of columns end in their unit. Coordinates in degrees are projected to their UTM zone (polar stereographic beyond
84° N and 80° S) unless `--crs` or another file names a projected CRS. Heights stay above the datum of their file.
`firnline help formats` prints a summary.

"""
_RECORDS = (GpsFixes, Barometer, Wheels, Inertial, Compass, Weather, StakeSightings, LoopClosures, DriveTies)

_LIDAR = """\
### LiDAR scans

A folder `lidar` with `scanner.json` (beams, columns per turn, duration of a turn, mounting, stated errors), `scans.csv`
(`time_s`, when each turn begins) and `minute-NNNN.npz` for each minute: number of the scan, column, number of the beam and
range [mm] of each return.
"""


def pages() -> dict[str, str]:
    """Return the page of file formats."""
    parts = [_HEAD, rasters(), vectors(), points(), routes(), paths(), sensors(), changes(), spellings()]
    return {"reference/file-formats.md": "\n".join(parts)}


def rasters() -> str:
    """Return the section on rasters."""
    rows = [
        (code(suffix), driver, "yes" if suffix in (".tif", ".asc", ".nc") else "")
        for suffix, driver in RASTER_DRIVERS.items()
    ]
    text = (
        "## Elevation rasters\n\nNorth-up, square cells, in metres or degrees. A file is opened by the driver of its ending. "
        "`dem.tif` of a reconstruction is a cloud-optimized GeoTIFF with the elevation [m] in band 1 and its standard "
        "deviation [m] in band 2; `support.tif` holds the categories of support.\n\n"
    )
    return text + table(("ending", "GDAL driver", "written too"), rows)


def vectors() -> str:
    """Return the section on areas."""
    endings = ", ".join(code(suffix) for suffix in VECTOR_SUFFIXES)
    return (
        f"## Areas and outlines\n\nRead: {endings}. Written: `.geojson`, `.gpkg`, `.kml`, `.shp`. Polygons are the area; "
        "polygons whose attribute `role` is `no-go` are left out of it; points (`role` = `start`) are starts of rovers.\n"
    )


def points() -> str:
    """Return the section on points."""
    read, written = (", ".join(map(code, endings)) for endings in (POINTS, POINT_WRITERS))
    text = f"## Points\n\nRead: {read}. Written: {written}.\n\n"
    rows = [
        *described(PLACE, "easting, northing and height"),
        *described([SIGMA], "standard deviation of the height"),
    ]
    rows += described(COVARIANCE, "covariance of the place, instead of the standard deviation")
    rows += described(ORIGIN, "place of the sensor that saw the point; needed for lines of sight")
    return text + table(("column", "unit", "meaning"), rows)


def routes() -> str:
    """Return the section on routes."""
    endings = sorted({*READERS, *WRITERS})
    rows = [(code(end), "yes" if end in READERS else "", "yes" if end in WRITERS else "") for end in endings]
    columns = table(("column of `.csv`", "unit"), [(code(name), unit_by_name(name)) for name in ROUTE])
    return "## Routes\n\n" + table(("ending", "read by `read_plan`", "written"), rows) + "\n" + columns


def paths() -> str:
    """Return the section on trajectories."""
    rows = [(code(name), unit_by_name(name)) for name in TRAJECTORY]
    return (
        "## Paths\n\n`trajectory.csv` has one pose in a row, with the covariance of the position; the quaternion turns the "
        f"body (x forward, y left, z up) into the CRS. `.tum` has {', '.join(map(code, TUM_COLUMNS))}, separated by blanks. "
        "`trajectory.error.npz` holds the error that poses share. Also `.gpx`, `.gpkg`, and KITTI's 12 numbers (`.txt`).\n\n"
        + table(("column of `trajectory.csv`", "unit"), rows)
    )


def sensors() -> str:
    """Return the section on the tables of a recording."""
    parts = ["## Tables of a recording\n\nTimes in seconds, body frame x forward, y left, z up.\n"]
    for kind in _RECORDS:
        names = [name for field in fields(kind) for name in kind.COLUMNS.get(field.name, (field.name,))]
        rows = [(code(name), unit_by_name(name)) for name in names]
        summary = " ".join((kind.__doc__ or "").split("\n\n")[0].split()).replace("``", "`")
        parts.append(f"### {title(kind)}\n\n{summary}\n\n" + table(("column", "unit"), rows))
    return "\n".join([*parts, _LIDAR])


def title(kind: type[SensorRecords]) -> str:
    """Return the heading of a table of records."""
    return kind.WHAT.capitalize()


def changes() -> str:
    """Return the section on changes between surveys."""
    names = (CHANGE, BANDS, POINT_COLUMNS)
    rows, bands, points_of_clouds = ([(code(name), unit_by_name(name)) for name in one] for one in names)
    return (
        "## Changes\n\n`change.csv` has one row for each outline, and so has `change.gpkg`.\n\n"
        + table(("column", "unit"), rows)
        + "\n`change_bands.csv` has one row for each elevation band of an outline.\n\n"
        + table(("column", "unit"), bands)
        + "\n`change_points.csv` and `.laz` of two point clouds have one row for each core point.\n\n"
        + table(("column", "unit"), points_of_clouds)
    )


def spellings() -> str:
    """Return the section on names of columns that are recognised."""
    rows = [(code(name), ", ".join(code(word) for word in words)) for name, words in SPELLINGS.items()]
    return (
        "## Names of columns that are recognised\n\nTables of points and checkpoints may come from a receiver or a spreadsheet. "
        "Capitals, blanks and marks between words do not matter; `--columns` names others.\n\n"
        + table(("meaning", "spellings"), rows)
    )


def described(names: Iterable[str], meaning: str) -> list[tuple[str, str, str]]:
    """Return rows of columns that share a meaning."""
    return [(code(name), unit_by_name(name), meaning) for name in names]

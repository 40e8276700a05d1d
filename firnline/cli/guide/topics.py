"""``firnline help``: topics such as file formats and exit codes, and the help of commands."""

from typing import Annotated

import typer
from typer.core import TyperGroup

from firnline.cli.outcome import with_exit_codes

_EXIT_CODES = """\
0    done
1    internal fault; the message names how to print the traceback for a report
2    wrong usage of the command line
3    bad input or output: the message names the file and what to do
4    bad configuration: the message names the setting
5    done, but the wanted class was not met
130  interrupted; the same command continues
141  the reader of the output closed it"""


@with_exit_codes
def help_(
    context: typer.Context,
    topic: Annotated[
        str | None, typer.Argument(help="formats, exit-codes, settings, or the name of a command.")
    ] = None,
) -> None:
    """Explain a topic: file formats, exit codes, settings, or a command.

    For example:

      firnline help formats

      firnline help plan
    """
    topics = {"formats": _formats, "exit-codes": lambda: _EXIT_CODES, "settings": _settings}
    wanted = (topic or "").lower().replace("_", "-")
    if topic is None:
        typer.echo(f"topics: {', '.join(topics)}, and the name of every command (firnline --help lists them)")
        return
    if wanted in topics:
        typer.echo(topics[wanted]())
        return
    typer.echo(_command_help(context, wanted))


def _command_help(context: typer.Context, name: str) -> str:
    """Return the help of a command."""
    root = context.find_root()
    commands = root.command.commands if isinstance(root.command, TyperGroup) else {}
    if name not in commands:
        from survey.core.errors import ConfigError

        raise ConfigError(
            f"there is no topic or command {name!r}; take formats, exit-codes, settings or one of {', '.join(commands)}."
        )
    command = commands[name]
    with type(context)(command, info_name=name, parent=root) as inner:
        return str(command.get_help(inner))


def _formats() -> str:
    """Return what is read and written, by kind of data."""
    from survey.interchange.route_readers import READERS
    from survey.interchange.route_writers import WRITERS
    from survey.io.file_kinds import RASTER_DRIVERS, VECTOR_SUFFIXES
    from survey.io.point_files import READ_ENDINGS as POINTS
    from survey.io.point_files import WRITERS as POINT_WRITERS

    rows = {
        "elevation rasters, read": ", ".join(RASTER_DRIVERS),
        "elevation rasters, written": ".tif (cloud-optimized GeoTIFF), .asc, .nc",
        "areas, read": ", ".join(VECTOR_SUFFIXES),
        "areas, written": ".geojson, .gpkg, .kml, .shp",
        "routes, read": ", ".join(sorted(READERS)),
        "routes, written": ", ".join(sorted(WRITERS)),
        "plans, written": ".geojson, .gpkg (route), .pdf (sheets), .qgz (QGIS project)",
        "points, read": f"{', '.join(POINTS)}; .xyz without a header, too",
        "points, written": ", ".join(POINT_WRITERS),
        "checkpoints": ".csv, .txt, .tsv (also GNSS exports with , ; tab or blanks, and decimal commas), .gpx, and other formats of points",
        "land cover (score --by)": "rasters of whole numbers; polygons with a column of classes",
        "reports (score, change)": "a folder, .html or .pdf",
        "tracks": ".csv, .tum, .gpx, .gpkg; .txt (KITTI) is written",
        "images and sensors": "folders of images (times in names, EXIF or a list); TUM, EuRoC, KITTI, ROS 1 and ROS 2 bags",
        "fixes (localize --gps)": "NMEA, u-blox .ubx, Android GnssLogger .txt, RTKLIB .pos, .gpx, .csv (usual names, or --columns)",
        "calibrations": "camera.toml (firnline calibrate writes one), YAML of ROS, OpenCV, Kalibr, ORB-SLAM",
        "missions and studies": ".toml (firnline init writes one)",
    }
    lines = [f"{name:<27} {endings}" for name, endings in rows.items()]
    notes = [
        "",
        "Coordinates in degrees are projected to their UTM zone (polar stereographic beyond 84° N and 80° S)",
        "unless --crs or another file names a projected CRS. Heights stay above the datum of their file.",
    ]
    return "\n".join([*lines, *notes])


def _settings() -> str:
    return (
        "firnline init my-survey.toml writes every setting of a mission with meaning, unit and default.\n"
        "--set KEY=VALUE overrides one, as in --set planner.swaths=6 --set rover.speed_m_s=1.5;\n"
        "an unknown key is refused with the nearest known one."
    )

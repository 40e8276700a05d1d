"""Table of the algorithms: the command of each, its inputs by option, and what it writes. It needs no QGIS."""

from typing import NamedTuple


class Input(NamedTuple):
    """Input of a command.

    `kind`: raster, polygons, lines, points, file, crs, number or text. `option`: how the command takes it; an argument
    where it is empty.
    """

    name: str
    title: str
    kind: str
    option: str = ""
    is_optional: bool = True


class Output(NamedTuple):
    """What a command writes.

    `kind`: lines for a layer, folder, or a filter of files. `layers`: layers in the folder by their titles, which are
    loaded.
    """

    title: str
    kind: str
    option: str = "-o"
    layers: tuple[tuple[str, str], ...] = ()


class Command(NamedTuple):
    """A command of firnline as an algorithm; `name` is its id in QGIS, `words` begin its command line."""

    name: str
    title: str
    description: str
    words: tuple[str, ...]
    inputs: tuple[Input, ...]
    output: Output | None = None
    flags: tuple[str, ...] = ()


_CRS = Input("CRS", "CRS of input that states none", "crs", "--crs")
_AREA = Input("AREA", "Only inside these polygons", "polygons", "--area")

COMMANDS = (
    Command(
        "plan",
        "Plan a survey",
        "Plan the route of a survey of an area. With a coarse elevation model the error of the map is predicted. Name the "
        "number of swaths, or the error to reach.",
        ("plan",),
        (
            Input("SITE", "Survey area", "polygons", is_optional=False),
            Input("PRIOR", "Coarse elevation model", "raster", "--prior"),
            Input("SWATHS", "Number of swaths", "number", "--swaths"),
            Input("SPACING", "Distance between samples across the area [m]", "number", "--spacing"),
            Input("REQUIRE", "Error of the map to guarantee [m]", "number", "--require"),
            Input("MAX_SLOPE", "Steepest ground for the rover [deg]", "number", "--max-slope"),
            Input("ROVERS", "Number of rovers", "number", "--rovers"),
        ),
        Output("Route", "lines"),
        ("--force", "--no-pictures"),
    ),
    Command(
        "reconstruct",
        "Map terrain from points",
        "Reconstruct terrain with its standard deviation from points: tables, LAS or LAZ, vector files.",
        ("reconstruct",),
        (
            Input("POINTS", "Points (CSV, LAS, LAZ, GeoPackage ...)", "file", is_optional=False),
            Input("PRIOR", "Coarse elevation model", "raster", "--prior"),
            Input("GRID", "Distance between nodes [m]", "number", "--grid"),
            Input("SIGMA", "Standard deviation of heights that state none [m]", "number", "--sigma"),
            _AREA,
            _CRS,
        ),
        Output("Folder of the map", "folder", layers=(("Elevation", "dem.tif"), ("Support", "support.tif"))),
        ("--force", "--no-pictures"),
    ),
    Command(
        "scoreraster",
        "Score a map by a reference",
        "Judge a map by a finer and more accurate elevation model: errors, class and coverage of the standard deviation.",
        ("score",),
        (
            Input("MAP", "Map", "raster", is_optional=False),
            Input("TRUTH", "Reference", "raster", "--truth", is_optional=False),
            _AREA,
        ),
    ),
    Command(
        "scorecheckpoints",
        "Score a map at checkpoints",
        "Judge a map at independently measured points by the standards of ASPRS and NSSDA.",
        ("score",),
        (
            Input("MAP", "Map", "raster", is_optional=False),
            Input(
                "CHECKPOINTS", "Checkpoints (CSV, GeoPackage ...)", "file", "--checkpoints", is_optional=False
            ),
            Input("SIGMA", "Standard deviation of checkpoints that state none [m]", "number", "--sigma"),
        ),
    ),
    Command(
        "change",
        "Change between two surveys",
        "Compute the change of elevation, volume and mass between two surveys, with their standard deviations.",
        ("change",),
        (
            Input("LATER", "Later survey", "raster", is_optional=False),
            Input("EARLIER", "Earlier survey", "raster", is_optional=False),
            Input("OUTLINE", "Outlines of glaciers", "polygons", "--outline"),
            Input("STABLE", "Ground that did not change", "polygons", "--stable"),
            Input("DENSITY", "Density of the material [kg/m3]", "number", "--density"),
        ),
        Output("Folder of the change", "folder", layers=(("Change of elevation", "change.tif"),)),
        ("--force", "--no-pictures"),
    ),
    Command(
        "exportroute",
        "Export a route",
        "Write a route as a mission of an autopilot (.plan), GPX or KML.",
        ("export",),
        (
            Input("ROUTE", "Route", "lines", is_optional=False),
            Input("AREA", "Area, for the fence of a mission", "polygons", "--area"),
            Input("DEM", "Elevation model, for heights", "raster", "--dem"),
            Input("SPEED", "Speed of the rover [m/s]", "number", "--speed"),
        ),
        Output("File", "QGroundControl (*.plan);;GPX (*.gpx);;KML (*.kml)", ""),
        ("--force",),
    ),
)

"""Requests of maps, missions and studies, and the options that several requests have.

The modules of these actions load much, and the command line reads the requests at its start, so that they stand here.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from firnline.actions.interface import Argument, Option
from survey.core import ConfigError, PictureKind

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from survey.reporting.rendering import PictureForm

RUNS = Path("results/runs")

Runs = Annotated[Path, Option("--runs", help="Folder that holds all runs.")]
RatesFile = Annotated[
    Path | None,
    Option(
        "--rates", help="Rates of people and rovers (TOML); person-days and cost are stated beside the time."
    ),
]
Settings = Annotated[
    list[str], Option("--set", metavar="KEY=VALUE", help="Override a setting, e.g. planner.swaths=6.")
]
Select = Annotated[
    list[str],
    Option(
        "--select",
        metavar="NAME|COLUMN=VALUE",
        help="Which outlines of the file, such as RGIId=RGI60-11.00897; * stands for any letters; may be repeated.",
    ),
]
Above = Annotated[
    float | None,
    Option("--above", help="Only ground of the area above this height of the prior [m]; needs --prior."),
]
Below = Annotated[
    float | None,
    Option(
        "--below",
        help="Only ground of the area below this height of the prior [m], such as the tongue of a glacier; needs --prior.",
    ),
]
Details = Annotated[
    list[str],
    Option(
        "--detail",
        metavar="NAME=VALUE",
        help="What the report states beside: project, client, instrument, map-date or check-date; may be repeated.",
    ),
]
_DETAILS = {
    "project": "Project", "client": "Client", "instrument": "Instrument",
    "map-date": "Date of the map", "check-date": "Date of the check survey",
}  # fmt: skip


def stated_details(details: list[str]) -> dict[str, str]:
    """Return the rows of a report that ``--detail`` states, in the order of their titles' table."""
    given = dict(detail.partition("=")[::2] for detail in details)
    for detail in details:
        name, _, value = detail.partition("=")
        if name not in _DETAILS or not value.strip():
            raise ConfigError(
                f"--detail {detail!r} is no detail of a report; NAME=VALUE was expected, with one of the names {', '.join(_DETAILS)}."
            )
    return {title: given[name].strip() for name, title in _DETAILS.items() if name in given}


Pictures = Annotated[
    PictureKind,
    Option(
        "--pictures", help="Format of pictures: png, pdf or svg; the last two for print, with their fonts."
    ),
]


@dataclass(frozen=True, kw_only=True)
class PictureOptions:
    """Options of the actions that draw pictures beside their results."""

    no_pictures: Annotated[bool, Option("--no-pictures", help="Draw no pictures beside the results.")] = False
    pictures: Pictures = "png"

    def write_pictures(self, folder: Path, draw: Callable[[], Mapping[str, "Figure"]]) -> None:
        """Write figures into a folder, each under its name in the chosen format, unless none are wanted."""
        if self.no_pictures:
            return
        from survey.figures.style import write_pictures

        write_pictures(folder, draw(), self.pictures)


Workers = Annotated[
    int | None,
    Option(
        "--workers",
        min=1,
        help="Processes of drives with images: up to 2 for one rover, one for each rover of a fleet; as many as cores when left out.",
    ),
]


def columns_option(help_: str) -> Any:
    """Return the option that chooses the columns of a table of text."""
    return Option("--columns", metavar="KEY=COLUMN,…", help=help_)


Lengths = Annotated[
    str | None,
    Option(
        "--units",
        metavar="m|ft|us-ft",
        help="Unit of heights in files that state none; feet are converted to metres, and results are printed in both.",
    ),
]
Product = Annotated[
    str | None,
    Option(
        "--product",
        help="Class of the prior, which sets what errors to expect: copernicus-30, srtm-90, aster-30, arcticdem-2, "
        "unknown, or unbiased for exact level and independent errors.",
    ),
]
Layout = Annotated[
    str | None,
    Option(
        "--format",
        metavar="pnezd|penz|xyz",
        help="Order of the columns of a table, one letter each: p point, n northing, e easting, z height, d description, s "
        "standard deviation; --columns takes positions too (z=4).",
    ),
]


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of the actions that do stages of a mission."""

    runs: Runs = RUNS
    settings: Settings = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class ExecutionOptions:
    """Options of the actions that do many independent runs."""

    engine: Annotated[str, Option("--engine", help="serial, processes (of this machine) or dask.")] = (
        "processes"
    )
    workers: Annotated[
        int | None, Option("--workers", min=1, help="Number of processes; one for each core when left out.")
    ] = None
    scheduler: Annotated[str | None, Option("--scheduler", help="A dask scheduler, tcp://host:port.")] = None

    def chosen_engine(self) -> Any:
        """Return the engine; a scheduler is one of dask."""
        if self.engine not in ("serial", "processes", "dask"):
            raise ConfigError(f"there is no engine {self.engine!r}; take serial, processes or dask.")
        return "dask" if self.scheduler else self.engine


def epoch_option(help_: str) -> Any:
    """Return the option for the moment of a map or path on moving ice."""
    return Option("--epoch", help=help_)


def antenna_option() -> Any:
    """Return the option for the height of a receiver's antenna above the ground."""
    return Option("--antenna", min=0.0, help="Height of the receiver's antenna above the ground [m].")


Url = Annotated[
    str,
    Argument(
        metavar="URL",
        help="udp://HOST:PORT sends to a vehicle, udpin://HOST:PORT waits for one that sends there; also tcp://HOST:PORT, "
        "serial:///dev/DEVICE:BAUD.",
    ),
]
Patience = Annotated[
    float, Option("--patience", min=0.5, help="Time after which a silent vehicle counts as lost [s].")
]
System = Annotated[
    int | None,
    Option("--system", min=1, max=255, help="MAVLink system id; by default the first that is heard."),
]


@dataclass(frozen=True, kw_only=True)
class ReconstructRequest(RunOptions, PictureOptions):
    """What is to be mapped; None stands for an option that was not given."""

    sources: Annotated[
        list[Path],
        Argument(
            help="Points (text tables, vector files, LAS/LAZ, PLY), logs of receivers (.ubx, NMEA, .gpx, .pos, GrafNav, .ulg, .tlog), a mission file (TOML), LiDAR scans and folders of them "
            "(npz, LAS/LAZ, PLY, KITTI, ROS 2) for carving, emap and field, or scans in the sensor's frame (recording, "
            "KITTI, ROS 2) with --trajectory for all methods.",
            reads={".toml": "the configuration"}
            | dict.fromkeys((".csv", ".tsv", ".txt", ".xyz"), "the point file"),
        ),
    ]
    prior: Annotated[
        Path | None, Option("--prior", help="Coarse elevation raster to build around.", reads="the raster")
    ] = None
    product: Product = None
    step_m: Annotated[
        float | None,
        Option("--grid", help="Distance between the nodes of the map [m]; 1, and 0.25 for scans."),
    ] = None
    area: Annotated[
        Path | None, Option("--area", help="Polygon file to map; without it the bounding box of the points.")
    ] = None
    select: Select = field(default_factory=list)
    above: Above = None
    below: Below = None
    method: Annotated[
        str | None,
        Option(
            "--method",
            help="gp, joint, dense or tin; carving, emap or field for scans.  [default: gp or tin]",
        ),
    ] = None
    value: Annotated[
        str | None, Option("--value", help="Map this sampled quantity instead of elevation.")
    ] = None
    crs: Annotated[str | None, Option("--crs", help="CRS of points that carry none, e.g. EPSG:32608.")] = None
    sigma_m: Annotated[
        float | None, Option("--sigma", help="Standard deviation of points that state none [m].")
    ] = None
    antenna_m: Annotated[float | None, antenna_option()] = None
    columns: Annotated[
        list[str],
        columns_option("Columns of a table of points: x, y, z, lon, lat, sigma_z; usual names are found."),
    ] = field(default_factory=list)
    layout: Layout = None
    units: Lengths = None
    ground: Annotated[
        Literal["auto", "all", "classified"],
        Option(
            "--ground",
            help="Points of LAS/LAZ to map: auto takes the classified ground, or filters it where no point is classified as ground; "
            "classified refuses such files; all takes every point but noise, withheld and synthetic ones.",
        ),
    ] = "auto"
    adjust_strips: Annotated[
        bool,
        Option(
            "--adjust-strips",
            help="Remove the errors of overlapping strips (the point source of LAS/LAZ, or a column strip) before mapping.",
        ),
    ] = False
    trajectories: Annotated[
        list[Path],
        Option(
            "--trajectory",
            help="Path that the points were seen from: trajectory.csv with its trajectory.error.npz for the method joint "
            "and for scans in the sensor's frame (one for each source, in their order), TUM for scans that do not state where the scanner was.",
        ),
    ] = field(default_factory=list)
    ties: Annotated[
        Path | None,
        Option(
            "--ties",
            help="With --method joint and several drives: places that two of them saw from above (ties.csv); drives are "
            "numbered from 0 in the order of the sources.",
        ),
    ] = None
    epoch_s: Annotated[
        float | None,
        epoch_option(
            "With --method joint on moving ice, whose motion stands beside the trajectory: the time of which the map is, in "
            "seconds of the recording; that of localization when left out."
        ),
    ] = None
    rays: Annotated[
        bool,
        Option(
            "--rays", help="Let lines of sight to the ground bound the map from above, and draw its bounds."
        ),
    ] = False
    max_slope_deg: Annotated[
        float | None,
        Option(
            "--max-slope",
            help="With --rays: write no_go.tif, the ground that the bounds show to be steeper [deg].",
        ),
    ] = None
    out: Annotated[Path, Option("--out", "-o", help="Folder for dem.tif and reconstruction.json.")] = Path(
        "reconstruction"
    )
    tiles: Annotated[
        bool,
        Option(
            "--tiles",
            help="Map point files of any size (LAS/LAZ, COPC, PLY, Parquet, folders) tile by tile; a killed run goes on by "
            "the same command.",
        ),
    ] = False
    workers: Annotated[
        int | None,
        Option("--workers", min=1, help="With --tiles: processes; one for each core when left out."),
    ] = None
    scheduler: Annotated[
        str | None, Option("--scheduler", help="With --tiles: a dask scheduler, tcp://host:port.")
    ] = None
    control: Annotated[
        Path | None,
        Option("--control", help="With --tiles: control points (GNSS) with their standard deviations."),
    ] = None
    force: Annotated[bool, Option("--force", help="Replace a reconstruction that is there.")] = False

    @property
    def is_mission(self) -> bool:
        """Whether the source is a mission file."""
        return self.sources[0].suffix == ".toml"


@dataclass(frozen=True, kw_only=True)
class PayloadRequest:
    """Logs of a quantity that is to be mapped."""

    logs: Annotated[
        list[Path],
        Argument(
            help="CSV logs of the quantity, one for each drive, with time_s, or easting_m and northing_m."
        ),
    ]
    name: Annotated[str, Option("--name", help="Column of the quantity, e.g. air_temperature.")]
    unit: Annotated[str, Option("--unit", help="Its unit as UDUNITS spells it, e.g. degC or 'W m-2'.")]
    terrain: Annotated[
        Path,
        Option(
            "--terrain",
            help="Elevation, e.g. dem.tif of a reconstruction; the map has its CRS.",
            reads="the raster",
        ),
    ]
    trajectories: Annotated[
        list[Path],
        Option("--trajectory", help="Path of each drive (trajectory.csv), for logs by time; repeat it."),
    ] = field(default_factory=list)
    standard_name: Annotated[
        str | None, Option("--standard-name", help="CF standard name, for the NetCDF file.")
    ] = None
    noise_sd: Annotated[
        float, Option("--noise", min=0.0, help="Noise of a reading (1 σ) that the fit begins with.")
    ] = 0.1
    lag_s: Annotated[
        float, Option("--lag", min=0.0, help="Time constant with which the sensor follows [s].")
    ] = 0.0
    out: Annotated[Path, Option("--out", "-o", help="Folder for GeoTIFF, NetCDF and facts.")] = Path(
        "payload"
    )
    force: Annotated[bool, Option("--force", help="Replace an existing map.")] = False


@dataclass(frozen=True, kw_only=True)
class CountsRequest(PictureOptions):
    """Counts of a detector whose intensity is to be mapped, and whose source is to be found."""

    counts: Annotated[
        Path,
        Argument(
            help="CSV with easting_m, northing_m, counts and exposure_s, and with wind_east_m_s and wind_north_m_s for a plume.",
            reads="the counts",
        ),
    ]
    crs: Annotated[str, Option("--crs", help="CRS of the places, e.g. EPSG:32608.")]
    grid: Annotated[float, Option("--grid", min=0.01, help="Distance between the nodes of the map [m].")] = (
        2.0
    )
    area: Annotated[
        Path | None,
        Option("--area", help="Polygon file to map; without it the bounding box of the counts."),
    ] = None
    limit_per_s: Annotated[
        float | None,
        Option("--limit", help="Intensity [counts/s]; the map gives the probability that it is not reached."),
    ] = None
    source: Annotated[
        Literal["none", "radiation", "plume"],
        Option("--source", help="Find one source: of radiation, or of a plume in the wind."),
    ] = "none"
    height_m: Annotated[float, Option("--height", min=0.0, help="Height of the detector [m].")] = 0.5
    half_life_s: Annotated[
        float | None, Option("--half-life", help="Half-life of what a plume carries [s].")
    ] = None
    radius_m: Annotated[
        float, Option("--radius", min=0.1, help="Radius about the stated place of the source [m].")
    ] = 10.0
    next_from: Annotated[
        str | None,
        Option(
            "--next-from",
            metavar="EASTING,NORTHING",
            help="Place of the rover; the place where the next count says most about the source is printed. Needs --source.",
        ),
    ] = None
    seed: Annotated[int, Option("--seed", help="Seed of the particles of the source.")] = 0
    out: Annotated[Path, Option("--out", "-o", help="Folder for maps, picture and facts.")] = Path("counts")
    force: Annotated[bool, Option("--force", help="Replace an existing map.")] = False


@dataclass(frozen=True, kw_only=True)
class ExtendRequest(PictureOptions):
    """Drive with images and LiDAR scans whose map the images are to extend."""

    recording: Annotated[Path, Argument(help="Recording with images, their calibration and LiDAR scans.")]
    localization: Annotated[
        Path,
        Argument(help="Folder that localize wrote for it: trajectory.csv with its error, landmarks.gpkg."),
    ]
    prior: Annotated[
        Path | None, Option("--prior", help="Coarse elevation model around the drive, such as a satellite's.")
    ] = None
    area: Annotated[
        Path | None,
        Option(
            "--area", help="Polygon file whose bounds are mapped; without it the drive and --reach around it."
        ),
    ] = None
    grid: Annotated[float, Option("--grid", min=0.1, help="Distance between the nodes of the map [m].")] = 1.0
    pixel_m: Annotated[float, Option("--pixel", min=0.02, help="Side of a cell of the orthoimage [m].")] = (
        0.25
    )
    reach_m: Annotated[
        float, Option("--reach", min=15.0, help="Farthest ground whose height is taken from images [m].")
    ] = 45.0
    out: Annotated[
        Path, Option("--out", "-o", help="Folder for map, orthoimage, heights, contradictions and picture.")
    ] = Path("extended")
    force: Annotated[bool, Option("--force", help="Replace an existing map.")] = False


@dataclass(frozen=True, kw_only=True)
class OverhangsRequest(PictureOptions):
    """LiDAR scans of steep walls, undercuts and serac edges whose surface is to be estimated."""

    sources: Annotated[
        list[Path],
        Argument(
            help="Scans that state where the scanner stood (columns origin_x_m, origin_y_m, origin_z_m of LAS, LAZ or PLY, origin of npz), or folders of "
            "them; or scans in the sensor's frame (recording, KITTI, ROS) with --trajectory."
        ),
    ]
    trajectory: Annotated[
        Path | None,
        Option(
            "--trajectory",
            help="Path of the scanner: trajectory.csv for scans in the sensor's frame, TUM for LAS, LAZ and PLY with a time at each point.",
        ),
    ] = None
    area: Annotated[
        Path | None, Option("--area", help="Polygon file; only returns inside are used, all without it.")
    ] = None
    step_m: Annotated[
        float, Option("--grid", min=0.02, help="Distance between the nodes of the surface [m].")
    ] = 0.25
    crs: Annotated[str | None, Option("--crs", help="CRS of scans that name none, e.g. EPSG:32608.")] = None
    units: Lengths = None
    sigma_m: Annotated[
        float | None,
        Option("--sigma", min=0.001, help="Standard deviation of ranges, for files that state none [m]."),
    ] = None
    beam_sigma_deg: Annotated[
        float,
        Option(
            "--beam-sigma",
            min=0.0,
            max=1.0,
            help="Standard deviation of the direction of a beam, for files without covariances [deg].",
        ),
    ] = 0.05
    scan_sigma_m: Annotated[
        float,
        Option(
            "--scan-sigma",
            min=0.0,
            help="Standard deviation of the place of a scan, which all its points share, for files that state none [m].",
        ),
    ] = 0.0
    out: Annotated[Path, Option("--out", "-o", help="Folder for surface, picture and facts.")] = Path(
        "overhangs"
    )
    force: Annotated[bool, Option("--force", help="Replace an existing surface.")] = False


@dataclass(frozen=True, kw_only=True)
class RerouteRequest(PictureOptions):
    """Route of a rover that is to be changed around hazards in the points that it has seen."""

    route: Annotated[
        Path,
        Argument(
            help="Route of one rover: GeoJSON, GeoPackage, KML or another format of plan.", reads="the route"
        ),
    ]
    points: Annotated[
        Path,
        Argument(
            help="Points of the last scans (LAS, LAZ, PLY, CSV); the columns origin_x_m, origin_y_m and origin_z_m say where the scanner stood.",
            reads="the point file",
        ),
    ]
    at: Annotated[
        str | None,
        Option(
            "--at",
            metavar="EASTING,NORTHING",
            help="Place of the rover in the CRS of the route [m]; the start of the route when left out.",
        ),
    ] = None
    area: Annotated[
        Path | None,
        Option("--area", help="Polygon file of the ground that may be driven; without it, all within reach."),
    ] = None
    max_slope_deg: Annotated[
        float, Option("--max-slope", min=0.1, max=89.0, help="Steepest slope that the rover can stand [deg].")
    ] = 25.0
    base_m: Annotated[
        float,
        Option("--base", min=0.25, help="Base of slopes and steps, about the length of the rover [m]."),
    ] = 1.0
    clearance_m: Annotated[
        float, Option("--clearance", min=0.25, help="Distance kept from steep ground [m].")
    ] = 1.1
    accepted: Annotated[
        float,
        Option(
            "--accepted",
            min=0.001,
            max=0.5,
            help="Probability of steep ground that is accepted near the rover.",
        ),
    ] = 0.05
    reach_m: Annotated[
        float,
        Option(
            "--reach",
            min=10.0,
            max=60.0,
            help="Distance from the rover within which the route is changed [m].",
        ),
    ] = 30.0
    crs: Annotated[
        str | None,
        Option(
            "--crs", help="CRS of the points, where the file names none; that of the route when left out."
        ),
    ] = None
    sigma_m: Annotated[
        float,
        Option("--sigma", min=0.001, help="Standard deviation of heights, for files that state none [m]."),
    ] = 0.05
    out: Annotated[Path, Option("--out", "-o", help="Folder for route, probability, picture and facts.")] = (
        Path("reroute")
    )
    force: Annotated[bool, Option("--force", help="Replace an existing result.")] = False


@dataclass(frozen=True, kw_only=True)
class RunRequest(RunOptions):
    """Mission to run, or to continue where it was stopped."""

    mission: Annotated[Path, Argument(help="Mission file (TOML).", reads="the configuration")]
    first: Annotated[
        str | None, Option("--from", metavar="STAGE", help="Repeat this stage and all later ones.")
    ] = None
    until: Annotated[str, Option("--until", metavar="STAGE", help="Stop after this stage.")] = "report"
    fresh: Annotated[bool, Option("--fresh", help="Repeat every stage.")] = False
    require: Annotated[
        bool, Option("--require", help="End with exit code 5 when the wanted class is not met.")
    ] = False
    workers: Workers = None


@dataclass(frozen=True, kw_only=True)
class SimulateRequest(RunOptions):
    """Mission to plan and drive."""

    mission: Annotated[Path, Argument(help="Mission file (TOML).", reads="the configuration")]
    workers: Workers = None
    serve: Annotated[
        bool,
        Option(
            "--serve",
            help="Stream images and sensors in real time, and drive as other programs command (Foxglove WebSocket); the drive "
            "gets a run of its own.",
        ),
    ] = False
    listen: Annotated[
        str | None,
        Option(
            "--listen", metavar="HOST:PORT", help="With --serve: where to listen.  [default: 127.0.0.1:8765]"
        ),
    ] = None
    truth: Annotated[
        bool, Option("--truth", help="With --serve: stream the real pose too, on a topic of its own.")
    ] = False


@dataclass(frozen=True, kw_only=True)
class ReportRequest(RunOptions):
    """Run whose report is to be drawn."""

    source: Annotated[
        Path, Argument(help="A run folder, or a mission file (TOML).", reads={".toml": "the configuration"})
    ]
    pictures: Annotated[
        PictureKind | None,
        Option("--pictures", help="Format of the figures beside the page.  [default: png; pdf with --paper]"),
    ] = None
    paper: Annotated[
        Literal["agu", "copernicus", "ieee"] | None,
        Option("--paper", help="Draw the figures at the column widths of a publisher, for a paper."),
    ] = None
    rates: RatesFile = None

    @property
    def is_usual(self) -> bool:
        """Whether the report is the one that a run draws."""
        return self.pictures in (None, "png") and self.paper is None and self.rates is None

    @property
    def form(self) -> "PictureForm":
        """Format and width of the figures."""
        from survey.reporting.rendering import PictureForm

        return PictureForm(self.pictures or ("png" if self.paper is None else "pdf"), self.paper)

    def field_work(self, plan: Path) -> str:
        """Return days, person-days and cost of a planned route, from its folder; empty without rates."""
        if self.rates is None:
            return ""
        from planners import Rates
        from survey import Route

        route = Route.read(plan / "route.geojson")
        return str(Rates.read(self.rates).field_work(route.prediction["time_s"], route.n_rovers))


@dataclass(frozen=True, kw_only=True)
class InitRequest:
    """Mission file to write."""

    path: Annotated[Path, Argument(help="The mission file to write.")] = Path("mission.toml")
    dem: Annotated[
        Path | None, Option("--dem", help="Survey this fine elevation raster instead of random terrain.")
    ] = None
    force: Annotated[bool, Option("--force", help="Replace an existing file.")] = False


@dataclass(frozen=True, kw_only=True)
class MonteCarloRequest(ExecutionOptions):
    """Study of many random terrains."""

    study: Annotated[Path, Argument(help="Study file (TOML).", reads="the configuration")]
    runs: Annotated[Path, Option("--runs", help="Folder that holds all studies.")] = Path(
        "results/montecarlo"
    )
    fresh: Annotated[bool, Option("--fresh", help="Do every trial again.")] = False
    pictures: Pictures = "png"
    settings: Settings = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class RehearseRequest(RunOptions, ExecutionOptions):
    """Mission to run many times."""

    mission: Annotated[Path, Argument(help="Mission file (TOML).", reads="the configuration")]
    n_runs: Annotated[int, Option("--count", "-n", min=1, help="Number of runs.")] = 50
    pictures: Pictures = "png"

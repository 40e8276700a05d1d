"""``firnline plan``: a route for an area, with a picture and what is expected of it."""

from pathlib import Path
from typing import Annotated

import typer

from sim.cli.options import RUNS, DryRun, Json, Quiet, Runs, Settings, Verbose
from sim.cli.outcome import with_exit_codes
from sim.cli.planning.modes import mode_of
from sim.cli.planning.request import PlanRequest

_Source = Annotated[
    Path, typer.Argument(help="Area (GeoJSON, GeoPackage, KML, Shapefile) or mission file (TOML).")
]
_Prior = Annotated[Path | None, typer.Option("--prior", help="Coarse elevation raster of the area.")]
_Pattern = Annotated[
    str | None,
    typer.Option(
        "--pattern",
        help="Planner, such as lawnmower (default), wavy or best (by predicted error); an unknown name lists all.",
    ),
]
_Swaths = Annotated[
    int | None, typer.Option("--swaths", help="Number of parallel lines; 4 when no size is given.")
]
_Spacing = Annotated[
    float | None,
    typer.Option("--spacing", help="Ground sample spacing: the largest distance between swaths [m]."),
]
_Budget = Annotated[float | None, typer.Option("--budget", help="Metres to drive (best, variance-driven).")]
_Rmse = Annotated[
    float | None, typer.Option("--rmse", help="Predicted error to reach [m] (best, variance-driven).")
]
_Crs = Annotated[
    str | None,
    typer.Option(
        "--crs", help="CRS to plan in, such as EPSG:32608; that of the prior or the file by default."
    ),
]
_Rovers = Annotated[int | None, typer.Option("--rovers", help="Number of rovers that share the area.")]
_MaxSlope = Annotated[
    float | None,
    typer.Option("--max-slope", help="Steepest ground of the prior that the rover may be on [deg]."),
]
_NoGo = Annotated[
    Path | None,
    typer.Option("--no-go", help="Raster that is 1 on no-go ground, as reconstruct writes it."),
]
_Require = Annotated[
    str | None,
    typer.Option(
        "--require", help="Guarantee this: class-1, class-2, class-3 or an RMSE [m]; needs --prior."
    ),
]
_Probability = Annotated[
    float, typer.Option("--probability", help="Probability of the guarantee, above 0.5 and at most 0.999.")
]
_Noise = Annotated[
    float,
    typer.Option("--noise", help="Standard deviation of a sample's height, for the guarantee [m]."),
]
_Localization = Annotated[
    float,
    typer.Option(
        "--localization",
        help="Standard deviation of the rover's position, east and north each, for the guarantee [m].",
    ),
]
_PriorSigma = Annotated[
    float,
    typer.Option("--prior-sigma", help="Standard deviation of a cell of the prior, for the guarantee [m]."),
]
_Assume = Annotated[
    str | None,
    typer.Option(
        "--assume",
        help="Covariance family of the terrain (squared-exponential, matern-5/2, matern-3/2, whittle); by default those of the surface.",
    ),
]
_Surface = Annotated[
    str,
    typer.Option(
        "--surface",
        help="Class of the ground, for the guarantee: bare-ice, snow, moraine, bedrock or unknown.",
    ),
]
_MicroRelief = Annotated[
    float | None,
    typer.Option(
        "--micro-relief",
        help="Standard deviation of relief finer than the samples [m]; that of the surface by default.",
    ),
]
_Shared = Annotated[
    float,
    typer.Option("--shared", help="Standard deviation of an error of height that all samples share [m]."),
]
_MaxSwaths = Annotated[
    int | None,
    typer.Option(
        "--max-swaths", help="Most swaths of a guarantee; by default as many as are two samples apart."
    ),
]
_Joint = Annotated[
    bool,
    typer.Option(
        "--joint",
        help="Predict the errors that the path shares, from its sensors and aiding (--set): numbers of swaths and of stakes.",
    ),
]
_Adaptive = Annotated[
    bool, typer.Option("--adaptive", help="Plan swath by swath: the first two, or the next one.")
]
_Driven = Annotated[Path | None, typer.Option("--driven", help="Route driven so far (adaptive).")]
_Measured = Annotated[Path | None, typer.Option("--measured", help="Points measured so far (adaptive).")]
_Season = Annotated[
    str | None,
    typer.Option(
        "--season",
        help="Design two surveys: half the 95 % interval of the mass balance [m w.e.], such as 0.2, or of the change of volume, such as 5%; needs --prior and --dates.",
    ),
]
_Dates = Annotated[
    str | None,
    typer.Option("--dates", help="Days of both surveys of a season, such as 2026-05-01,2026-09-20."),
]
_Melt = Annotated[
    float | None,
    typer.Option("--melt", help="Mean melt of a day in the season [m w.e.]; that of the surface by default."),
]
_Emergence = Annotated[
    float,
    typer.Option(
        "--emergence",
        help="Standard deviation of the mean vertical motion of the ice over the area [m per year]; 0 for a complete glacier.",
    ),
]
_KmADay = Annotated[float, typer.Option("--km-a-day", help="Distance driven in a day of a season [km].")]
_Out = Annotated[
    Path,
    typer.Option(
        "--out",
        "-o",
        help="Route (.geojson, .gpkg) with its picture beside it, or sheets for printing (.pdf) or a QGIS project (.qgz), with the route and the predicted standard deviation (_sigma.tif) beside them.",
    ),
]
_Force = Annotated[bool, typer.Option("--force", help="Replace the route and its picture where they exist.")]


@with_exit_codes
def plan(
    source: _Source,
    prior: _Prior = None,
    pattern: _Pattern = None,
    swaths: _Swaths = None,
    spacing: _Spacing = None,
    budget: _Budget = None,
    rmse: _Rmse = None,
    crs: _Crs = None,
    rovers: _Rovers = None,
    max_slope: _MaxSlope = None,
    no_go: _NoGo = None,
    require: _Require = None,
    probability: _Probability = 0.9,
    noise: _Noise = 0.1,
    localization: _Localization = 0.0,
    prior_sigma: _PriorSigma = 1.0,
    assume: _Assume = None,
    surface: _Surface = "unknown",
    micro_relief: _MicroRelief = None,
    shared: _Shared = 0.05,
    max_swaths: _MaxSwaths = None,
    joint: _Joint = False,
    adaptive: _Adaptive = False,
    driven: _Driven = None,
    measured: _Measured = None,
    season: _Season = None,
    dates: _Dates = None,
    melt: _Melt = None,
    emergence: _Emergence = 0.0,
    km_a_day: _KmADay = 10.0,
    out: _Out = Path("route.geojson"),
    force: _Force = False,
    runs: Runs = RUNS,
    settings: Settings = None,
    dry_run: DryRun = False,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,
) -> None:
    """Plan the route of a survey.

    Every setting of the sections planner, rover and fleet of a mission file can be set with --set. Ground
    that the rover cannot reach is left out; a warning gives its share, places and reasons. Distances are
    metres on the ground. An existing route or picture is replaced with --force only.

    For example:

      firnline plan site.geojson --prior srtm.tif --swaths 6 -o route.geojson

      firnline plan site.kml --prior srtm.tif --pattern wavy --spacing 50 --max-slope 20

      firnline plan area.kml --prior copernicus.tif -o plan.pdf

      firnline plan site.geojson --no-go map/no_go.tif --swaths 6

      firnline plan site.gpkg --spacing 20 --rovers 3 --set rover.turn_radius_m=2 --set rover.battery_j=4e6

      firnline plan site.gpkg --prior srtm.tif --require class-3 --probability 0.9

      firnline plan glacier.gpkg --prior glo30.tif --require class-3 --surface bare-ice --max-swaths 60

      firnline plan site.gpkg --prior srtm.tif --require class-3 --joint --set aids.base_station=true

      firnline plan site.gpkg --prior srtm.tif --require class-3 --adaptive -o first_two.geojson

      firnline plan site.gpkg --prior srtm.tif --require class-3 --adaptive --driven so_far.geojson --measured so_far.csv

      firnline plan glacier.gpkg --prior glo30.tif --season 0.3 --dates 2026-05-01,2026-09-20 --surface bare-ice

      firnline plan mine.toml

      firnline plan mine.toml --require class-3
    """
    given = dict(locals())
    given |= {"noise_m": given.pop("noise"), "localization_m": given.pop("localization")}
    given |= {"micro_relief_m": given.pop("micro_relief"), "shared_m": given.pop("shared")}
    given |= {"prior_sigma_m": given.pop("prior_sigma"), "settings": tuple(given.pop("settings") or ())}
    given |= {"melt_m_we_day": given.pop("melt"), "emergence_m_year": given.pop("emergence")}
    request = PlanRequest(**given)
    mode = mode_of(request)
    if dry_run:
        from sim.cli.planning.dry_run import print_plan_of

        print_plan_of(request)
        return
    mode(request)

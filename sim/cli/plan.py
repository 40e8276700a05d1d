"""``firnline plan``: a route for an area, with a picture and what is expected of it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sim.cli.options import RUNS, Json, Quiet, Runs, Settings, Verbose
from sim.cli.outcome import refusals_told

if TYPE_CHECKING:
    from sim.cli.plan_promise import Asked


_Source = Annotated[
    Path, typer.Argument(help="Area (GeoJSON, GeoPackage, KML, Shapefile) or mission file (TOML).")
]
_Prior = Annotated[Path | None, typer.Option("--prior", help="Coarse elevation raster of the area.")]
_Pattern = Annotated[
    str,
    typer.Option(
        "--pattern",
        help="lawnmower, wavy, piecewise-continuous, random-wander, variance-driven, or best (by predicted error).",
    ),
]
_Swaths = Annotated[
    int | None, typer.Option("--swaths", help="Number of swaths; 4 when nothing else is asked.")
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
    typer.Option("--no-go", help="Raster that is 1 where nobody is to drive, as reconstruct writes it."),
]
_Require = Annotated[
    str | None,
    typer.Option("--require", help="Promise this: class-1, class-2, class-3 or an RMSE [m]; needs --prior."),
]
_Probability = Annotated[float, typer.Option("--probability", help="How sure the promise is to be.")]
_Noise = Annotated[float, typer.Option("--noise", help="Error of a sample's height, for the promise [m].")]
_Localization = Annotated[
    float,
    typer.Option("--localization", help="Error of the rover's place east and north, for the promise [m]."),
]
_PriorSigma = Annotated[
    float, typer.Option("--prior-sigma", help="Error of a cell of the prior, for the promise [m].")
]
_Assume = Annotated[
    str | None,
    typer.Option(
        "--assume",
        help="Family of the terrain's covariance, where it is known (squared-exponential, matern-5/2, matern-3/2, whittle); else the promise rests on the roughest that the prior does not exclude.",
    ),
]
_Joint = Annotated[
    bool,
    typer.Option(
        "--joint",
        help="Foresee the errors that the rover's path shares, from its sensors and aids (--set): so many swaths with so many stakes.",
    ),
]
_Adaptive = Annotated[
    bool, typer.Option("--adaptive", help="Plan swath by swath: the first two, or the next one.")
]
_Driven = Annotated[Path | None, typer.Option("--driven", help="Route driven so far (adaptive).")]
_Measured = Annotated[Path | None, typer.Option("--measured", help="Points measured so far (adaptive).")]
_Out = Annotated[
    Path,
    typer.Option("--out", "-o", help="Route to write (.geojson, .gpkg); its picture is put beside it."),
]


@refusals_told
def plan(
    source: _Source,
    prior: _Prior = None,
    pattern: _Pattern = "lawnmower",
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
    joint: _Joint = False,
    adaptive: _Adaptive = False,
    driven: _Driven = None,
    measured: _Measured = None,
    out: _Out = Path("route.geojson"),
    runs: Runs = RUNS,
    settings: Settings = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,
) -> None:
    """Plan the route of a survey.

    Everything that a mission file says in its sections planner, rover and fleet can be set with --set. Ground
    that the rover cannot reach is left out; a warning tells its share, places and reasons.

    For example:

      firnline plan site.geojson --prior srtm.tif --swaths 6 -o route.geojson

      firnline plan site.kml --prior srtm.tif --pattern wavy --spacing 50 --max-slope 20

      firnline plan site.geojson --no-go map/no_go.tif --swaths 6

      firnline plan site.gpkg --spacing 20 --rovers 3 --set rover.turn_radius_m=2 --set rover.battery_j=4e6

      firnline plan site.gpkg --prior srtm.tif --require class-3 --probability 0.9

      firnline plan site.gpkg --prior srtm.tif --require class-3 --joint --set aids.base_station=true

      firnline plan site.gpkg --prior srtm.tif --require class-3 --adaptive -o first_two.geojson

      firnline plan site.gpkg --prior srtm.tif --require class-3 --adaptive --driven so_far.geojson --measured so_far.csv

      firnline plan mine.toml

      firnline plan mine.toml --require class-3
    """
    asked = {"swaths": swaths, "spacing_m": spacing, "budget_m": budget, "rmse_m": rmse}
    given = {name: value for name, value in asked.items() if value is not None}
    site = {"prior": prior, "crs": crs, "no_go": no_go}
    limits = {"rovers": rovers, "max_slope": max_slope}
    if source.suffix == ".toml":
        _refuse_beside_a_mission(source, given | site | limits)
        if require is not None:
            _tell_ways(source, require, probability, settings, as_json=as_json)
        else:
            _plan_mission(source, runs, settings, as_json=as_json, quiet=quiet, verbose=verbose)
    elif require is not None:
        from sim.cli.plan_promise import Asked

        others = limits | {"pattern": pattern, "settings": None if joint else settings}
        _refuse_beside_a_promise(given, **others)
        promise = Asked(require, probability, noise, localization, prior_sigma, assume, driven, measured)
        sought = (source, prior, crs, no_go)
        _promise(*sought, promise, settings or [], out, joint=joint, adaptive=adaptive, as_json=as_json)
    else:
        from sim.cli.plan_area import plan_area, read_area, tell_route

        wanted = _wanted({"pattern": pattern, **(given or {"swaths": 4})}, rovers, max_slope)
        area, dem = read_area(source, prior, crs, no_go)
        route = plan_area(area, dem, wanted, settings or [], out, quiet=quiet)
        tell_route(route, out, as_json=as_json)


def _refuse_beside_a_mission(source: Path, given: dict[str, Any]) -> None:
    """Refuse what a mission says itself."""
    from survey.core.errors import ConfigError

    if any(option is not None for option in given.values()):
        raise ConfigError(
            f"{source} is a mission, which says all that itself; change it with --set, as in --set planner.swaths=6."
        )


def _tell_ways(
    source: Path, require: str, probability: float, settings: list[str] | None, *, as_json: bool
) -> None:
    from sim.cli.plan_foresight import tell_ways
    from sim.mission.runs import read_mission

    tell_ways(read_mission(source, settings or []), require, probability, as_json=as_json)


def _plan_mission(
    source: Path, runs: Path, settings: list[str] | None, *, as_json: bool, quiet: bool, verbose: int
) -> None:
    from sim.cli.mission_file import run_until, tell

    _, run = run_until(source, "plan", runs=runs, settings=settings, quiet=quiet, verbose=verbose)
    tell(run, as_json=as_json)


def _wanted(planner: dict[str, Any], rovers: int | None, max_slope: float | None) -> dict[str, Any]:
    """Return the options as sections of a mission."""
    wanted: dict[str, Any] = {"planner": planner}
    if rovers is not None:
        wanted["fleet"] = {"rovers": rovers}
    if max_slope is not None:
        wanted["rover"] = {"max_pitch_deg": max_slope, "max_roll_deg": max_slope}
    return wanted


def _refuse_beside_a_promise(given: dict[str, Any], **others: Any) -> None:
    """Refuse what a promise decides itself, or has no say in."""
    from survey.core.errors import ConfigError

    others["pattern"] = None if others["pattern"] == "lawnmower" else others["pattern"]
    stated = [*given, *(name for name, value in others.items() if value)]
    if stated:
        raise ConfigError(
            f"--require chooses pattern, swaths and spacing itself, for one rover; leave out {', '.join(stated)}"
            " (--set goes with --joint)."
        )


def _promise(
    source: Path,
    prior: Path | None,
    crs: str | None,
    no_go: Path | None,
    asked: "Asked",
    settings: list[str],
    out: Path,
    *,
    joint: bool,
    adaptive: bool,
    as_json: bool,
) -> None:
    """Plan what promises a class, with errors of the path that are shared or independent."""
    from sim.cli.plan_area import read_area
    from sim.cli.plan_foresight import plan_joint
    from sim.cli.plan_promise import plan_promised
    from survey.core.errors import ConfigError, InputError

    area, dem = read_area(source, prior, crs, no_go)
    if dem is None:
        raise InputError("a promise needs to know how the terrain varies; give a coarse DEM with --prior.")
    if not joint:
        plan_promised(area, dem, asked, out, adaptive=adaptive, as_json=as_json)
        return
    if adaptive:
        raise ConfigError("--joint foresees a whole survey; leave out --adaptive.")
    plan_joint(area, dem, asked, settings, out, as_json=as_json)

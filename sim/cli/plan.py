"""``firnline plan``: a route for an area, with a picture and what is expected of it."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sim.cli.options import RUNS, Json, Quiet, Runs, Settings, Verbose
from sim.cli.outcome import refusals_told

if TYPE_CHECKING:
    import planners
    import survey
    from sim.cli.plan_promise import Asked
    from survey.reconstruction.gp.kernels import Kernel


@refusals_told
def plan(
    source: Annotated[
        Path, typer.Argument(help="Area (GeoJSON, GeoPackage, KML, Shapefile) or mission file (TOML).")
    ],
    prior: Annotated[
        Path | None, typer.Option("--prior", help="Coarse elevation raster of the area.")
    ] = None,
    pattern: Annotated[
        str,
        typer.Option(
            "--pattern",
            help="lawnmower, wavy, piecewise-continuous, random-wander, variance-driven, or best (by predicted error).",
        ),
    ] = "lawnmower",
    swaths: Annotated[
        int | None, typer.Option("--swaths", help="Number of swaths; 4 when nothing else is asked.")
    ] = None,
    spacing: Annotated[
        float | None,
        typer.Option("--spacing", help="Ground sample spacing: the largest distance between swaths [m]."),
    ] = None,
    budget: Annotated[
        float | None, typer.Option("--budget", help="Metres to drive (best, variance-driven).")
    ] = None,
    rmse: Annotated[
        float | None, typer.Option("--rmse", help="Predicted error to reach [m] (best, variance-driven).")
    ] = None,
    crs: Annotated[
        str | None,
        typer.Option(
            "--crs", help="CRS to plan in, such as EPSG:32608; that of the prior or the file by default."
        ),
    ] = None,
    rovers: Annotated[
        int | None, typer.Option("--rovers", help="Number of rovers that share the area.")
    ] = None,
    max_slope: Annotated[
        float | None,
        typer.Option("--max-slope", help="Steepest ground of the prior that the rover may be on [deg]."),
    ] = None,
    no_go: Annotated[
        Path | None,
        typer.Option("--no-go", help="Raster that is 1 where nobody is to drive, as reconstruct writes it."),
    ] = None,
    require: Annotated[
        str | None,
        typer.Option(
            "--require", help="Promise this: class-1, class-2, class-3 or an RMSE [m]; needs --prior."
        ),
    ] = None,
    probability: Annotated[float, typer.Option("--probability", help="How sure the promise is to be.")] = 0.9,
    noise: Annotated[
        float, typer.Option("--noise", help="Error of a sample's height, for the promise [m].")
    ] = 0.1,
    localization: Annotated[
        float,
        typer.Option(
            "--localization", help="Error of the rover's place east and north, for the promise [m]."
        ),
    ] = 0.0,
    prior_sigma: Annotated[
        float, typer.Option("--prior-sigma", help="Error of a cell of the prior, for the promise [m].")
    ] = 1.0,
    assume: Annotated[
        str | None,
        typer.Option(
            "--assume",
            help="Family of the terrain's covariance, where it is known (squared-exponential, matern-5/2, matern-3/2, whittle); else the promise rests on the roughest that the prior does not exclude.",
        ),
    ] = None,
    joint: Annotated[
        bool,
        typer.Option(
            "--joint",
            help="Foresee the errors that the rover's path shares, from its sensors and aids (--set): so many swaths with so many stakes.",
        ),
    ] = False,
    adaptive: Annotated[
        bool, typer.Option("--adaptive", help="Plan swath by swath: the first two, or the next one.")
    ] = False,
    driven: Annotated[Path | None, typer.Option("--driven", help="Route driven so far (adaptive).")] = None,
    measured: Annotated[
        Path | None, typer.Option("--measured", help="Points measured so far (adaptive).")
    ] = None,
    out: Annotated[
        Path,
        typer.Option("--out", "-o", help="Route to write (.geojson, .gpkg); its picture is put beside it."),
    ] = Path("route.geojson"),
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
    if source.suffix == ".toml":
        from sim.cli.mission_file import run_until, tell
        from survey.errors import ConfigError

        if given or any(option is not None for option in (prior, crs, rovers, max_slope, no_go)):
            raise ConfigError(
                f"{source} is a mission, which says all that itself; change it with --set, as in --set planner.swaths=6."
            )
        if require is not None:
            from sim.cli.plan_foresight import tell_ways
            from sim.runs import read_mission

            tell_ways(read_mission(source, settings or []), require, probability, as_json=as_json)
            return
        _, run = run_until(source, "plan", runs=runs, settings=settings, quiet=quiet, verbose=verbose)
        tell(run, as_json=as_json)
        return
    if require is not None:
        from sim.cli.plan_promise import Asked

        _refuse_beside_a_promise(
            given, pattern=pattern, rovers=rovers, max_slope=max_slope, settings=None if joint else settings
        )
        asked_for = Asked(require, probability, noise, localization, prior_sigma, assume, driven, measured)
        _promise(
            *_read(source, prior, crs, no_go),
            asked_for,
            settings or [],
            out,
            joint=joint,
            adaptive=adaptive,
            as_json=as_json,
        )
        return
    wanted: dict[str, Any] = {"planner": {"pattern": pattern, **(given or {"swaths": 4})}}
    if rovers is not None:
        wanted["fleet"] = {"rovers": rovers}
    if max_slope is not None:
        wanted["rover"] = {"max_pitch_deg": max_slope, "max_roll_deg": max_slope}
    area, dem = _read(source, prior, crs, no_go)
    route = _plan_area(area, dem, wanted, settings or [], out, quiet=quiet)
    _tell(route, out, as_json=as_json)


def _refuse_beside_a_promise(given: dict[str, Any], **others: Any) -> None:
    """Refuse what a promise decides itself, or has no say in."""
    from survey.errors import ConfigError

    others["pattern"] = None if others["pattern"] == "lawnmower" else others["pattern"]
    stated = [*given, *(name for name, value in others.items() if value)]
    if stated:
        raise ConfigError(
            f"--require chooses pattern, swaths and spacing itself, for one rover; leave out {', '.join(stated)}"
            " (--set goes with --joint)."
        )


def _promise(
    area: "survey.SurveyArea",
    prior: "survey.Dem | None",
    asked: "Asked",
    settings: list[str],
    out: Path,
    *,
    joint: bool,
    adaptive: bool,
    as_json: bool,
) -> None:
    """Plan what promises a class, with errors of the path that are shared or independent."""
    from sim.cli.plan_foresight import plan_joint
    from sim.cli.plan_promise import plan_promised
    from survey.errors import ConfigError, InputError

    if prior is None:
        raise InputError("a promise needs to know how the terrain varies; give a coarse DEM with --prior.")
    if not joint:
        plan_promised(area, prior, asked, out, adaptive=adaptive, as_json=as_json)
        return
    if adaptive:
        raise ConfigError("--joint foresees a whole survey; leave out --adaptive.")
    plan_joint(area, prior, asked, settings, out, as_json=as_json)


def _read(
    source: Path, prior: Path | None, crs: str | None, no_go: Path | None
) -> "tuple[survey.SurveyArea, survey.Dem | None]":
    """Read the area, less the ground that a raster marks, and what is known of it, in one CRS."""
    import survey
    from planners.traversability import without_marked

    dem = None if prior is None else survey.Dem.read(prior)
    area = survey.SurveyArea.read(source, crs=crs if dem is None or crs is not None else dem.crs)
    if dem is not None:
        area.require_crs(dem.crs, "the prior")
    if no_go is not None:
        area = without_marked(area, survey.Dem.read(no_go))
    return area, dem


def _plan_area(
    area: "survey.SurveyArea",
    dem: "survey.Dem | None",
    wanted: dict[str, Any],
    settings: list[str],
    out: Path,
    *,
    quiet: bool,
) -> "survey.Route":
    """Plan, and write the route and its picture."""
    import planners
    from sim.cli.progress import counted
    from survey.config import Section, validated, with_overrides

    class Wanted(Section):
        planner: planners.PlannerConfig
        rover: planners.Rover = planners.Rover()
        fleet: planners.Fleet = planners.Fleet()

    config = validated(Wanted, with_overrides(wanted, settings), "the options")
    with counted(quiet=quiet) as progress:
        progress("learning how the terrain varies", 0, 1)
        kernel = None if dem is None else _kernel(dem, area)
        progress("learning how the terrain varies", 1, 1)
        route = planners.plan(
            area,
            dem,
            config.planner,
            rover=config.rover,
            fleet=config.fleet,
            kernel=kernel,
            progress=progress,
        )
    route.write(out)
    _draw(route, area, dem, kernel, planners.drivable(area, config.rover, dem), out.with_suffix(".png"))
    return route


def _kernel(dem: "survey.Dem", area: "survey.SurveyArea") -> "Kernel | None":
    """Return the covariance that the prior speaks for; None, with the reason told, when it is too coarse."""
    import planners
    from survey.errors import InputError

    try:
        return planners.terrain_kernel(dem, area)
    except InputError as error:
        typer.echo(f"firnline: no error is predicted: {error}", err=True)
        return None


def _draw(
    route: "survey.Route",
    area: "survey.SurveyArea",
    dem: "survey.Dem | None",
    kernel: "Kernel | None",
    site: "planners.Drivable",
    path: Path,
) -> None:
    import planners
    from survey import figures
    from survey.io.files import replacing

    std = None
    if kernel is not None and "rmse_m" in route.prediction:
        std = planners.predict_error(route, area, kernel, noise_m=0.1).std
    pieces = [piece.polygon for piece in site.left_out]
    figure = figures.plan_map(area, route, terrain=dem, std=std, left_out=pieces)
    with replacing(path) as file:
        file.write_bytes(figures.png_bytes(figure))


def _tell(route: "survey.Route", out: Path, *, as_json: bool) -> None:
    """Print what is expected of the route, for people or as JSON."""
    picture = out.with_suffix(".png")
    if as_json:
        content = {"route": str(out), "picture": str(picture), "length_m": route.length_m, **route.prediction}
        typer.echo(json.dumps(content, indent=2))
        return
    typer.echo(
        f"{len(route.swaths)} swaths, {route.length_m:.0f} m in all, written to {out}, drawn in {picture}"
    )
    for name, value in route.prediction.items():
        typer.echo(f"  predicted {name} = {value:.6g}")

"""``firnline plan``: a route for an area."""

from pathlib import Path
from typing import Annotated

import typer

from sim.cli.options import RUNS, Json, Quiet, Runs, Settings, Verbose
from sim.cli.outcome import refusals_told


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
        float | None, typer.Option("--spacing", help="Largest distance between swaths [m].")
    ] = None,
    budget: Annotated[
        float | None, typer.Option("--budget", help="Metres to drive (best, variance-driven).")
    ] = None,
    rmse: Annotated[
        float | None, typer.Option("--rmse", help="Predicted error to reach [m] (best, variance-driven).")
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Route to write (.geojson, .gpkg).")] = Path(
        "route.geojson"
    ),
    runs: Runs = RUNS,
    settings: Settings = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,
) -> None:
    """Plan the route of a survey.

    For example:

      firnline plan site.geojson --prior srtm.tif --swaths 6 -o route.geojson

      firnline plan site.kml --prior srtm.tif --pattern wavy --spacing 50

      firnline plan mine.toml
    """
    if source.suffix == ".toml":
        from sim.cli.mission_file import run_until, tell

        _, run = run_until(source, "plan", runs=runs, settings=settings, quiet=quiet, verbose=verbose)
        tell(run, as_json=as_json)
        return
    asked = {"swaths": swaths, "spacing_m": spacing, "budget_m": budget, "rmse_m": rmse}
    given = {name: value for name, value in asked.items() if value is not None}
    _plan_area(source, prior, {"pattern": pattern, **(given or {"swaths": 4})}, out, as_json=as_json)


def _plan_area(
    source: Path, prior: Path | None, wanted: dict[str, object], out: Path, *, as_json: bool
) -> None:
    import json

    import planners
    import survey
    from survey.config import Section, validated

    class Wanted(Section):
        plan: planners.PlannerConfig

    config = validated(Wanted, {"plan": wanted}, "the options").plan
    dem = None if prior is None else survey.Dem.read(prior)
    area = survey.SurveyArea.read(source, crs=None if dem is None else dem.crs)
    route = planners.plan(area, dem, config)
    route.write(out)
    if as_json:
        typer.echo(json.dumps({"route": str(out), "length_m": route.length_m, **route.prediction}, indent=2))
        return
    typer.echo(f"{len(route.swaths)} swaths, {route.length_m:.0f} m in all, written to {out}")
    for name, value in route.prediction.items():
        typer.echo(f"  predicted {name} = {value:.6g}")

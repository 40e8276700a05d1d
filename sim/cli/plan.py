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
    swaths: Annotated[int, typer.Option("--swaths", help="Number of swaths.")] = 4,
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

      firnline plan mine.toml
    """
    if source.suffix == ".toml":
        from sim.cli.mission_file import run_until, tell

        _, run = run_until(source, "plan", runs=runs, settings=settings, quiet=quiet, verbose=verbose)
        tell(run, as_json=as_json)
        return
    _plan_area(source, prior, swaths, out, as_json=as_json)


def _plan_area(source: Path, prior: Path | None, swaths: int, out: Path, *, as_json: bool) -> None:
    import json

    import planners
    import survey
    from survey.config import validated

    config = validated(planners.LawnmowerConfig, {"swaths": swaths}, "--swaths")
    dem = None if prior is None else survey.Dem.read(prior)
    area = survey.SurveyArea.read(source, crs=None if dem is None else dem.crs)
    route = planners.plan(area, dem, config)
    route.write(out)
    if as_json:
        typer.echo(json.dumps({"route": str(out), "length_m": route.length_m, **route.prediction}, indent=2))
    else:
        typer.echo(f"{len(route.swaths)} swaths, {route.length_m:.0f} m in all, written to {out}")

"""``firnline score``: judge how good a map is."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sim.cli.options import RUNS, Json, Quiet, Runs, Settings, Verbose
from sim.cli.outcome import refusals_told

if TYPE_CHECKING:
    from survey import Dem, Reconstruction


@refusals_told
def score(
    source: Annotated[
        Path,
        typer.Argument(
            help="Map (raster; its second band is the standard deviation) or mission file (TOML)."
        ),
    ],
    truth: Annotated[
        Path | None, typer.Option("--truth", help="Reference raster, finer and surer than the map.")
    ] = None,
    area: Annotated[Path | None, typer.Option("--area", help="Judge only inside this polygon.")] = None,
    route: Annotated[
        Path | None, typer.Option("--route", help="Route that was driven, for coverage, α and β.")
    ] = None,
    runs: Runs = RUNS,
    settings: Settings = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,
) -> None:
    """Judge a map against a reference: error statistics, coverage, map class.

    For example:

      firnline score mine.tif --truth lidar.tif --area site.gpkg

      firnline score mine.toml
    """
    if source.suffix == ".toml":
        from sim.cli.mission_file import run_until, tell

        _, run = run_until(source, "score", runs=runs, settings=settings, quiet=quiet, verbose=verbose)
        tell(run, as_json=as_json)
        return
    _score_file(source, truth, area, route, as_json=as_json)


def _score_file(
    source: Path, truth: Path | None, area: Path | None, route: Path | None, *, as_json: bool
) -> None:
    import json

    import survey
    from sim.cli.mission_file import best_class
    from survey.errors import InputError

    if truth is None:
        raise InputError(f"{source} cannot be judged alone; name the reference raster with --truth.")
    map_, truth_dem = _map_of(source), survey.Dem.read(truth)
    judged = survey.score(
        map_,
        truth=truth_dem,
        route=None if route is None else survey.Route.read(route),
        area=None if area is None else survey.SurveyArea.read(area, crs=truth_dem.crs),
    ).to_dict()
    if as_json:
        typer.echo(json.dumps(judged, indent=2))
        return
    for name, figure in judged["elevation"].items():
        typer.echo(f"{name:<12} {figure:.4f}" if isinstance(figure, float) else f"{name:<12} {figure}")
    typer.echo(best_class(judged["verdicts"]))


def _map_of(source: Path) -> "Reconstruction | Dem":
    """Read firnline's own map from its folder, or anyone's raster; a second band is its standard deviation."""
    import numpy as np

    import survey
    from survey.io.raster import band_count
    from survey.reconstruction import INTERPOLATED

    if source.is_dir():
        return survey.Reconstruction.read(source)
    mean = survey.Dem.read(source)
    if band_count(source) < 2:
        return mean
    std = survey.Dem.read(source, band=2)
    return survey.Reconstruction(mean, std, np.full(mean.shape, INTERPOLATED), "outside", {})

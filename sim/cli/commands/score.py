"""``firnline score``: errors, coverage and class of a map against a reference or checkpoints."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sim.cli.options import RUNS, Json, Quiet, Runs, Settings, Verbose
from sim.cli.outcome import with_exit_codes

if TYPE_CHECKING:
    from survey import Dem, Reconstruction, Score

# Rasters of more cells are scored in blocks.
_LARGE = 20_000_000


Standards = Annotated[
    list[str] | None,
    typer.Option(
        "--standard", help="Judge checkpoints by: asprs-edition-2 (default), asprs-2014, nssda-1998, …"
    ),
]
Class = Annotated[
    float | None, typer.Option("--class", help="Class wanted: the RMSE of the newer ASPRS standards [m].")
]
Interval = Annotated[
    float | None, typer.Option("--interval", help="Contour interval of ASPRS 1990 and NMAS [m].")
]
Sigma = Annotated[float | None, typer.Option("--sigma", help="Deviation of checkpoints that state none [m].")]
Crs = Annotated[
    str | None,
    typer.Option("--crs", help="CRS of rasters that carry none or a local one (LOCAL_CS), e.g. EPSG:32608."),
]
Columns = Annotated[
    list[str] | None,
    typer.Option(
        "--columns",
        metavar="KEY=COLUMN,…",
        help="Columns of the checkpoint table: x, y, z, lon, lat, sigma_z, name; usual names are found.",
    ),
]
Datum = Annotated[str | None, typer.Option("--datum", help="Vertical datum of checkpoints that state none.")]


@with_exit_codes
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
    checkpoints: Annotated[
        Path | None,
        typer.Option(
            "--checkpoints", help="Independent points (CSV, GeoPackage, GPX …), better than the map."
        ),
    ] = None,
    standard: Standards = None,
    class_m: Class = None,
    interval: Interval = None,
    sigma: Sigma = None,
    columns: Columns = None,
    datum: Datum = None,
    control: Annotated[
        Path | None,
        typer.Option("--control", help="Points that the map was made from; no checkpoint may be one."),
    ] = None,
    area: Annotated[Path | None, typer.Option("--area", help="Judge only inside this polygon.")] = None,
    route: Annotated[
        Path | None, typer.Option("--route", help="Route that was driven, for coverage, α and β.")
    ] = None,
    crs: Crs = None,
    runs: Runs = RUNS,
    settings: Settings = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,
) -> None:
    """Judge a map against a reference or checkpoints: error statistics, coverage, map class.

    Large rasters are read in blocks. A standard whose conditions are not met gives no verdict.

    For example:

      firnline score mine.tif --truth lidar.tif --area site.gpkg

      firnline score mine.tif --checkpoints gnss.csv --standard asprs-edition-2 --class 0.10

      firnline score mine.tif --checkpoints export.txt --columns x=Rechtswert,y=Hochwert,z=Hoehe,sigma_z=mH

      firnline score mine.toml
    """
    if source.suffix == ".toml":
        from sim.cli.mission_file import print_summary, run_until

        _, run = run_until(source, "score", runs=runs, settings=settings, quiet=quiet, verbose=verbose)
        print_summary(run, as_json=as_json)
        return
    if checkpoints is not None:
        asked = {
            "standards": tuple(standard or ("asprs-edition-2",)),
            "class_m": class_m,
            "interval_m": interval,
        }
        given = {"sigma_m": sigma, "vertical_datum": datum, "columns": _mapping(columns)}
        _score_at(map_of(source, crs), checkpoints, (control, area), given, asked, as_json=as_json)
        return
    _score_file(source, truth, area, route, crs, as_json=as_json)


def _mapping(columns: list[str] | None) -> dict[str, str]:
    from survey.io.text_tables.spellings import parsed_columns

    return parsed_columns(columns or [])


def _score_at(
    map_: "Reconstruction | Dem",
    checkpoints: Path,
    besides: tuple[Path | None, Path | None],
    given: dict[str, Any],
    asked: dict[str, Any],
    *,
    as_json: bool,
) -> None:
    """Judge a map by checkpoints; `besides` are the files of control points and of the area, `given` what the points' file lacks."""
    import json

    import survey
    from survey.scoring import Checkpoints, compare, score_at
    from survey.scoring.standards.checkpoints import control_places

    dem = map_ if isinstance(map_, survey.Dem) else map_.mean
    points = Checkpoints.read(checkpoints, crs=dem.crs, **given)
    control, area = besides
    if control is not None:
        points.refuse_control(control_places(control, dem.crs))
    ground = None if area is None else survey.SurveyArea.read(area, crs=dem.crs)
    judged = score_at(compare(dem, points, ground), **asked)
    if as_json:
        typer.echo(json.dumps(judged.to_dict(), indent=2))
        return
    _print_statistics(judged.to_dict()["elevation"])
    low, high = judged.interval.low_m, judged.interval.high_m
    typer.echo(f"{'rmse 95 %':<12} {low:.4f} to {high:.4f} ({judged.interval.method})")
    if judged.left_out:
        typer.echo(f"no height at {', '.join(judged.left_out)}")
    for finding in judged.assessments:
        typer.echo(finding.sentence)
        for caution in finding.cautions:
            typer.echo(f"  note: {caution}")


def _print_statistics(figures: dict[str, Any]) -> None:
    for name, figure in figures.items():
        typer.echo(f"{name:<12} {figure:.4f}" if isinstance(figure, float) else f"{name:<12} {figure}")


def _score_file(
    source: Path, truth: Path | None, area: Path | None, route: Path | None, crs: str | None, *, as_json: bool
) -> None:
    import json

    from sim.cli.mission_file import best_class
    from survey.core.errors import InputError

    if truth is None:
        raise InputError(
            f"{source} cannot be judged alone; name the reference raster with --truth or points with --checkpoints."
        )
    judged = _judged(source, truth, area, route, crs).to_dict()
    if as_json:
        typer.echo(json.dumps(judged, indent=2))
        return
    _print_statistics(judged["elevation"])
    typer.echo(best_class(judged))


def _judged(source: Path, truth: Path, area: Path | None, route: Path | None, crs: str | None) -> "Score":
    """Judge in memory, or block by block what is large."""
    import survey
    from survey.core.crs.agreement import agreed_crs
    from survey.io.raster import raster_facts
    from survey.scoring.blocks import score_files

    reference = raster_facts(truth)
    if route is None and source.is_file():
        sizes = (math.prod(shape) for shape in (reference.shape, raster_facts(source).shape))
        if max(sizes) > _LARGE:
            system = agreed_crs(reference.crs, crs, str(truth))
            ground = None if area is None else survey.SurveyArea.read(area, crs=system)
            return score_files(source, truth, ground, crs=crs)
    map_, truth_dem = map_of(source, crs), survey.Dem.read(truth, crs=crs)
    return survey.score(
        map_,
        truth=truth_dem,
        route=None if route is None else survey.Route.read(route),
        area=None if area is None else survey.SurveyArea.read(area, crs=truth_dem.crs),
    )


def map_of(source: Path, crs: str | None = None) -> "Reconstruction | Dem":
    """Read firnline's own map from its folder, or anyone's raster; a second band is its standard deviation."""
    import numpy as np

    import survey
    from survey.io.raster import band_count
    from survey.reconstruction import INTERPOLATED

    if source.is_dir():
        return survey.Reconstruction.read(source)
    mean = survey.Dem.read(source, crs=crs)
    if band_count(source) < 2:
        return mean
    std = survey.Dem.read(source, band=2, crs=crs)
    return survey.Reconstruction(mean, std, np.full(mean.shape, INTERPOLATED), "outside", {})

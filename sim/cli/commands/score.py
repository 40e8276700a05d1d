"""``firnline score``: errors, coverage and class of a map against a reference or checkpoints."""

from pathlib import Path
from typing import Annotated

import typer

from sim.cli.options import RUNS, Json, Quiet, Runs, Settings, Verbose
from sim.cli.outcome import with_exit_codes
from sim.cli.scoring.checkpoints import score_at_checkpoints
from sim.cli.scoring.maps import map_of
from sim.cli.scoring.raster import score_against_raster
from sim.cli.scoring.request import ScoreRequest, refuse_options_of_maps

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
By = Annotated[
    list[str] | None,
    typer.Option(
        "--by",
        metavar="slope|FILE",
        help="Statistics by class: slope, or a raster or polygons of land cover.",
    ),
]
ClassColumn = Annotated[
    str | None, typer.Option("--class-column", help="Column of the polygons that names the class.")
]
Report = Annotated[
    Path | None,
    typer.Option("--report", help="Write an accuracy report: a folder, or a file .html or .pdf."),
]
Language = Annotated[
    str, typer.Option("--language", help="Language of the statements beside English: en or de.")
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
    by: By = None,
    class_column: ClassColumn = None,
    report: Report = None,
    language: Language = "en",
    force: Annotated[bool, typer.Option("--force", help="Replace a report that is there.")] = False,
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

      firnline score mine.tif --checkpoints gnss.csv --class 0.10 --report accuracy.pdf --language de

      firnline score mine.tif --truth lidar.tif --by slope --by landcover.tif

      firnline score mine.toml
    """
    if source.suffix == ".toml":
        from sim.cli.mission_file import print_summary, run_until

        refuse_options_of_maps(source, report=report, by=by)

        _, run = run_until(source, "score", runs=runs, settings=settings, quiet=quiet, verbose=verbose)
        print_summary(run, as_json=as_json)
        return
    request = ScoreRequest(
        source,
        truth=truth,
        checkpoints=checkpoints,
        control=control,
        area=area,
        route=route,
        crs=crs,
        standards=tuple(standard or ("asprs-edition-2",)),
        class_m=class_m,
        interval_m=interval,
        sigma_m=sigma,
        datum=datum,
        columns=tuple(columns or ()),
        by=tuple(by or ()),
        class_column=class_column,
        report=report,
        language=language,
        force=force,
        as_json=as_json,
    )
    request.check()
    if checkpoints is None:
        score_against_raster(request)
    else:
        score_at_checkpoints(request, map_of(source, crs))

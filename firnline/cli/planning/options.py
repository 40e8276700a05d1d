"""Options of ``firnline plan``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from firnline.cli.options import RunOptions


@dataclass(frozen=True, kw_only=True)
class PlanOptions(RunOptions):
    """Options of the command; None stands for an option that was not given."""

    source: Annotated[
        Path, typer.Argument(help="Area (GeoJSON, GeoPackage, KML, KMZ, Shapefile) or mission file (TOML).")
    ]
    prior: Annotated[Path | None, typer.Option("--prior", help="Coarse elevation raster of the area.")] = None
    pattern: Annotated[
        str | None,
        typer.Option(
            "--pattern",
            help="Planner, such as lawnmower (default), wavy or best (by predicted error); an unknown name lists all.",
        ),
    ] = None
    swaths: Annotated[
        int | None, typer.Option("--swaths", help="Number of parallel lines; 4 when no size is given.")
    ] = None
    spacing: Annotated[
        float | None,
        typer.Option("--spacing", help="Ground sample spacing: the largest distance between swaths [m]."),
    ] = None
    budget: Annotated[
        float | None, typer.Option("--budget", help="Metres to drive (best, variance-driven).")
    ] = None
    rmse: Annotated[
        float | None, typer.Option("--rmse", help="Predicted error to reach [m] (best, variance-driven).")
    ] = None
    crs: Annotated[
        str | None,
        typer.Option(
            "--crs", help="CRS to plan in, such as EPSG:32608; that of the prior or the file by default."
        ),
    ] = None
    rovers: Annotated[int | None, typer.Option("--rovers", help="Number of rovers that share the area.")] = (
        None
    )
    max_slope: Annotated[
        float | None,
        typer.Option("--max-slope", help="Steepest ground of the prior that the rover may be on [deg]."),
    ] = None
    no_go: Annotated[
        Path | None,
        typer.Option("--no-go", help="Raster that is 1 on no-go ground, as reconstruct writes it."),
    ] = None
    require: Annotated[
        str | None,
        typer.Option(
            "--require", help="Guarantee this: class-1, class-2, class-3 or an RMSE [m]; needs --prior."
        ),
    ] = None
    probability: Annotated[
        float,
        typer.Option("--probability", help="Probability of the guarantee, above 0.5 and at most 0.999."),
    ] = 0.9
    noise_m: Annotated[
        float,
        typer.Option("--noise", help="Standard deviation of a sample's height, for the guarantee [m]."),
    ] = 0.1
    localization_m: Annotated[
        float,
        typer.Option(
            "--localization",
            help="Standard deviation of the rover's position, east and north each, for the guarantee [m].",
        ),
    ] = 0.0
    prior_sigma_m: Annotated[
        float,
        typer.Option(
            "--prior-sigma", help="Standard deviation of a cell of the prior, for the guarantee [m]."
        ),
    ] = 1.0
    assume: Annotated[
        str | None,
        typer.Option(
            "--assume",
            help="Covariance family of the terrain (squared-exponential, matern-5/2, matern-3/2, whittle); by default those of the surface.",
        ),
    ] = None
    surface: Annotated[
        str,
        typer.Option(
            "--surface",
            help="Class of the ground, for the guarantee: bare-ice, snow, moraine, bedrock or unknown.",
        ),
    ] = "unknown"
    micro_relief_m: Annotated[
        float | None,
        typer.Option(
            "--micro-relief",
            help="Standard deviation of relief finer than the samples [m]; that of the surface by default.",
        ),
    ] = None
    shared_m: Annotated[
        float,
        typer.Option("--shared", help="Standard deviation of an error of height that all samples share [m]."),
    ] = 0.05
    max_swaths: Annotated[
        int | None,
        typer.Option(
            "--max-swaths", help="Most swaths of a guarantee; by default as many as are two samples apart."
        ),
    ] = None
    joint: Annotated[
        bool,
        typer.Option(
            "--joint",
            help="Predict the errors that the path shares, from its sensors and aiding (--set): numbers of swaths and of stakes.",
        ),
    ] = False
    adaptive: Annotated[
        bool, typer.Option("--adaptive", help="Plan swath by swath: the first two, or the next one.")
    ] = False
    driven: Annotated[Path | None, typer.Option("--driven", help="Route driven so far (adaptive).")] = None
    measured: Annotated[
        Path | None, typer.Option("--measured", help="Points measured so far (adaptive).")
    ] = None
    season: Annotated[
        str | None,
        typer.Option(
            "--season",
            help="Design two surveys: half the 95 % interval of the mass balance [m w.e.], such as 0.2, or of the change of volume, such as 5%; needs --prior and --dates.",
        ),
    ] = None
    dates: Annotated[
        str | None,
        typer.Option("--dates", help="Days of both surveys of a season, such as 2026-05-01,2026-09-20."),
    ] = None
    melt_m_we_day: Annotated[
        float | None,
        typer.Option(
            "--melt", help="Mean melt of a day in the season [m w.e.]; that of the surface by default."
        ),
    ] = None
    emergence_m_year: Annotated[
        float,
        typer.Option(
            "--emergence",
            help="Standard deviation of the mean vertical motion of the ice over the area [m per year]; 0 for a complete glacier.",
        ),
    ] = 0.0
    km_a_day: Annotated[
        float, typer.Option("--km-a-day", help="Distance driven in a day of a season [km].")
    ] = 10.0
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            help="Route (.geojson, .gpkg) with its picture beside it, or sheets for printing (.pdf) or a QGIS project (.qgz), with the route and the predicted standard deviation (_sigma.tif) beside them.",
        ),
    ] = Path("route.geojson")
    force: Annotated[
        bool, typer.Option("--force", help="Replace the route and its picture where they exist.")
    ] = False

"""``firnline reconstruct``: a map from measured points."""

from pathlib import Path
from typing import Annotated

import typer

from sim.cli.options import RUNS, Json, Quiet, Runs, Settings, Verbose
from sim.cli.outcome import refusals_told
from sim.cli.reconstruct_scans import SCAN_METHODS, draw_and_mark, reconstruct_scans


@refusals_told
def reconstruct(
    sources: Annotated[
        list[Path],
        typer.Argument(
            help="Points (CSV, GeoPackage, LAS/LAZ, PLY), a mission file (TOML), or LiDAR scans and folders of them "
            "(npz, LAS/LAZ, PLY, ROS 2) for carving, emap and field."
        ),
    ],
    prior: Annotated[
        Path | None, typer.Option("--prior", help="Coarse elevation raster to build around.")
    ] = None,
    grid: Annotated[
        float | None,
        typer.Option("--grid", help="Distance between the nodes of the map [m]; 1, and 0.25 for scans."),
    ] = None,
    method: Annotated[
        str, typer.Option("--method", help="gp, dense or tin; carving, emap or field for scans.")
    ] = "gp",
    value: Annotated[
        str | None, typer.Option("--value", help="Map this sampled quantity instead of elevation.")
    ] = None,
    crs: Annotated[
        str | None, typer.Option("--crs", help="CRS of points that carry none, e.g. EPSG:32608.")
    ] = None,
    sigma: Annotated[
        float | None, typer.Option("--sigma", help="Standard deviation of points that state none [m].")
    ] = None,
    trajectory: Annotated[
        Path | None,
        typer.Option("--trajectory", help="Where the scanner was (TUM), for scans that do not say."),
    ] = None,
    rays: Annotated[
        bool,
        typer.Option(
            "--rays", help="Let lines of sight to the ground bound the map from above, and draw its bounds."
        ),
    ] = False,
    max_slope: Annotated[
        float | None,
        typer.Option(
            "--max-slope",
            help="With --rays: write no_go.tif, the ground that the bounds show to be steeper [deg].",
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for dem.tif and reconstruction.json.")
    ] = Path("reconstruction"),
    force: Annotated[bool, typer.Option("--force", help="Replace a reconstruction that is there.")] = False,
    runs: Runs = RUNS,
    settings: Settings = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,
) -> None:
    """Reconstruct terrain from points, with its standard deviation.

    For example:

      firnline reconstruct landmarks.csv --crs EPSG:32608 --prior srtm.tif --grid 2

      firnline reconstruct cloud.laz --method tin -o map

      firnline reconstruct scans/ --method field --crs EPSG:32608 --sigma 0.03

      firnline reconstruct scans/ --method field --rays --max-slope 20 --crs EPSG:32608 --sigma 0.03

      firnline reconstruct mine.toml
    """
    from survey.errors import InputError

    source = sources[0]
    if len(sources) > 1 and method not in SCAN_METHODS:
        raise InputError(
            f"{len(sources)} files were named, and the method {method!r} maps one; name one, or take carving, emap or field."
        )
    if max_slope is not None and not rays:
        raise InputError(
            "ground that is too steep for certain is told from bounds; add --rays to --max-slope."
        )
    if source.suffix == ".toml":
        from sim.cli.mission_file import run_until, tell

        _, run = run_until(source, "reconstruct", runs=runs, settings=settings, quiet=quiet, verbose=verbose)
        tell(run, as_json=as_json)
        return
    if (out / "dem.tif").exists() and not force:
        raise InputError(
            f"{out / 'dem.tif'} exists; choose another folder with --out or add --force to replace it."
        )
    if method in SCAN_METHODS:
        reconstruct_scans(
            sources,
            method,
            grid,
            crs=crs,
            sigma_m=sigma,
            trajectory=trajectory,
            out=out,
            quiet=quiet,
            as_json=as_json,
            rays=rays,
            max_slope_deg=max_slope,
        )
    else:
        _reconstruct_points(
            source,
            prior,
            1.0 if grid is None else grid,
            method,
            value,
            crs,
            sigma,
            out,
            as_json=as_json,
            rays=rays,
            max_slope_deg=max_slope,
        )


def _reconstruct_points(
    source: Path,
    prior: Path | None,
    step_m: float,
    method: str,
    value: str | None,
    crs: str | None,
    sigma_m: float | None,
    out: Path,
    *,
    as_json: bool,
    rays: bool,
    max_slope_deg: float | None,
) -> None:
    import survey
    from survey.reconstruction.base import ELEVATION

    points = survey.SurfacePoints.read(source, crs=crs, sigma_m=sigma_m)
    (xmin, ymin), (xmax, ymax) = points.xy.min(axis=0), points.xy.max(axis=0)
    nodes = survey.Grid.over((float(xmin), float(ymin), float(xmax), float(ymax)), step_m, points.crs)
    result = survey.reconstruct(
        points,
        nodes,
        None if prior is None else survey.Dem.read(prior),
        method=method,  # type: ignore[arg-type]  # refused by name where it is unknown
        value=value or ELEVATION,
        rays=rays,
    )
    out.mkdir(parents=True, exist_ok=True)
    result.write(out)
    if rays:
        draw_and_mark(result, out, max_slope_deg)
    if as_json:
        typer.echo((out / "reconstruction.json").read_text(encoding="utf-8"))
        return
    rows, columns = result.mean.shape
    typer.echo(f"{rows} × {columns} nodes by {result.method}, written to {out / 'dem.tif'}")
    for name, setting in result.hyperparameters.items():
        typer.echo(f"  {name} = {setting:.6g}" if isinstance(setting, float) else f"  {name} = {setting}")

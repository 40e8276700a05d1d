"""``firnline reconstruct``: a map from measured points."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sim.cli.options import RUNS, Json, Quiet, Runs, Settings, Verbose
from sim.cli.outcome import refusals_told
from sim.cli.reconstruct_scans import SCAN_METHODS, map_of_scans

if TYPE_CHECKING:
    import survey


_Sources = Annotated[
    list[Path],
    typer.Argument(
        help="Points (CSV, GeoPackage, LAS/LAZ, PLY), a mission file (TOML), or LiDAR scans and folders of them "
        "(npz, LAS/LAZ, PLY, ROS 2) for carving, emap and field."
    ),
]
_Prior = Annotated[Path | None, typer.Option("--prior", help="Coarse elevation raster to build around.")]
_Grid = Annotated[
    float | None,
    typer.Option("--grid", help="Distance between the nodes of the map [m]; 1, and 0.25 for scans."),
]
_Method = Annotated[str, typer.Option("--method", help="gp, dense or tin; carving, emap or field for scans.")]
_Value = Annotated[
    str | None, typer.Option("--value", help="Map this sampled quantity instead of elevation.")
]
_Crs = Annotated[str | None, typer.Option("--crs", help="CRS of points that carry none, e.g. EPSG:32608.")]
_Sigma = Annotated[
    float | None, typer.Option("--sigma", help="Standard deviation of points that state none [m].")
]
_Trajectory = Annotated[
    Path | None,
    typer.Option("--trajectory", help="Where the scanner was (TUM), for scans that do not say."),
]
_Rays = Annotated[
    bool,
    typer.Option(
        "--rays", help="Let lines of sight to the ground bound the map from above, and draw its bounds."
    ),
]
_MaxSlope = Annotated[
    float | None,
    typer.Option(
        "--max-slope",
        help="With --rays: write no_go.tif, the ground that the bounds show to be steeper [deg].",
    ),
]
_Out = Annotated[Path, typer.Option("--out", "-o", help="Folder for dem.tif and reconstruction.json.")]
_Force = Annotated[bool, typer.Option("--force", help="Replace a reconstruction that is there.")]


@refusals_told
def reconstruct(
    sources: _Sources,
    prior: _Prior = None,
    grid: _Grid = None,
    method: _Method = "gp",
    value: _Value = None,
    crs: _Crs = None,
    sigma: _Sigma = None,
    trajectory: _Trajectory = None,
    rays: _Rays = False,
    max_slope: _MaxSlope = None,
    out: _Out = Path("reconstruction"),
    force: _Force = False,
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
    source = sources[0]
    _refuse_at_odds(sources, method, rays=rays, max_slope_deg=max_slope)
    if source.suffix == ".toml":
        from sim.cli.mission_file import run_until, tell

        _, run = run_until(source, "reconstruct", runs=runs, settings=settings, quiet=quiet, verbose=verbose)
        tell(run, as_json=as_json)
        return
    _refuse_existing(out, force=force)
    if method in SCAN_METHODS:
        result, origin = map_of_scans(sources, method, grid, crs, sigma, trajectory, rays=rays, quiet=quiet)
    else:
        step_m = 1.0 if grid is None else grid
        result, origin = _map_of_points(source, prior, step_m, method, value, crs, sigma, rays=rays)
    out.mkdir(parents=True, exist_ok=True)
    result.write(out)
    if rays:
        _draw_and_mark(result, out, max_slope)
    _tell(result, origin, out, as_json=as_json)


def _refuse_at_odds(sources: list[Path], method: str, *, rays: bool, max_slope_deg: float | None) -> None:
    """Refuse options that ask for what the method does not do."""
    from survey.core.errors import InputError

    if len(sources) > 1 and method not in SCAN_METHODS:
        raise InputError(
            f"{len(sources)} files were named, and the method {method!r} maps one; name one, or take carving, emap or field."
        )
    if max_slope_deg is not None and not rays:
        raise InputError(
            "ground that is too steep for certain is told from bounds; add --rays to --max-slope."
        )


def _refuse_existing(out: Path, *, force: bool) -> None:
    from survey.core.errors import InputError

    if (out / "dem.tif").exists() and not force:
        raise InputError(
            f"{out / 'dem.tif'} exists; choose another folder with --out or add --force to replace it."
        )


def _map_of_points(
    source: Path,
    prior: Path | None,
    step_m: float,
    method: str,
    value: str | None,
    crs: str | None,
    sigma_m: float | None,
    *,
    rays: bool,
) -> "tuple[survey.Reconstruction, str]":
    """Return the map of the points in a file, and what it was made by."""
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
    return result, f"by {result.method}"


def _draw_and_mark(result: "survey.Reconstruction", out: Path, max_slope_deg: float | None) -> None:
    """Write pictures of mean, width and support, and the ground that is too steep for certain."""
    from survey.core.files import replacing
    from survey.figures import png_bytes, route_map, support_map
    from survey.figures.bounds import width_map
    from survey.reconstruction.line_of_sight.steep_ground import steep_ground

    figures = {"mean": route_map(result.mean), "width": width_map(result), "support": support_map(result)}
    for name, figure in figures.items():
        with replacing(out / f"{name}.png") as draft:
            draft.write_bytes(png_bytes(figure))
    if max_slope_deg is not None:
        steep_ground(result, max_slope_deg).write(out / "no_go.tif")


def _tell(result: "survey.Reconstruction", origin: str, out: Path, *, as_json: bool) -> None:
    """Print what was made, for people or as JSON."""
    if as_json:
        typer.echo((out / "reconstruction.json").read_text(encoding="utf-8"))
        return
    rows, columns = result.mean.shape
    typer.echo(f"{rows} × {columns} nodes {origin}, written to {out / 'dem.tif'}")
    for name, setting in result.hyperparameters.items():
        typer.echo(f"  {name} = {setting:.6g}" if isinstance(setting, float) else f"  {name} = {setting}")

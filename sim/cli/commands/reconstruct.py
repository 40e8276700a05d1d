"""``firnline reconstruct``: a map from measured points or LiDAR scans."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sim.cli.options import RUNS, Json, Quiet, Runs, Settings, Verbose
from sim.cli.outcome import with_exit_codes

if TYPE_CHECKING:
    from sim.cli.mapping.inputs import MapRequest

_Sources = Annotated[
    list[Path],
    typer.Argument(
        help="Points (CSV, GeoPackage, LAS/LAZ, PLY), a mission file (TOML), or LiDAR scans and folders of them "
        "(npz, LAS/LAZ, PLY, ROS 2) for carving, emap and field."
    ),
]
_Prior = Annotated[Path | None, typer.Option("--prior", help="Coarse elevation raster to build around.")]
_Product = Annotated[
    str | None,
    typer.Option(
        "--product",
        help="Class of the prior, which sets what errors to expect: copernicus-30, srtm-90, aster-30, arcticdem-2, "
        "unknown, or unbiased for exact level and independent errors.  [default: unknown]",
    ),
]
_Grid = Annotated[
    float | None,
    typer.Option("--grid", help="Distance between the nodes of the map [m]; 1, and 0.25 for scans."),
]
_Area = Annotated[
    Path | None,
    typer.Option("--area", help="Polygon file to map; without it the bounding box of the points."),
]
_Method = Annotated[
    str | None,
    typer.Option(
        "--method", help="gp, joint, dense or tin; carving, emap or field for scans.  [default: gp]"
    ),
]
_Value = Annotated[
    str | None, typer.Option("--value", help="Map this sampled quantity instead of elevation.")
]
_Crs = Annotated[str | None, typer.Option("--crs", help="CRS of points that carry none, e.g. EPSG:32608.")]
_Sigma = Annotated[
    float | None, typer.Option("--sigma", help="Standard deviation of points that state none [m].")
]
_Trajectory = Annotated[
    Path | None,
    typer.Option(
        "--trajectory",
        help="Path that the points were seen from: trajectory.csv with its trajectory.error.npz for the method joint, "
        "TUM for scans that do not state where the scanner was.",
    ),
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


@with_exit_codes
def reconstruct(
    sources: _Sources,
    prior: _Prior = None,
    product: _Product = None,
    grid: _Grid = None,
    area: _Area = None,
    method: _Method = None,
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

    Settings of the methods are those of a mission: --set reconstruction.gp.family=matern-3/2.

    For example:

      firnline reconstruct landmarks.csv --crs EPSG:32608 --prior srtm.tif --grid 2 --area site.gpkg

      firnline reconstruct cloud.laz --method tin -o map

      firnline reconstruct surface_points.gpkg --method joint --trajectory trajectory.csv

      firnline reconstruct scans/ --method field --rays --max-slope 20 --crs EPSG:32608 --sigma 0.03

      firnline reconstruct mine.toml
    """
    if sources[0].suffix == ".toml":
        from sim.cli.mission_file import print_summary, run_until

        _, run = run_until(
            sources[0], "reconstruct", runs=runs, settings=settings, quiet=quiet, verbose=verbose
        )
        print_summary(run, as_json=as_json)
        return
    from sim.cli.mapping.inputs import map_request

    _refuse_max_slope(max_slope, rays=rays)
    request = map_request(
        sources,
        method=method,
        step_m=grid,
        rays=rays,
        product=product,
        settings=settings or (),
        prior=prior,
        area=area,
        value=value,
        crs=crs,
        sigma_m=sigma,
        trajectory=trajectory,
        quiet=quiet,
    )
    _map(request, out, max_slope_deg=max_slope, force=force, as_json=as_json)


def _map(
    request: "MapRequest", out: Path, *, max_slope_deg: float | None, force: bool, as_json: bool
) -> None:
    """Check the output, make the map, write and print it."""
    from sim.cli.mapping.outputs import OWN_FILES, print_map, write_map
    from sim.cli.mapping.points import map_points
    from sim.cli.mapping.scans import map_scan_files
    from sim.cli.outputs import refuse_existing

    refuse_existing([out], force=force, inputs=request.inputs, own=OWN_FILES)
    made = map_scan_files(request) if request.is_of_scans else map_points(request)
    write_map(made, out, rays=request.config.rays, max_slope_deg=max_slope_deg)
    print_map(made, out, as_json=as_json)


def _refuse_max_slope(max_slope_deg: float | None, *, rays: bool) -> None:
    from survey.core.errors import InputError

    if max_slope_deg is not None and not rays:
        raise InputError("steep ground is found from the map's bounds; add --rays to --max-slope.")

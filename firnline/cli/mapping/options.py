"""Options of ``firnline reconstruct``."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer

from firnline.cli.options import RunOptions, columns_option, epoch_option


@dataclass(frozen=True, kw_only=True)
class ReconstructOptions(RunOptions):
    """Options of the command; None stands for an option that was not given."""

    sources: Annotated[
        list[Path],
        typer.Argument(
            help="Points (text tables, vector files, LAS/LAZ, PLY), a mission file (TOML), LiDAR scans and folders of them "
            "(npz, LAS/LAZ, PLY, KITTI, ROS 2) for carving, emap and field, or scans in the sensor's frame (recording, "
            "KITTI, ROS 2) with --trajectory for all methods."
        ),
    ]
    prior: Annotated[
        Path | None, typer.Option("--prior", help="Coarse elevation raster to build around.")
    ] = None
    product: Annotated[
        str | None,
        typer.Option(
            "--product",
            help="Class of the prior, which sets what errors to expect: copernicus-30, srtm-90, aster-30, arcticdem-2, "
            "unknown, or unbiased for exact level and independent errors.  [default: unknown]",
        ),
    ] = None
    step_m: Annotated[
        float | None,
        typer.Option("--grid", help="Distance between the nodes of the map [m]; 1, and 0.25 for scans."),
    ] = None
    area: Annotated[
        Path | None,
        typer.Option("--area", help="Polygon file to map; without it the bounding box of the points."),
    ] = None
    method: Annotated[
        str | None,
        typer.Option(
            "--method", help="gp, joint, dense or tin; carving, emap or field for scans.  [default: gp]"
        ),
    ] = None
    value: Annotated[
        str | None, typer.Option("--value", help="Map this sampled quantity instead of elevation.")
    ] = None
    crs: Annotated[
        str | None, typer.Option("--crs", help="CRS of points that carry none, e.g. EPSG:32608.")
    ] = None
    sigma_m: Annotated[
        float | None, typer.Option("--sigma", help="Standard deviation of points that state none [m].")
    ] = None
    columns: Annotated[
        list[str],
        columns_option("Columns of a table of points: x, y, z, lon, lat, sigma_z; usual names are found."),
    ] = field(default_factory=list)
    trajectories: Annotated[
        list[Path],
        typer.Option(
            "--trajectory",
            help="Path that the points were seen from: trajectory.csv with its trajectory.error.npz for the method joint "
            "and for scans in the sensor's frame (one for each source, in their order), TUM for scans that do not state where the scanner was.",
        ),
    ] = field(default_factory=list)
    ties: Annotated[
        Path | None,
        typer.Option(
            "--ties",
            help="With --method joint and several drives: places that two of them saw from above (ties.csv); drives are "
            "numbered from 0 in the order of the sources.",
        ),
    ] = None
    epoch_s: Annotated[
        float | None,
        epoch_option(
            "With --method joint on moving ice, whose motion stands beside the trajectory: the time of which the map is, in "
            "seconds of the recording; that of localization when left out."
        ),
    ] = None
    rays: Annotated[
        bool,
        typer.Option(
            "--rays", help="Let lines of sight to the ground bound the map from above, and draw its bounds."
        ),
    ] = False
    max_slope_deg: Annotated[
        float | None,
        typer.Option(
            "--max-slope",
            help="With --rays: write no_go.tif, the ground that the bounds show to be steeper [deg].",
        ),
    ] = None
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for dem.tif and reconstruction.json.")] = (
        Path("reconstruction")
    )
    tiles: Annotated[
        bool,
        typer.Option(
            "--tiles",
            help="Map point files of any size (LAS/LAZ, COPC, PLY, Parquet, folders) tile by tile; a killed run goes on by "
            "the same command.",
        ),
    ] = False
    workers: Annotated[
        int | None,
        typer.Option("--workers", min=1, help="With --tiles: processes; one for each core when left out."),
    ] = None
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", help="With --tiles: a dask scheduler, tcp://host:port.")
    ] = None
    control: Annotated[
        Path | None,
        typer.Option("--control", help="With --tiles: control points (GNSS) with their standard deviations."),
    ] = None
    force: Annotated[bool, typer.Option("--force", help="Replace a reconstruction that is there.")] = False

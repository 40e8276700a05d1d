"""``firnline localize``: path and landmarks from a recording."""

import json
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sim.cli.options import Json, Quiet
from sim.cli.outcome import refusals_told

if TYPE_CHECKING:
    from vision_slam.recordings import RecordedDrive
    from vision_slam.results import Compared, Localized


_Source = Annotated[
    Path,
    typer.Argument(help="Recording, ROS bag, or folder in KITTI, TUM, EuRoC layout or of images with times."),
]
_Camera = Annotated[
    Path | None, typer.Option("--camera", help="Calibration (camera.toml), instead of the layout's own.")
]
_Topic = Annotated[
    list[str] | None, typer.Option("--topic", help="Topic of a bag to take, where several would do.")
]
_Gps = Annotated[
    Path | None, typer.Option("--gps", help="Fixes recorded beside the images: NMEA, .gpx or .csv.")
]
_Crs = Annotated[
    str | None,
    typer.Option(
        "--crs", help="Projected CRS to work in, e.g. EPSG:32608; the fixes' UTM zone unless named."
    ),
]
_GpsShift = Annotated[
    float,
    typer.Option("--gps-shift", help="Add to the times of the fixes to get those of the images [s]."),
]
_ScaleFrom = Annotated[
    float | None,
    typer.Option(
        "--scale-from", help="Without wheels and fixes: scale from the reference's first metres [m]."
    ),
]
_Reference = Annotated[
    Path | None,
    typer.Option("--reference", help="Path to judge by (.tum or .csv), not shown to the estimator."),
]
_Viewer = Annotated[
    Path | None, typer.Option("--viewer", help="Also write a file for rerun's viewer, e.g. drive.rrd.")
]
_Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Override what is assumed, as in a mission file, e.g. localization.gps_bias_sigma_m=3.0.",
    ),
]
_Out = Annotated[Path, typer.Option("--out", "-o", help="Folder for path, landmarks, health and pictures.")]
_Force = Annotated[bool, typer.Option("--force", help="Replace a localization that is there.")]


@refusals_told
def localize(
    source: _Source,
    camera: _Camera = None,
    topic: _Topic = None,
    gps: _Gps = None,
    crs: _Crs = None,
    gps_shift: _GpsShift = 0.0,
    scale_from: _ScaleFrom = None,
    reference: _Reference = None,
    viewer: _Viewer = None,
    settings: _Settings = None,
    out: _Out = Path("localization"),
    force: _Force = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Estimate where a rover was, and where its landmarks are, from what it recorded.

    For example:

      firnline localize results/runs/mine/latest/2-simulate/recording

      firnline localize KITTI_sequence_1 --scale-from 10

      firnline localize my-images --camera camera.toml --gps log.nmea

      firnline localize my-images --gps track.gpx --set localization.landmark_thinning=information

      firnline localize drive.bag --topic /left/image_raw --viewer drive.rrd

    Written are trajectory.tum and health.csv, landmarks.csv, the pictures map.png and tracks.png,
    with fixes also trajectory.csv (covariances), online_trajectory.csv (what was known at every
    moment), track.gpkg and landmarks.gpkg in their CRS, and
    with a reference errors.png. Without fixes the path counts from the first image. A folder of
    images takes its times from frames.csv (time_s,file), times.txt or the names of the files, its
    calibration from camera.toml, and wheels.csv and inertial.csv where they are there.
    """
    from vision_slam.recordings import open_drive
    from vision_slam.results import refuse_existing

    refuse_existing(out, force=force)
    if viewer is not None:
        from vision_slam.viewer import refuse_without_rerun

        refuse_without_rerun()
    drive = open_drive(
        source,
        camera=camera,
        topics=topic or [],
        gps=gps,
        crs=crs,
        gps_shift_s=gps_shift,
        scale_from_m=scale_from,
    )
    judge = None if reference is None else drive.read_reference(reference)
    localized, seconds = _timed(drive, settings or [], quiet=quiet)
    compared = drive.compared(localized, judge)
    _write(out, viewer, drive, localized, compared)
    _tell(_told(drive, localized, compared, seconds), out, as_json=as_json)


def _timed(drive: "RecordedDrive", settings: list[str], *, quiet: bool) -> "tuple[Localized, float]":
    """Return path and landmarks, and the seconds that they took."""
    from sim.cli.progress import counted

    assumed = drive.assumed(settings)
    began = perf_counter()
    with counted(quiet=quiet) as progress:
        localized = drive.localized(assumed, progress)
    return localized, perf_counter() - began


def _write(
    out: Path,
    viewer: Path | None,
    drive: "RecordedDrive",
    localized: "Localized",
    compared: "Compared | None",
) -> None:
    """Write files and pictures, and what rerun's viewer shows where that is wanted."""
    from vision_slam.results import pictures_of, write_localization, write_pictures

    write_localization(out, localized)
    write_pictures(out, pictures_of(localized, drive.sensed, drive.gps, compared))
    if viewer is not None:
        from vision_slam.viewer import write_rrd

        write_rrd(viewer, localized, drive.sensed)


def _tell(told: dict[str, Any], out: Path, *, as_json: bool) -> None:
    """Print the account, for people or as JSON."""
    if as_json:
        typer.echo(json.dumps(told, indent=2))
        return
    typer.echo(f"written to {out}")
    for name, value in told.items():
        typer.echo(f"  {name} = {value:.6g}" if isinstance(value, float) else f"  {name} = {value}")


def _told(
    drive: "RecordedDrive", localized: "Localized", compared: "Compared | None", seconds: float
) -> dict[str, Any]:
    """Return what the command prints."""
    told: dict[str, Any] = {
        "poses": len(localized.time_s),
        "length_m": localized.length_m,
        "landmarks": len(localized.landmarks),
    }
    if localized.found is not None:
        n_blind = sum(not frame.is_visual for frame in localized.found.health[1:])
        told |= {"frames_without_vision": n_blind, "frames_lost": int(localized.found.is_lost.sum())}
        told["frames_per_s"] = len(localized.found.health) / max(seconds, 1e-9)
    if compared is not None:
        told |= compared.figures
    if drive.notes:
        told["notes"] = "; ".join(drive.notes)
    return told

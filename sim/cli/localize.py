"""``firnline localize``: path and landmarks from a recording."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sim.cli.options import Json, Quiet
from sim.cli.outcome import refusals_told

if TYPE_CHECKING:
    from survey.recording import Recording
    from vision_slam.sequence import ImageSequence


@refusals_told
def localize(
    source: Annotated[Path, typer.Argument(help="Recording, or folder in KITTI, TUM or EuRoC layout.")],
    gps: Annotated[
        Path | None, typer.Option("--gps", help="Fixes of a foreign recording (NMEA, GPX, CSV).")
    ] = None,
    crs: Annotated[
        str | None, typer.Option("--crs", help="CRS to work in, with --gps, e.g. EPSG:32608.")
    ] = None,
    scale_from: Annotated[
        float | None,
        typer.Option("--scale-from", help="Take the scale from the reference's first metres [m]."),
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for path, landmarks and health.")] = Path(
        "localization"
    ),
    force: Annotated[bool, typer.Option("--force", help="Replace a localization that is there.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Estimate where a rover was, and where its landmarks are.

    For example:

      firnline localize results/runs/mine/simulate/recording

      firnline localize KITTI_sequence_1 --scale-from 10

      firnline localize my-images --gps log.nmea --crs EPSG:32608
    """
    import json

    from sim.cli.progress import counted
    from survey.errors import InputError
    from survey.recording import Recording

    if (out / "trajectory.tum").exists() and not force:
        raise InputError(f"{out} holds a localization; choose another folder with --out or add --force.")
    with counted(quiet=quiet) as progress:
        if (source / "recording.json").is_file():
            told = _of_recording(Recording.read(source), out, progress)
        else:
            told = _of_sequence(source, gps, crs, scale_from, out, progress)
    if as_json:
        typer.echo(json.dumps(told, indent=2))
        return
    typer.echo(f"written to {out}")
    for name, value in told.items():
        typer.echo(f"  {name} = {value:.6g}" if isinstance(value, float) else f"  {name} = {value}")


def _of_recording(recording: "Recording", out: Path, progress: Any) -> dict[str, Any]:
    """Localize in the world and write trajectory, track, landmarks and, of images, their health."""
    from survey.io.tracks import write_track
    from vision_slam.pipeline import localize as estimate
    from vision_slam.pipeline import localize_by_images

    found = None
    if recording.odometry is None and recording.frames is not None:
        trajectory, points, found = localize_by_images(recording, progress=progress)
    else:
        trajectory, points = estimate(recording)
    out.mkdir(parents=True, exist_ok=True)
    trajectory.write(out / "trajectory.tum")
    trajectory.write(out / "trajectory.csv")
    write_track(out / "track.gpkg", trajectory.time_s, trajectory.position, trajectory.crs)
    points.write(out / "landmarks.csv")
    told: dict[str, Any] = {
        "poses": len(trajectory),
        "length_m": trajectory.length_m,
        "landmarks": len(points.xyz),
    }
    if found is not None:
        told |= _health_written(found, out)
    return told


def _of_sequence(
    source: Path, gps: Path | None, crs: str | None, scale_from: float | None, out: Path, progress: Any
) -> dict[str, Any]:
    """Localize someone else's images: in the world with fixes, else relative to the first image."""
    from survey.errors import ConfigError
    from survey.geodesy import projected_crs
    from survey.recording import Recording
    from vision_slam.gps_files import read_gps
    from vision_slam.readers import read_sequence
    from vision_slam.sequence import scaled_by_first

    sequence = read_sequence(source)
    if scale_from is not None:
        sequence = scaled_by_first(sequence, scale_from)
    if gps is None:
        return _relative(sequence, out, progress)
    if crs is None:
        raise ConfigError("--gps needs --crs, the projected CRS to work in, e.g. EPSG:32608.")
    fixes = read_gps(gps, crs)
    recording = Recording(
        crs=projected_crs(crs, "--crs"),
        start=fixes.position[0],
        gps=fixes,
        camera=sequence.camera,
        frames=sequence.frames,
        wheels=sequence.wheels,
        inertial=sequence.inertial,
    )
    return _of_recording(recording, out, progress)


def _relative(sequence: "ImageSequence", out: Path, progress: Any) -> dict[str, Any]:
    import numpy as np

    from survey.io.tracks import write_tum
    from vision_slam.evaluation import absolute_errors_m, matched_times
    from vision_slam.pipeline import dead_reckoning
    from vision_slam.rotation import quaternions
    from vision_slam.visual_slam import visual_odometry

    found = visual_odometry(sequence, progress=progress)
    attitude, times = found.odometry.attitude_rad, found.odometry.time_s
    path = dead_reckoning(found.odometry, np.zeros(3))
    out.mkdir(parents=True, exist_ok=True)
    write_tum(out / "trajectory.tum", np.column_stack([times, path, quaternions(attitude)]))
    length_m = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    told: dict[str, Any] = {"poses": len(times), "length_m": length_m}
    told |= _health_written(found, out)
    if sequence.reference is not None and sequence.reference_time_s is not None:
        estimated, real = matched_times(times, sequence.reference_time_s)
        reference = sequence.reference[real, :3, 3]
        in_first = (reference - sequence.reference[real[0], :3, 3]) @ sequence.reference[real[0], :3, :3]
        error = absolute_errors_m(path[estimated] - path[estimated[0]], in_first)
        told |= {"end_error_m": float(error[-1]), "worst_error_m": float(error.max())}
        travelled = np.linalg.norm(np.diff(in_first, axis=0), axis=1).sum()
        told["end_error_per_cent"] = float(100.0 * error[-1] / travelled)
    return told


def _health_written(found: Any, out: Path) -> dict[str, Any]:
    import numpy as np

    from survey.io.tables import write_table

    names = ("entropy_bits", "saturated", "sharpness", "n_followed", "n_inliers", "is_visual")
    columns = {
        name: np.array([getattr(frame, name) for frame in found.health], dtype=float) for name in names
    }
    columns = {"time_s": found.odometry.time_s} | columns | {"is_lost": found.is_lost.astype(float)}
    write_table(out / "health.csv", columns)
    n_blind = int((columns["is_visual"][1:] == 0).sum())
    return {"frames_without_vision": n_blind, "frames_lost": int(found.is_lost.sum())}

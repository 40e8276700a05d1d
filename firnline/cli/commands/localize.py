"""``firnline localize``: path and landmarks from a recording."""

import json
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, NoReturn

import typer

from firnline.actions.interface import end_dry_run, fact_line, figure_lines
from firnline.actions.localizing import LocalizeRequest
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import with_options_of

if TYPE_CHECKING:
    from survey.data.ice.motion import IceMotion
    from vision_slam.comparison import Comparison
    from vision_slam.drive_estimate import DriveEstimate
    from vision_slam.recorded_drive import RecordedDrive


@with_exit_codes
@with_options_of(LocalizeRequest)
def localize(request: LocalizeRequest) -> None:
    """Estimate the path of a rover and its landmarks from a recording.

    For example:

      firnline localize results/runs/mine/latest/2-simulate/recording

      firnline localize KITTI_sequence_1 --scale-from 10

      firnline localize my-images --camera camera.toml --gps log.nmea

      firnline localize phone-photos --camera camera.toml --gps gnss_log.txt

      firnline localize video-frames --frame-rate 30 --gps fixes.csv --columns time=t,lat=phi,lon=lambda

      firnline localize my-images --gps track.gpx --set localization.landmark_thinning=information

      firnline localize glacier-drive --gps log.ubx --epoch 14400

      firnline localize drive.bag --topic /left/image_raw --viewer drive.rrd

    Written are trajectory.tum and health.csv, landmarks.csv, the pictures map.png and tracks.png,
    with fixes also trajectory.csv (covariances), online_trajectory.csv (the causal path),
    track.gpkg and landmarks.gpkg in their CRS, and with a reference errors.png. No landmarks are
    written where the fixes contradict the images so much that the path is that of the fixes. Without fixes the
    path is relative to the first image, and path.csv has its standard deviations. A folder of
    images takes its times from frames.csv (time_s,file), times.txt, the names of the files or
    EXIF, its calibration from camera.toml (see firnline calibrate) or the focal length in EXIF,
    positions in EXIF as fixes, and wheels.csv and inertial.csv where they are there.
    """
    request.check_outputs()
    drive = request.open()
    motion = request.prior_motion(drive)
    judge = None if request.reference is None else drive.read_reference(request.reference)
    if request.dry_run:
        _end_dry_run(drive, request)
    estimate, seconds = _timed(drive, request.overrides, motion, quiet=request.quiet)
    comparison = drive.compare(estimate, judge)
    _write(request.out, request.viewer, drive, estimate, comparison)
    notes = (*drive.notes, *estimate.notes)
    _print(_summary(estimate, comparison, seconds), notes, request.out, as_json=request.as_json)


def _end_dry_run(drive: "RecordedDrive", request: LocalizeRequest) -> NoReturn:
    """Check the settings, and print what was read."""
    drive.config(request.overrides)
    drive.visual_config(request.overrides)
    facts: dict[str, object] = {
        "images": 0 if drive.frames is None else len(drive.frames.time_s),
        "fixes": 0 if drive.gps is None else len(drive.gps.time_s),
    }
    end_dry_run([request.out], facts | {f"note {k}": note for k, note in enumerate(drive.notes, start=1)})


def _timed(
    drive: "RecordedDrive", settings: list[str], motion: "IceMotion | None", *, quiet: bool
) -> "tuple[DriveEstimate, float]":
    """Return path and landmarks, and the seconds that they took."""
    from firnline.cli.progress import counted

    config, visual_config = drive.config(settings), drive.visual_config(settings)
    began = perf_counter()
    with counted(quiet=quiet) as progress:
        estimate = drive.localize(config, progress, visual_config=visual_config, motion=motion)
    return estimate, perf_counter() - began


def _write(
    out: Path,
    viewer: Path | None,
    drive: "RecordedDrive",
    estimate: "DriveEstimate",
    comparison: "Comparison | None",
) -> None:
    """Write files and pictures, and the file of rerun's viewer where it is asked for."""
    from survey.core.files.replacing import replacing_folder
    from vision_slam.results import OWN_FILES, pictures_of, write_localization, write_pictures

    with replacing_folder(out, own=OWN_FILES) as folder:
        write_localization(folder, estimate)
        write_pictures(folder, pictures_of(estimate, drive.records, drive.gps, comparison))
    if viewer is not None:
        from vision_slam.viewer import write_rrd

        write_rrd(viewer, estimate, drive.records)


def _print(summary: dict[str, Any], notes: Sequence[str], out: Path, *, as_json: bool) -> None:
    """Print the summary as text or as JSON."""
    if as_json:
        stated = {"notes": "; ".join(notes)} if notes else {}
        typer.echo(json.dumps(summary | stated, indent=2))
        return
    typer.echo(f"written to {out}")
    for line in figure_lines(summary):
        typer.echo(line)
    for note in notes:
        typer.echo(fact_line("note", note))
    typer.echo(fact_line("pictures", ", ".join(str(file) for file in sorted(out.glob("*.png")))))
    if (out / "landmarks.gpkg").exists():
        typer.echo(fact_line("next", f"firnline reconstruct {out / 'landmarks.gpkg'} --prior DEM.tif"))
    elif (out / "track.gpkg").exists():
        typer.echo(
            fact_line("next", "correct calibration or times as the notes name them, and localize again")
        )
    else:
        typer.echo(fact_line("next", "name fixes with --gps for a path in a CRS, or wheels.csv for metres"))


def _summary(estimate: "DriveEstimate", comparison: "Comparison | None", seconds: float) -> dict[str, Any]:
    """Return the figures that the command prints."""
    import numpy as np

    summary: dict[str, Any] = {
        "poses": len(estimate.time_s),
        "length_m": estimate.length_m,
        "landmarks": len(estimate.landmarks),
    }
    visual = estimate.visual_odometry
    if visual is not None:
        n_blind = sum(not frame.is_visual for frame in visual.health[1:])
        summary |= {"frames_without_vision": n_blind, "frames_lost": int(visual.is_lost.sum())}
        summary["frames_per_s"] = len(visual.health) / max(seconds, 1e-9)
    if estimate.covariance is not None:
        summary["end_sigma_m"] = float(np.sqrt(np.linalg.eigvalsh(estimate.covariance[-1, :2, :2])[-1]))
    if estimate.is_lost is not None:
        summary["poses_lost"] = int(estimate.is_lost.sum())
    if estimate.trajectory is not None:
        summary |= {"fixes": estimate.n_fixes, "fixes_refused": estimate.n_fixes_refused}
    if estimate.ice_motion is not None:
        summary |= _motion_figures(estimate.ice_motion)
    if comparison is not None:
        summary |= comparison.figures
    return summary


def _motion_figures(motion: "IceMotion") -> dict[str, float]:
    """Return speed and lowering where changes of velocity count from, with their standard deviations."""
    import numpy as np

    (east, north, rise), sigma = (one(motion.origin_m[None])[0] for one in (motion.rates, motion.rates_sigma))
    return {
        "ice_speed_m_per_day": float(np.hypot(east, north)),
        "ice_speed_sigma_m_per_day": float(sigma[:2].max()),
        "ice_lowering_m_per_day": float(-rise),
        "ice_lowering_sigma_m_per_day": float(sigma[2]),
    }

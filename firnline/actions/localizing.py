"""Estimate the path of a rover and its landmarks from a recording."""

from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Any, Literal

import survey
from firnline.actions.interface import (
    Argument,
    Option,
    Preview,
    Progress,
    WrittenResult,
    fact_line,
    figure_lines,
    needs_live_extra,
    no_progress,
    previewed_by,
    refuse_existing,
)
from firnline.actions.requests import PictureOptions, antenna_option, columns_option, epoch_option
from survey.core import ConfigError, InputError

if TYPE_CHECKING:
    from survey.data.ice_motion import IceMotion
    from vision_slam.drive_estimate import DriveEstimate
    from vision_slam.evaluation import Comparison
    from vision_slam.recorded_drive import RecordedDrive


_ICE = "ice."


@dataclass(frozen=True, kw_only=True)
class LocalizeRequest(PictureOptions):
    """Recording to localize; None stands for an option that was not given."""

    source: Annotated[
        Path,
        Argument(
            help="Recording, ROS bag, folder in KITTI, TUM, EuRoC layout or of images with times, log of an autopilot "
            "(ArduPilot .bin .tlog, PX4 .ulg) or of a receiver (.ubx, NMEA, .gpx, .pos, GrafNav, .csv).",
            reads="the recording",
        ),
    ]
    camera: Annotated[
        Path | None,
        Option(
            "--camera",
            help="Calibration (camera.toml), instead of the layout's own.",
            reads="the calibration",
        ),
    ] = None
    topics: Annotated[
        list[str], Option("--topic", help="Topic of a bag, where it has several of a kind.")
    ] = field(default_factory=list)
    gps: Annotated[
        Path | None,
        Option(
            "--gps",
            help="Fixes recorded beside the images: NMEA, u-blox .ubx, GnssLogger .txt, RTKLIB .pos, .gpx or .csv.",
        ),
    ] = None
    columns: Annotated[
        list[str],
        columns_option(
            "Columns of a table of fixes where their names are not usual ones, e.g. time=t,x=Easting,y=Northing,z=H; keys: time, x, y, z, lon, lat, sigma_xy."
        ),
    ] = field(default_factory=list)
    frame_rate_hz: Annotated[
        float | None,
        Option(
            "--frame-rate",
            min=1e-3,
            help="Images per second, where neither names nor files state times [Hz].",
        ),
    ] = None
    crs: Annotated[
        str | None,
        Option("--crs", help="Projected CRS to work in, e.g. EPSG:32608; the fixes' UTM zone unless named."),
    ] = None
    gps_shift_s: Annotated[
        float, Option("--gps-shift", help="Add to the times of the fixes to get those of the images [s].")
    ] = 0.0
    antenna_m: Annotated[float | None, antenna_option()] = None
    scale_from_m: Annotated[
        float | None,
        Option("--scale-from", help="Without wheels and fixes: scale from the reference's first metres [m]."),
    ] = None
    epoch_s: Annotated[
        float | None,
        epoch_option(
            "The ice moves: estimate its motion, and give path and landmarks of this time of the recording [s]. Its prior, "
            "0 ± 3 m a day, is set by --set ice.velocity_m_per_day, ice.velocity_sigma_m_per_day, ice.velocity_files (four rasters) "
            "and others."
        ),
    ] = None
    reference: Annotated[
        Path | None,
        Option(
            "--reference",
            help="Reference path to compare with (.tum, .csv, KITTI poses, or fixes as --gps takes them); the estimator does not use it.",
        ),
    ] = None
    viewer: Annotated[
        Path | None, Option("--viewer", help="Also write a file for rerun's viewer, e.g. drive.rrd.")
    ] = None
    settings: Annotated[
        list[str],
        Option(
            "--set",
            metavar="KEY=VALUE",
            help="Override an assumed sensor error, as in a mission file, e.g. localization.gps_bias_sigma_m=3.0, or a setting of visual odometry, e.g. visual.n_features=500.",
        ),
    ] = field(default_factory=list)
    lens: Annotated[
        Literal["auto", "given", "refine"],
        Option(
            "--lens",
            help="Estimate radial distortion and focal length from the images, or use them as given; auto estimates them where the calibration states no distortion.",
        ),
    ] = "auto"
    out: Annotated[Path, Option("--out", "-o", help="Folder for path, landmarks, health and pictures.")] = (
        Path("localization")
    )
    force: Annotated[bool, Option("--force", help="Replace an existing localization.")] = False

    @property
    def overrides(self) -> list[str]:
        """Settings as KEY=VALUE, with that of the lens."""
        own = [one for one in self.settings if not one.startswith(_ICE)]
        return own if self.lens == "auto" else [*own, f"visual.lens={self.lens}"]

    def prior_motion(self, drive: "RecordedDrive") -> "IceMotion | None":
        """Return the prior of the motion of the ice; None where no epoch was named.

        Raises
        ------
        InputError
            Settings of the motion without an epoch, or a recording without fixes.
        """
        from sim.config.world import IceAssumptions
        from sim.world.moving_ice import assumed_motion
        from survey.core import validated, with_overrides

        stated = [one for one in self.settings if one.startswith(_ICE)]
        if self.epoch_s is None:
            if stated:
                raise InputError(f"--set {stated[0]} is of moving ice; add --epoch, or leave it out.")
            return None
        if not isinstance(drive.records, survey.Recording):
            raise InputError(
                "--epoch estimates the motion of the ice, and the recording has no fixes; add --gps, or leave --epoch out."
            )
        values = with_overrides({"ice": {}}, stated)["ice"]
        assumed = validated(IceAssumptions, values, "--set")
        records = drive.records
        return assumed_motion(assumed, self.epoch_s, records.gps.position[:, :2], records.crs)

    def check_outputs(self) -> None:
        """Refuse outputs that exist or are inputs, and a viewer's file that cannot be written."""
        from vision_slam.results import OWN_FILES

        inputs = (self.source, self.camera, self.gps, self.reference)
        refuse_existing([self.out], force=self.force, inputs=inputs, own=OWN_FILES)
        if self.viewer is not None:
            from vision_slam.results import refuse_without_rerun

            refuse_existing([self.viewer], force=self.force, inputs=inputs)
            refuse_without_rerun()

    def open(self) -> "RecordedDrive":
        """Open the recording with the files and options that belong to it."""
        from vision_slam.recordings import open_recording

        if self.source.suffix.lower() in LOG_ENDINGS and not self.source.is_dir():
            self._refuse_image_options()
            return opened_log(self.source, self.crs, self.antenna_m)

        return open_recording(
            self.source,
            camera=self.camera,
            topics=self.topics,
            gps=self.gps,
            crs=self.crs,
            gps_shift_s=self.gps_shift_s,
            scale_from_m=self.scale_from_m,
            columns=self.columns,
            frame_rate_hz=self.frame_rate_hz,
            antenna_m=self.antenna_m,
        )

    def _refuse_image_options(self) -> None:
        """Refuse options of images and of other fixes beside the log of an autopilot."""
        given = {
            "--camera": self.camera,
            "--topic": self.topics or None,
            "--gps": self.gps,
            "--scale-from": self.scale_from_m,
            "--columns": self.columns or None,
            "--frame-rate": self.frame_rate_hz,
        }
        stated = [name for name, value in given.items() if value is not None]
        if stated:
            raise ConfigError(
                f"{self.source.name} is the log of an autopilot with fixes of its own; leave {', '.join(stated)} out."
            )


@dataclass(frozen=True, kw_only=True)
class LocalizationResult(WrittenResult):
    """Path and landmarks of a drive.

    Parameters
    ----------
    request : LocalizeRequest
        What was asked for.
    drive : RecordedDrive
        The recording.
    estimate : DriveEstimate
        Path and landmarks.
    comparison : Comparison, optional
        Comparison with the reference.
    seconds : float
        Time that the estimate took [s].
    """

    request: LocalizeRequest
    drive: "RecordedDrive"
    estimate: "DriveEstimate"
    comparison: "Comparison | None"
    seconds: float

    def _write_files(self) -> None:
        """Write files and pictures, and the file of rerun's viewer where it is asked for."""
        from survey.core import replacing_folder
        from vision_slam.results import OWN_FILES, draw_localization, write_localization

        drive, estimate = self.drive, self.estimate
        with replacing_folder(self.request.out, own=OWN_FILES) as folder:
            write_localization(folder, estimate)
            self.request.write_pictures(
                folder, lambda: draw_localization(estimate, drive.records, drive.gps, self.comparison)
            )
        if self.request.viewer is not None:
            from vision_slam.results import write_rrd

            write_rrd(self.request.viewer, estimate, drive.records)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the reader and the estimator did or assumed."""
        return (*self.drive.notes, *self.estimate.notes)

    def facts(self) -> dict[str, Any]:
        """Return the figures of path, landmarks and comparison."""
        stated = {"notes": "; ".join(self.remarks)} if self.remarks else {}
        return self._figures | stated

    @property
    def _figures(self) -> dict[str, Any]:
        return _summary(self.estimate, self.comparison, self.seconds)

    def lines(self) -> list[str]:
        """Return the figures, notes, pictures, and the next step."""
        out = self.request.out
        if (
            (out / "landmarks.gpkg").exists()
            and self.estimate.visual_odometry is None
            and self.drive.gps is not None
        ):
            names = f"{out / 'landmarks.gpkg'} --trajectory {out / 'trajectory.csv'}"
            step = f"firnline reconstruct {names} --method joint"
        elif self.drive.no_ground:
            step = "use trajectory.csv or track.gpkg as the path; the notes say how points of the ground are made"
        elif (out / "landmarks.gpkg").exists():
            step = f"firnline reconstruct {out / 'landmarks.gpkg'} --prior DEM.tif"
        elif (out / "track.gpkg").exists():
            step = "correct calibration or times as the notes name them, and localize again"
        else:
            step = "name fixes with --gps for a path in a CRS, or wheels.csv for metres"
        pictures = sorted(map(str, out.glob(f"*.{self.request.pictures}")))
        return [
            f"written to {out}",
            *figure_lines(self._figures),
            *(fact_line("note", note) for note in self.remarks),
            *([fact_line("pictures", ", ".join(pictures))] if pictures else []),
            fact_line("next", step),
        ]


def preview_localization(request: LocalizeRequest) -> Preview:
    """Read a recording and check the settings, and return what was read."""
    drive, _, _ = _opened(request)
    drive.config(request.overrides)
    drive.visual_config(request.overrides)
    facts: dict[str, object] = {
        "images": 0 if drive.records.frames is None else len(drive.records.frames.time_s),
        "fixes": 0 if drive.gps is None else len(drive.gps.time_s),
    }
    notes = {f"note {k}": note for k, note in enumerate(drive.notes, start=1)}
    return Preview.of([request.out], facts | notes)


@previewed_by(preview_localization)
def localize(request: LocalizeRequest, progress: Progress = no_progress) -> LocalizationResult:
    """Estimate the path of a rover and its landmarks from a recording.

    Parameters
    ----------
    request : LocalizeRequest
        Recording, calibration, fixes and settings.
    progress : callable
        Called with what is done, how many are done, and how many there are.

    Returns
    -------
    LocalizationResult
        Path and landmarks; `LocalizationResult.write` writes them.

    Raises
    ------
    InputError
        Input that cannot be used, or an output that exists.
    ConfigError
        A setting that is unknown or wrong.
    """
    drive, motion, judge = _opened(request)
    config, visual_config = drive.config(request.overrides), drive.visual_config(request.overrides)
    began = perf_counter()
    estimate = drive.localize(config, progress, visual_config=visual_config, motion=motion)
    seconds = perf_counter() - began
    return LocalizationResult(
        request=request,
        drive=drive,
        estimate=estimate,
        comparison=drive.compare(estimate, judge),
        seconds=seconds,
    )


def _opened(request: LocalizeRequest) -> "tuple[RecordedDrive, IceMotion | None, Any]":
    """Return the recording, the prior of the motion of the ice, and the reference."""
    request.check_outputs()
    drive = request.open()
    motion = request.prior_motion(drive)
    return drive, motion, None if request.reference is None else drive.read_reference(request.reference)


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


LOG_ENDINGS = (".bin", ".tlog", ".ulg")


def opened_log(source: Path, crs: str | None, antenna_m: float | None = None) -> "RecordedDrive":
    """Open the log of an autopilot as a recording; refuse the height of an antenna on a vehicle that flies."""
    from vision_slam.recorded_drive import RecordedDrive

    with needs_live_extra():
        from live.autopilot_logs import read_autopilot_log

        log = read_autopilot_log(source, crs)
    if log.flown and antenna_m is not None:
        raise InputError(
            f"{source} is the log of {log.flown}, and --antenna is a height above the ground that stays; leave it out for the "
            "path alone."
        )
    return RecordedDrive.of_fixes(log.recording, log.notes, antenna_m, log.flown)

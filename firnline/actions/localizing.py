"""Estimate path and landmarks from a recording."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from firnline.actions.interface import DryRun, Json, Quiet, columns_option, epoch_option, needs_live_extra

if TYPE_CHECKING:
    from survey.data.ice.motion import IceMotion
    from vision_slam.recorded_drive import RecordedDrive


_ICE = "ice."


@dataclass(frozen=True, kw_only=True)
class LocalizeRequest:
    """Options of the command; None stands for an option that was not given."""

    source: Annotated[
        Path,
        typer.Argument(
            help="Recording, ROS bag, folder in KITTI, TUM, EuRoC layout or of images with times, or log of an autopilot "
            "(ArduPilot .bin .tlog, PX4 .ulg)."
        ),
    ]
    camera: Annotated[
        Path | None, typer.Option("--camera", help="Calibration (camera.toml), instead of the layout's own.")
    ] = None
    topics: Annotated[
        list[str], typer.Option("--topic", help="Topic of a bag, where it has several of a kind.")
    ] = field(default_factory=list)
    gps: Annotated[
        Path | None,
        typer.Option(
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
        typer.Option(
            "--frame-rate",
            min=1e-3,
            help="Images per second, where neither names nor files state times [Hz].",
        ),
    ] = None
    crs: Annotated[
        str | None,
        typer.Option(
            "--crs", help="Projected CRS to work in, e.g. EPSG:32608; the fixes' UTM zone unless named."
        ),
    ] = None
    gps_shift_s: Annotated[
        float,
        typer.Option("--gps-shift", help="Add to the times of the fixes to get those of the images [s]."),
    ] = 0.0
    scale_from_m: Annotated[
        float | None,
        typer.Option(
            "--scale-from", help="Without wheels and fixes: scale from the reference's first metres [m]."
        ),
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
        typer.Option(
            "--reference",
            help="Reference path to compare with (.tum, .csv, KITTI poses, or fixes as --gps takes them); the estimator does not use it.",
        ),
    ] = None
    viewer: Annotated[
        Path | None, typer.Option("--viewer", help="Also write a file for rerun's viewer, e.g. drive.rrd.")
    ] = None
    settings: Annotated[
        list[str],
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Override an assumed sensor error, as in a mission file, e.g. localization.gps_bias_sigma_m=3.0, or a setting of visual odometry, e.g. visual.n_features=500.",
        ),
    ] = field(default_factory=list)
    lens: Annotated[
        Literal["auto", "given", "refine"],
        typer.Option(
            "--lens",
            help="Estimate radial distortion and focal length from the images, or use them as given; auto estimates them where the calibration states no distortion.",
        ),
    ] = "auto"
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for path, landmarks, health and pictures.")
    ] = Path("localization")
    force: Annotated[bool, typer.Option("--force", help="Replace an existing localization.")] = False
    dry_run: DryRun = False
    as_json: Json = False
    quiet: Quiet = False

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
        from sim.config.ice import IceAssumptions
        from sim.world.assumed_motion import assumed_motion
        from survey.core.config import validated, with_overrides
        from survey.core.errors import InputError
        from survey.data.recording import Recording

        stated = [one for one in self.settings if one.startswith(_ICE)]
        if self.epoch_s is None:
            if stated:
                raise InputError(f"--set {stated[0]} is of moving ice; add --epoch, or leave it out.")
            return None
        if not isinstance(drive.records, Recording):
            raise InputError(
                "--epoch estimates the motion of the ice, and the recording has no fixes; add --gps, or leave --epoch out."
            )
        values = with_overrides({"ice": {}}, stated)["ice"]
        assumed = validated(IceAssumptions, values, "--set")
        records = drive.records
        return assumed_motion(assumed, self.epoch_s, records.gps.position[:, :2], records.crs)

    def check_outputs(self) -> None:
        """Refuse outputs that exist or are inputs, and a viewer's file that cannot be written."""
        from firnline.actions.files import refuse_existing
        from vision_slam.results import OWN_FILES

        inputs = (self.source, self.camera, self.gps, self.reference)
        refuse_existing([self.out], force=self.force, inputs=inputs, own=OWN_FILES)
        if self.viewer is not None:
            from vision_slam.viewer import refuse_without_rerun

            refuse_existing([self.viewer], force=self.force, inputs=inputs)
            refuse_without_rerun()

    def open(self) -> "RecordedDrive":
        """Open the recording with the files and options that belong to it."""
        from vision_slam.recordings import open_recording

        if self.source.suffix.lower() in LOG_ENDINGS and not self.source.is_dir():
            self._refuse_image_options()
            return opened_log(self.source, self.crs)

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
        )

    def _refuse_image_options(self) -> None:
        """Refuse options of images and of other fixes beside the log of an autopilot."""
        from survey.core.errors import ConfigError

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


LOG_ENDINGS = (".bin", ".tlog", ".ulg")


def opened_log(source: Path, crs: str | None) -> "RecordedDrive":
    """Open the log of an autopilot as a recording.

    Parameters
    ----------
    source : pathlib.Path
        Ends in one of `LOG_ENDINGS`.
    crs : str, optional
        Projected CRS.

    Returns
    -------
    RecordedDrive
        With fixes, wheels and inertial readings, as far as the log has them.
    """
    from vision_slam.recorded_drive import RecordedDrive

    with needs_live_extra():
        from live.logs.autopilot_log import read_autopilot_log

        return RecordedDrive(*read_autopilot_log(source, crs))

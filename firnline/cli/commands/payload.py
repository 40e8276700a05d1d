"""``firnline payload``: map a quantity that was logged on a drive."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from firnline.actions.interface import DryRun, Quiet, end_dry_run
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import with_options_of

if TYPE_CHECKING:
    from pyproj import CRS

    from survey.data.sensors.payload import PayloadLog
    from survey.data.trajectory import Trajectory


_OWN_FILES = ("dem.tif", "support.tif", "reconstruction.json", "*.nc", "*.aux.xml")


@dataclass(frozen=True, kw_only=True)
class PayloadRequest:
    """Options of the command."""

    logs: Annotated[
        list[Path],
        typer.Argument(
            help="CSV logs of the quantity, one for each drive, with time_s, or easting_m and northing_m."
        ),
    ]
    name: Annotated[str, typer.Option("--name", help="Column of the quantity, e.g. air_temperature.")]
    unit: Annotated[str, typer.Option("--unit", help="Its unit as UDUNITS spells it, e.g. degC or 'W m-2'.")]
    terrain: Annotated[
        Path,
        typer.Option("--terrain", help="Elevation, e.g. dem.tif of a reconstruction; the map has its CRS."),
    ]
    trajectories: Annotated[
        list[Path],
        typer.Option(
            "--trajectory", help="Path of each drive (trajectory.csv), for logs by time; repeat it."
        ),
    ] = field(default_factory=list)
    standard_name: Annotated[
        str | None, typer.Option("--standard-name", help="CF standard name, for the NetCDF file.")
    ] = None
    noise_sd: Annotated[
        float, typer.Option("--noise", min=0.0, help="Noise of a reading (1 σ) that the fit begins with.")
    ] = 0.1
    lag_s: Annotated[
        float, typer.Option("--lag", min=0.0, help="Time constant with which the sensor follows [s].")
    ] = 0.0
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for GeoTIFF, NetCDF and facts.")] = Path(
        "payload"
    )
    force: Annotated[bool, typer.Option("--force", help="Replace an existing map.")] = False
    dry_run: DryRun = False
    quiet: Quiet = False

    def read_logs(self) -> "list[PayloadLog]":
        """Read the logs."""
        from survey.data.sensors.payload import PayloadLog, Quantity

        quantity = Quantity(
            name=self.name,
            unit=self.unit,
            standard_name=self.standard_name,
            noise_sd=self.noise_sd,
            lag_s=self.lag_s,
        )
        return [PayloadLog.read(file, quantity) for file in self.logs]

    def read_paths(self, crs: "CRS") -> "list[Trajectory | None]":
        """Read the path of each drive; None for each where none is given."""
        from survey.core.errors import ConfigError
        from survey.data.trajectory import Trajectory

        if not self.trajectories:
            return [None] * len(self.logs)
        if len(self.trajectories) != len(self.logs):
            raise ConfigError(
                f"{len(self.logs)} logs and {len(self.trajectories)} trajectories were given; give one --trajectory for "
                "each log, in the same order."
            )
        return [Trajectory.read(file, crs) for file in self.trajectories]


@with_exit_codes
@with_options_of(PayloadRequest)
def payload(request: PayloadRequest) -> None:
    """Map a quantity that was logged on a drive: a Gaussian process with elevation as covariate.

    For example:

      firnline payload weather.csv --name air_temperature --unit degC --lag 8 --trajectory localization/trajectory.csv --terrain map/dem.tif

      firnline payload albedo.csv --name albedo --unit 1 --terrain dem.tif --out albedo
    """
    from firnline.actions.files import refuse_existing
    from survey.core.files.replacing import replacing_folder
    from survey.data.dem import Dem
    from survey.reconstruction.payload.payload_map import map_payload, payload_grid, write_payload

    inputs = (*request.logs, *request.trajectories, request.terrain)
    refuse_existing([request.out], force=request.force, inputs=inputs, own=_OWN_FILES)
    terrain = Dem.read(request.terrain)
    logs = request.read_logs()
    paths = request.read_paths(terrain.crs)
    if request.dry_run:
        end_dry_run([request.out], {"logs": len(logs), "paths": len(request.trajectories)})
    mapped = map_payload(logs, paths, terrain, payload_grid(terrain.grid()))
    with replacing_folder(request.out, own=_OWN_FILES) as draft:
        write_payload(mapped, logs[0], draft)
    if not request.quiet:
        found = mapped.hyperparameters
        typer.echo(
            f"{logs[0].quantity.label}: {mapped.diagnostics['n_readings']} readings, length scale "
            f"{found['length_scale_m']:.0f} m, {found['per_km_of_elevation']:+.2f} ± "
            f"{found['per_km_of_elevation_sigma']:.2f} per km of elevation, noise {found['noise_sd']:.3g}"
        )
        typer.echo(f"map: {request.out}")

"""Map a quantity that was logged on a drive, with elevation as covariate."""

from dataclasses import dataclass

import survey
from firnline.actions.interface import Preview, WrittenResult, previewed_by, refuse_existing
from firnline.actions.requests import PayloadRequest
from survey.core import ConfigError, replacing_folder
from survey.data.sensors.payload import PayloadLog, Quantity
from survey.reconstruction.payload import map_payload, payload_grid, write_payload

OWN_FILES = ("dem.tif", "support.tif", "reconstruction.json", "*.nc", "*.aux.xml")
"""Patterns of the files that a map of a payload consists of."""


@dataclass(frozen=True)
class PayloadResult(WrittenResult):
    """Map of a quantity that was logged on a drive.

    Parameters
    ----------
    request : PayloadRequest
        What was asked for.
    log : PayloadLog
        The first log, which states the quantity.
    mapped : Reconstruction
        The map.
    """

    request: PayloadRequest
    log: PayloadLog
    mapped: survey.Reconstruction

    def _write_files(self) -> None:
        """Write GeoTIFF, NetCDF and facts into a folder."""
        with replacing_folder(self.request.out, own=OWN_FILES) as draft:
            write_payload(self.mapped, self.log, draft)

    def lines(self) -> list[str]:
        """Return readings, length scale, dependence on elevation, noise, and the place of the map."""
        found = self.mapped.hyperparameters
        return [
            f"{self.log.quantity.label}: {self.mapped.diagnostics['n_readings']} readings, length scale "
            f"{found['length_scale_m']:.0f} m, {found['per_km_of_elevation']:+.2f} ± "
            f"{found['per_km_of_elevation_sigma']:.2f} per km of elevation, noise {found['noise_sd']:.3g}",
            f"map: {self.request.out}",
        ]


def preview_payload(request: PayloadRequest) -> Preview:
    """Read logs, paths and terrain, and return their numbers."""
    logs, _, _ = _payload_inputs(request)
    return Preview.of([request.out], {"logs": len(logs), "paths": len(request.trajectories)})


@previewed_by(preview_payload)
def payload(request: PayloadRequest) -> PayloadResult:
    """Map a quantity that was logged on a drive, with elevation as covariate.

    Parameters
    ----------
    request : PayloadRequest
        Logs, paths and terrain.

    Returns
    -------
    PayloadResult
        The map; `PayloadResult.write` writes it.

    Raises
    ------
    InputError
        Input that cannot be used, or an output that exists.
    """
    logs, paths, terrain = _payload_inputs(request)
    return PayloadResult(request, logs[0], map_payload(logs, paths, terrain, payload_grid(terrain.grid())))


def _payload_inputs(
    request: PayloadRequest,
) -> tuple[list[PayloadLog], list[survey.Trajectory | None], survey.Dem]:
    """Read logs, the path of each drive (None where none is given), and the terrain."""
    inputs = (*request.logs, *request.trajectories, request.terrain)
    refuse_existing([request.out], force=request.force, inputs=inputs, own=OWN_FILES)
    terrain = survey.Dem.read(request.terrain)
    quantity = Quantity(
        name=request.name,
        unit=request.unit,
        standard_name=request.standard_name,
        noise_sd=request.noise_sd,
        lag_s=request.lag_s,
    )
    logs = [PayloadLog.read(file, quantity) for file in request.logs]
    if not request.trajectories:
        return logs, [None] * len(logs), terrain
    if len(request.trajectories) != len(logs):
        raise ConfigError(
            f"{len(logs)} logs and {len(request.trajectories)} trajectories were given; give one --trajectory for "
            "each log, in the same order."
        )
    return logs, [survey.Trajectory.read(file, terrain.crs) for file in request.trajectories], terrain

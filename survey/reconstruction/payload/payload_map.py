"""Map of a quantity that a payload measured on the way: Gaussian process with elevation as covariate."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from survey.core.arrays import FloatArray
from survey.core.crs.agreement import same_crs
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.sensors.payload import PayloadLog
from survey.data.trajectory import Trajectory
from survey.io.raster.netcdf import write_netcdf
from survey.reconstruction.base import Reconstruction
from survey.reconstruction.payload.averaged_readings import AveragedReadings
from survey.reconstruction.payload.payload_process import (
    PayloadHyperparameters,
    PayloadProcess,
    fitted,
)
from survey.reconstruction.support import support_codes

MOST_NODES = 20_000
"""Nodes of a payload's map; the grid is coarser than that of the terrain where needed."""
_N_FITTED, _N_MAPPED = 400, 1000


def map_payload(
    logs: Sequence[PayloadLog],
    trajectories: Sequence[Trajectory | None],
    terrain: Dem,
    grid: Grid,
    *,
    terrain_std: Dem | None = None,
    hyperparameters: PayloadHyperparameters | None = None,
) -> Reconstruction:
    """Map a quantity from the readings of one or several drives.

    The quantity is a linear function of elevation and a Gaussian process of a length scale of its own. Covariance
    function, length scale, variance and noise are fitted to the readings by restricted likelihood; a sensor's lag
    is part of the model of its readings.

    Parameters
    ----------
    logs : sequence of PayloadLog
        Readings of the same quantity, one log for each drive.
    trajectories : sequence of Trajectory or None
        Path of each drive on the clock of its log; None for logs with places.
    terrain : Dem
        Elevation on the grid and along the drives, for example the map of the survey.
    grid : Grid
        Nodes of the map, in the CRS of the terrain.
    terrain_std : Dem, optional
        Standard deviation of that elevation [m].
    hyperparameters : PayloadHyperparameters, optional
        Covariance function and noise, where they are known; otherwise the map is the mean over their posterior.

    Returns
    -------
    Reconstruction
        Mean and standard deviation in the unit of the quantity; NaN where the terrain has no height.

    Raises
    ------
    InputError
        Logs of different quantities, in another CRS, or away from the terrain.

    Notes
    -----
    The field is taken as constant during the drive, the offset of a sensor as known, and places as exact: their
    errors must be small beside the length scale. Averages over blocks of the way (at most 1,000 in all) replace
    single readings, so that structure finer than a block is noise.
    """
    same_crs(terrain.crs, grid.crs, "the terrain and the grid")
    names = {(log.quantity.name, log.quantity.unit) for log in logs}
    if len(names) != 1:
        raise InputError(f"the logs hold {len(names)} quantities; map one at a time.")
    placed = [_on_terrain(log.placed(path), terrain) for log, path in zip(logs, trajectories, strict=True)]
    few = AveragedReadings.of(placed, _N_FITTED)
    weighted = (
        fitted(few, terrain.at(few.xy), placed[0].quantity.noise_sd)
        if hyperparameters is None
        else [(1.0, hyperparameters)]
    )
    readings = AveragedReadings.of(placed, _N_MAPPED)
    processes = [(w, PayloadProcess(readings, terrain.at(readings.xy), found)) for w, found in weighted]
    elevation = terrain.at(grid.xy)
    sigma_m = np.zeros(len(elevation)) if terrain_std is None else np.nan_to_num(terrain_std.at(grid.xy))
    mean, std = mixture(
        [w for w, _ in processes], [process.at(grid.xy, elevation, sigma_m) for _, process in processes]
    )
    datum, n_readings = terrain.vertical_datum, sum(len(log) for log in placed)
    return Reconstruction(
        Dem.on(grid, mean.reshape(grid.shape), datum),
        Dem.on(grid, std.reshape(grid.shape), datum),
        _support(processes[0][1], std, grid),
        "gp",
        _facts(processes[0][1]) | {"n_hyperparameters": len(processes)},
        quantity=f"{placed[0].quantity.name}_{placed[0].quantity.unit}",
        diagnostics={"n_readings": n_readings},
    )


def mixture(
    weights: Sequence[float], parts: Sequence[tuple[FloatArray, FloatArray]]
) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of a mixture of distributions with means and standard deviations.

    Examples
    --------
    >>> one = np.ones(1)
    >>> mean, std = mixture([0.5, 0.5], [(0.0 * one, one), (2.0 * one, one)])
    >>> float(mean[0]), round(float(std[0]), 3)
    (1.0, 1.414)
    """
    means, stds = (np.stack(column) for column in zip(*parts, strict=True))
    mean = np.tensordot(weights, means, 1)
    variance = np.tensordot(weights, stds**2 + (means - mean) ** 2, 1)
    return mean, np.sqrt(variance)


def payload_grid(grid: Grid) -> Grid:
    """Return a grid over the same ground with at most `MOST_NODES` nodes."""
    factor = int(np.ceil(np.sqrt(np.prod(grid.shape) / MOST_NODES)))
    return grid if factor <= 1 else Grid.over(grid.bounds, factor * grid.step_m, grid.crs)


def write_payload(mapped: Reconstruction, log: PayloadLog, folder: Path) -> None:
    """Write a map as GeoTIFF with its facts, and as NetCDF with the unit and the standard name of the quantity.

    Parameters
    ----------
    mapped : Reconstruction
        Map of the quantity of the log.
    log : PayloadLog
        Names the quantity.
    folder : pathlib.Path
        Existing folder.
    """
    mapped.write(folder)
    quantity, mean = log.quantity, mapped.mean
    named = {} if quantity.standard_name is None else {"standard_name": quantity.standard_name}
    attributes = {
        quantity.name: {"units": quantity.unit, "ancillary_variables": "standard_deviation", **named},
        "standard_deviation": {
            "units": quantity.unit,
            **{key: f"{name} standard_error" for key, name in named.items()},
        },
    }
    bands = {quantity.name: mean.elevation, "standard_deviation": mapped.std.elevation}
    write_netcdf(
        folder / f"{quantity.name}.nc",
        bands,
        mean.transform,
        mean.crs,
        mean.vertical_datum,
        attributes=attributes,
    )


def _on_terrain(log: PayloadLog, terrain: Dem) -> PayloadLog:
    """Return the readings at places with a height."""
    assert log.xy is not None
    known = np.isfinite(terrain.at(log.xy))
    if known.all():
        return log
    if known.sum() < 10:
        raise InputError(
            f"{int(known.sum())} of {len(log)} readings of {log.quantity.name} lie on the terrain; give a terrain of the "
            "same place and CRS."
        )
    times = None if log.time_s is None else log.time_s[known]
    return PayloadLog(log.quantity, log.value[known], times, log.xy[known])


def _support(process: PayloadProcess, std: FloatArray, grid: Grid) -> Any:
    """Return the support codes of the nodes."""
    kernel = process.hyperparameters.kernel
    nearest = np.asarray(cKDTree(process.readings.xy).query(grid.xy)[0]).reshape(grid.shape)
    return support_codes(
        nearest,
        (std**2 / kernel.variance_m2).reshape(grid.shape),
        shortest_length_m=kernel.length_scales_m[0],
        step_m=grid.step_m,
    )


def _facts(process: PayloadProcess) -> dict[str, Any]:
    """Return the likeliest hyperparameters and the dependence on elevation with them."""
    kernel, noise_sd = process.hyperparameters
    return {
        "family": kernel.family,
        "length_scale_m": kernel.length_scales_m[0],
        "standard_deviation": float(np.sqrt(kernel.variance_m2)),
        "noise_sd": noise_sd,
        "per_km_of_elevation": 1e3 * float(process.trend[1]),
        "per_km_of_elevation_sigma": 1e3 * float(np.sqrt(process.trend_covariance[1, 1])),
    }

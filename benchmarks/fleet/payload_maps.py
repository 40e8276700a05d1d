"""Five quantities mapped on a site, beside the same map by the true covariance, lapse unknown to both."""

from typing import Any

import numpy as np

import planners
from benchmarks.fleet.sites import FAMILIES, mission_on
from sim.config.rover import PayloadConfig
from sim.instruments.environment import PayloadField, payload_log
from sim.vehicle.motion import exact_drive
from sim.world.site import build_world
from survey.core.arrays import FloatArray
from survey.data.grid import Grid
from survey.data.truth import Truth
from survey.reconstruction.gp.kernels import Matern32, Matern52, SquaredExponential
from survey.reconstruction.payload import PayloadHyperparameters, map_payload
from survey.reconstruction.terrain_map import Reconstruction

_NODES_M = 6.0
_95 = 1.959964
_KERNELS = {"rough": Matern32, "medium": Matern52, "smooth": SquaredExponential}
QUANTITIES = tuple(
    PayloadConfig(**settings)  # type: ignore[arg-type]
    for settings in (
        {"name": "air_temperature", "unit": "degC", "per_km_of_elevation": -6.5, "field_sd": 0.8, "lag_s": 8.0},
        {"name": "albedo", "unit": "1", "field_sd": 0.08, "field_length_m": 40.0, "noise_sd": 0.02, "field_kind": "rough"},
        {"name": "wind_speed", "unit": "m s-1", "per_km_of_elevation": 10.0, "field_sd": 1.5, "field_length_m": 60.0,
         "noise_sd": 0.5, "lag_s": 2.0},
        {"name": "radiation", "unit": "W m-2", "field_sd": 15.0, "field_length_m": 80.0, "noise_sd": 3.0, "lag_s": 15.0,
         "field_kind": "smooth"},
        {"name": "snow_depth", "unit": "m", "per_km_of_elevation": 5.0, "field_sd": 0.4, "field_length_m": 30.0,
         "noise_sd": 0.05, "field_kind": "rough"},
    )
)  # fmt: skip


def outcome(seed: int) -> dict[str, Any]:
    """Drive a site, map every quantity, and judge the maps against the fields."""
    mission = mission_on(seed, FAMILIES[seed % len(FAMILIES)])
    world = build_world(mission)
    route = planners.plan(world.area, world.prior, mission.planner, rover=mission.rover, fleet=mission.fleet)
    path, _ = exact_drive(world.terrain, route, mission.rover.speed_m_s)
    truth, grid = Truth(world.terrain, path), Grid.over(world.area.bounds, _NODES_M, world.area.crs)
    found = {}
    for config in QUANTITIES:
        field = PayloadField(config, world.terrain, seed)
        log, real = payload_log(config, field, truth, seed), field.at(grid.xy)
        kernel = _KERNELS[config.field_kind](config.field_sd**2, config.field_length_m)
        known = PayloadHyperparameters(kernel, config.noise_sd)
        fitted = map_payload([log], [path], world.terrain, grid)
        given = map_payload([log], [path], world.terrain, grid, hyperparameters=known)
        found[config.name] = {"fitted": _judged(fitted, real), "given": _judged(given, real)}
    return {"seed": seed, "quantities": found}


def _judged(mapped: Reconstruction, real: FloatArray) -> dict[str, float]:
    error, std = mapped.mean.elevation.ravel() - real, mapped.std.elevation.ravel()
    known = np.isfinite(error)
    return {
        "rmse": float(np.sqrt(np.mean(error[known] ** 2))),
        "coverage": float(np.mean(np.abs(error[known]) <= _95 * std[known])),
    }

"""Small random sites of the benchmark: five kinds of terrain, one mission on each for any number of rovers."""

from typing import Any

from benchmarks.mission_settings import stated_mission
from sim.config.mission import MissionConfig

FAMILIES = ("matern-5/2", "squared-exponential", "gaussian_hills", "slope_and_waves", "fractional_brownian")
SIDE_M = 300.0
_EAST_M, _NORTH_M = 526_000.0, 6_478_000.0


def on_site(family: str, side_m: float, *, margin_m: float = 0.0, step_m: float = 2.0) -> dict[str, Any]:
    """Return the sections of a mission on a random site whose rovers begin in the south-western corner.

    The terrain goes on for a margin around the area.
    """
    west, south = _EAST_M + margin_m, _NORTH_M + margin_m
    bounds = (west, south, west + side_m, south + side_m)
    terrain = {
        "source": "random",
        "family": family,
        "size_m": side_m + 2.0 * margin_m,
        "step_m": step_m,
        "length_scale_m": 90.0,
        "micro_relief_sd_m": 0.15,
        "origin_m": (_EAST_M, _NORTH_M),
    }
    area = {"bounds_m": bounds, "starts_m": ((west + 10.0, south + 10.0),)}
    return {"terrain": terrain, "area": area}


def mission_on(
    seed: int, family: str, *, n_rovers: int = 1, swaths: int = 6, step_m: float = 2.0
) -> MissionConfig:
    """Return a mission with gravity and barometer on a random site of 300 × 300 m; all rovers begin in a corner."""
    sections = {
        "planner": {"pattern": "lawnmower", "swaths": swaths},
        "fleet": {"rovers": n_rovers, "return_to_start": n_rovers == 1},
        "aids": {"accelerometer": True},
    }
    return stated_mission("fleet-benchmark", seed, on_site(family, SIDE_M, step_m=step_m) | sections)

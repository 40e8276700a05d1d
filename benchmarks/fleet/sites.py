"""Small random sites of the benchmark: five kinds of terrain, one mission on each for any number of rovers."""

from typing import Any

from benchmarks.mission_settings import stated_mission
from sim.config.mission import MissionConfig

FAMILIES = ("matern-5/2", "squared-exponential", "gaussian_hills", "slope_and_waves", "fractional_brownian")
SIDE_M = 300.0
_EAST_M, _NORTH_M = 526_000.0, 6_478_000.0


def on_site(family: str, side_m: float) -> dict[str, Any]:
    """Return the sections of a mission on a random site whose rovers begin in the south-western corner."""
    terrain = {
        "source": "random",
        "family": family,
        "size_m": side_m,
        "step_m": 2.0,
        "length_scale_m": 90.0,
        "micro_relief_sd_m": 0.15,
        "origin_m": (_EAST_M, _NORTH_M),
    }
    return {"terrain": terrain, "area": {"starts_m": ((_EAST_M + 10.0, _NORTH_M + 10.0),)}}


def mission_on(seed: int, family: str, *, n_rovers: int = 1, swaths: int = 6) -> MissionConfig:
    """Return a mission with gravity and barometer on a random site of 300 × 300 m; all rovers begin in a corner."""
    sections = {
        "planner": {"pattern": "lawnmower", "swaths": swaths},
        "fleet": {"rovers": n_rovers, "return_to_start": n_rovers == 1},
        "aids": {"accelerometer": True},
    }
    return stated_mission("fleet-benchmark", seed, on_site(family, SIDE_M) | sections)

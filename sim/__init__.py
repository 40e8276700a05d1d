"""The roof of firnline: the simulated world, the mission, Monte Carlo, the command line."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim.config import MissionConfig
    from sim.mission import run_mission
    from sim.runs import open_run, read_mission
    from sim.statistical import simulate_statistical
    from sim.world import World, build_world

__all__ = [
    "MissionConfig",
    "World",
    "build_world",
    "open_run",
    "read_mission",
    "run_mission",
    "simulate_statistical",
]

_HOME = {
    "MissionConfig": "sim.config",
    "World": "sim.world",
    "build_world": "sim.world",
    "open_run": "sim.runs",
    "read_mission": "sim.runs",
    "run_mission": "sim.mission",
    "simulate_statistical": "sim.statistical",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for, so that the command line starts at once."""
    if name not in _HOME:
        raise AttributeError(f"module 'sim' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)

"""Simulator of firnline: worlds, sensors and vehicles, missions, Monte Carlo studies, the command line.

Estimation and planning live in `survey`, `planners` and `vision_slam`, which never import this package.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim.config.mission import MissionConfig
    from sim.mission.runs import open_run, read_mission
    from sim.mission.stages import run_mission
    from sim.simulate.statistical import simulate_statistical
    from sim.world.site import World, build_world

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
    "MissionConfig": "sim.config.mission",
    "World": "sim.world.site",
    "build_world": "sim.world.site",
    "open_run": "sim.mission.runs",
    "read_mission": "sim.mission.runs",
    "run_mission": "sim.mission.stages",
    "simulate_statistical": "sim.simulate.statistical",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for, so that the command line starts at once."""
    if name not in _HOME:
        raise AttributeError(f"module 'sim' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)

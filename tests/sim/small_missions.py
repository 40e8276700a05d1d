"""Missions in memory for tests of the simulator."""

from planners import LawnmowerConfig
from sim.config.mission import AidsConfig, MissionConfig
from sim.config.world import RandomTerrain


def mission_with(**aids: object) -> MissionConfig:
    """Return a mission over random terrain with two swaths and some aiding sensors."""
    return MissionConfig(
        schema_version=1,
        name="m",
        seed=5,
        terrain=RandomTerrain(source="random"),
        planner=LawnmowerConfig(swaths=2),
        aids=AidsConfig(**aids),
    )

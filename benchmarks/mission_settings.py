"""Missions of benchmarks, from a name, a seed and the sections that they state."""

from typing import Any

from sim.config.mission import MissionConfig
from survey.core.config import validated


def stated_mission(name: str, seed: int, sections: dict[str, Any]) -> MissionConfig:
    """Return the mission of some sections; everything else has its default."""
    content = {"schema_version": 1, "name": name, "seed": seed} | sections
    return validated(MissionConfig, content, "the benchmark")

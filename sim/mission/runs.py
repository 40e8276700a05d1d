"""From a mission file to its run folder."""

import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import tomlkit

from sim.config.mission import MissionConfig
from sim.world.site import build_world
from survey.core.config import read_toml, validated, with_overrides
from survey.core.files import existing_file
from survey.core.store import RunFolder, checksum

_PACKAGES = ("firnline", "numpy", "scipy", "rasterio", "pyproj", "shapely", "finufft", "numba", "matplotlib")


def read_mission(path: Path, overrides: Sequence[str] = ()) -> MissionConfig:
    """Read a mission file, put ``section.key=value`` overrides in, and check all of it.

    Raises
    ------
    InputError
        The file is missing.
    ConfigError
        It is no TOML, or a setting is unknown or wrong.
    """
    mission = validated(MissionConfig, with_overrides(read_toml(path), overrides), str(path))
    return mission.read_from(path.parent)


def open_run(mission: MissionConfig, runs: Path) -> RunFolder:
    """Find or make the run folder that belongs to a mission and its input files.

    The world of a new mission is built once before anything is written, so that bad input
    is refused and leaves nothing behind.
    """
    inputs = {
        name: checksum(existing_file(file, f"the file of {name},"))
        for name, file in mission.input_files.items()
    }
    facts = {
        "mission": mission.name,
        "seed": mission.seed,
        "python": platform.python_version(),
        "versions": {name: version(name) for name in _PACKAGES},
    }
    text = resolved_text(mission)
    if not RunFolder.place(runs, mission.name, text, inputs).exists():
        build_world(mission)
    return RunFolder.open(runs, mission.name, text, inputs, facts)


def resolved_text(mission: MissionConfig) -> str:
    """Return the mission with every default written out, as TOML."""
    return tomlkit.dumps(mission.model_dump(mode="json", exclude_none=True))

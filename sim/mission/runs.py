"""Mission files and run folders: read a mission, open the folder that belongs to it."""

import os
import platform
from collections.abc import Sequence
from pathlib import Path

import tomlkit

from sim.config.mission import SCHEMA_VERSION, MissionConfig
from sim.mission.capacity import require_mission
from sim.mission.versions import current_versions
from survey.core.arguments import check_types
from survey.core.config import read_toml, refuse_newer_schema, validated, with_overrides
from survey.core.files.reading import existing_file
from survey.core.files.replacing import refuse_unwritable
from survey.core.runs.manifest import file_sha256
from survey.core.runs.store import RunFolder
from survey.core.text import printable
from survey.io.companions import companion_files


def read_mission(path: Path, overrides: Sequence[str] = ()) -> MissionConfig:
    """Read a mission file, apply overrides and check all settings.

    Parameters
    ----------
    path : pathlib.Path
        The mission file (TOML).
    overrides : sequence of str
        Settings as ``section.key=value``.

    Returns
    -------
    MissionConfig
        The mission; its relative paths count from the folder of the file.

    Raises
    ------
    InputError
        The file is missing.
    ConfigError
        It is no TOML, of a newer schema, or a setting is unknown or wrong.
    """
    values = with_overrides(read_toml(path), overrides)
    refuse_newer_schema(values, SCHEMA_VERSION, str(path))
    mission = validated(MissionConfig, values, str(path))
    return mission.read_from(path.parent)


@check_types
def open_run(mission: MissionConfig, runs: Path, *, first: str | None = None) -> RunFolder:
    """Open the run folder that belongs to a mission and its input files, or create it.

    The world of a new mission is built once before anything is written, so that bad input is
    refused and leaves nothing behind.

    Parameters
    ----------
    mission : MissionConfig
        The mission.
    runs : pathlib.Path
        The folder of all runs.
    first : str, optional
        Do this stage and all that follow it again. With ``"plan"`` a damaged manifest is replaced.

    Returns
    -------
    RunFolder
        Its name follows from the configuration and from every file that decides a value,
        companions (``.prj``, ``.aux.xml``, sources of a ``.vrt``) included.

    Raises
    ------
    InputError
        An input file is missing, or the folder cannot be written to or is damaged.
    CapacityError
        The mission would not fit into memory; names the setting and a value that would pass.
    """
    inputs = input_checksums(mission.input_files)
    _checked_place(mission, runs, inputs)
    facts = {
        "mission": mission.name,
        "seed": mission.seed,
        "python": platform.python_version(),
        "versions": current_versions(),
    }
    text = resolved_text(mission)
    run = RunFolder.open(runs, mission.name, text, inputs, facts, fresh=first == "plan")
    if first not in (None, "plan"):
        run.redo_from(first, facts)
    return run


def planned_place(mission: MissionConfig, runs: Path) -> Path:
    """Return the folder in which a mission runs, after checking its input; write nothing.

    Parameters
    ----------
    mission : MissionConfig
        The mission.
    runs : pathlib.Path
        The folder of all runs.

    Returns
    -------
    pathlib.Path
        Its name follows from the configuration and from every input file.

    Raises
    ------
    InputError
        An input file is missing, or the folder cannot be written to.
    CapacityError
        The mission would not fit into memory.
    """
    return _checked_place(mission, runs, input_checksums(mission.input_files))


def _checked_place(mission: MissionConfig, runs: Path, inputs: dict[str, str]) -> Path:
    """Return the folder of a mission; refuse one that cannot be written, and a new mission that is too large."""
    place = RunFolder.place(runs, mission.name, resolved_text(mission), inputs)
    refuse_unwritable(place, is_folder=True)
    if not place.exists():
        require_mission(mission)
    return place


def input_checksums(files: dict[str, Path]) -> dict[str, str]:
    """Return the SHA-256 of input files and of the companions that decide what is read from them.

    Parameters
    ----------
    files : dict of str to pathlib.Path
        Input files by name.

    Returns
    -------
    dict
        SHA-256 by name; a companion's name is that of its file and its place relative to it.
    """
    found = {}
    for name, path in files.items():
        file = existing_file(path, f"the file of {name},")
        found[name] = file_sha256(file)
        for companion in companion_files(file):
            place = os.path.relpath(companion, file.parent)
            found[f"{name}/{printable(place)}"] = file_sha256(companion)
    return found


def resolved_text(mission: MissionConfig) -> str:
    """Return the mission with every default written out.

    Parameters
    ----------
    mission : MissionConfig
        The mission.

    Returns
    -------
    str
        TOML.
    """
    return tomlkit.dumps(mission.model_dump(mode="json", exclude_none=True))

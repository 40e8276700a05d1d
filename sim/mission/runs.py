"""Mission files and run folders: read a mission, and open the folder that belongs to it.

A run folder holds the resolved mission, the checksums of its inputs, and the versions of the packages that compute
results; a mixture of versions is refused, for it may give other bytes. `mission_template` and `json_schema` are
generated from the configuration models: a mission file with every setting explained, and the JSON Schema (draft
2020-12) with which editors complete and check it.
"""

import os
import platform
import re
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import tomlkit
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core.core_schema import IsInstanceSchema
from tomlkit.items import Table

from planners import LawnmowerConfig
from sim.config.mission import SCHEMA_VERSION, AreaConfig, MissionConfig
from sim.config.world import DemTerrain, RandomTerrain
from sim.mission.capacity import require_mission
from sim.world.site import SharedWorld
from survey.core import InputError, check_types, existing_file, printable, validated, with_overrides
from survey.core.config import read_toml, refuse_newer_schema
from survey.core.documents import file_sha256
from survey.core.replacement import refuse_unwritable, resolved
from survey.core.run_folder import RunFolder
from survey.io.dataset_files import companion_files


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
def open_run(
    mission: MissionConfig, runs: Path, *, first: str | None = None, world: SharedWorld | None = None
) -> RunFolder:
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
    world : SharedWorld, optional
        World of the mission, which `sim.mission.stages.run_mission` then takes and does not build again.

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
    _checked_place(mission, runs, inputs, world)
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
    """Return the folder in which a mission runs, after checking its input; write nothing."""
    return _checked_place(mission, runs, input_checksums(mission.input_files))


def _checked_place(
    mission: MissionConfig, runs: Path, inputs: dict[str, str], world: SharedWorld | None = None
) -> Path:
    """Return the folder of a mission; refuse one that cannot be written, and a new mission that is too large."""
    place = RunFolder.place(runs, mission.name, resolved_text(mission), inputs)
    refuse_unwritable(place, is_folder=True)
    if not place.exists():
        require_mission(mission, world)
    return place


def input_checksums(files: dict[str, Path]) -> dict[str, str]:
    """Return the SHA-256 of input files and of the companions that decide what is read from them."""
    found = {}
    for name, path in files.items():
        file = existing_file(path, f"the file of {name},")
        found[name] = file_sha256(file)
        for companion in companion_files(file):
            place = os.path.relpath(companion, file.parent)
            found[f"{name}/{printable(place)}"] = file_sha256(companion)
    return found


def resolved_text(mission: MissionConfig) -> str:
    """Return the mission with every default written out."""
    return tomlkit.dumps(mission.model_dump(mode="json", exclude_none=True))


_COMPUTING = (
    "firnline", "numpy", "scipy", "numba", "finufft", "opencv-python-headless", "mujoco",
    "pybullet", "rasterio", "pyproj", "shapely", "scikit-image", "scikit-learn",
)  # fmt: skip


def current_versions() -> dict[str, str]:
    """Return the versions of Python and of the installed packages that compute results."""
    found = {"python": ".".join(platform.python_version_tuple()[:2])}
    for name in _COMPUTING:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # one of the physics engines suffices
            continue
    return found


def refuse_other_versions(before: Mapping[str, Any], where: str, remedy: str) -> None:
    """Refuse to continue results that other versions have begun."""
    now = current_versions()
    changes = [
        f"{name} {before.get(name) or 'not installed'} (now {now.get(name) or 'not installed'})"
        for name in dict.fromkeys([*before, *now])
        if before.get(name) != now.get(name)
    ]
    if changes:
        raise InputError(
            f"{where} was begun with {', '.join(changes)}, and a mixture of versions may give other bytes; {remedy}."
        )


_DIRECTIVE = "#:schema mission.schema.json\n"  # editors know no space after the mark
_HEAD = (
    "A firnline mission; lengths in metres, times in seconds, angles in degrees.",
    "Every key stands at its default; a key that is deleted takes it. A key behind # has no default.",
    "firnline schema mission > mission.schema.json lets editors complete and check this file.",
)
_LIMITS = (("ge", "at least"), ("gt", "above"), ("le", "at most"), ("lt", "below"))


def mission_template(name: str, dem: Path | None = None, *, clip_to_terrain: bool = False) -> str:
    """Return a runnable mission as TOML; each key carries its meaning and unit as a comment.

    Settings that have no default value stand as comments. `clip_to_terrain` is for a raster with unknown cells.
    """
    safe = re.sub(r"[^A-Za-z0-9_.-]", "-", name).lstrip("-_.") or "mission"
    terrain = (
        RandomTerrain(source="random") if dem is None else DemTerrain(source="dem", file=str(resolved(dem)))
    )
    mission = MissionConfig(
        schema_version=1,
        name=safe,
        terrain=terrain,
        area=AreaConfig(clip_to_terrain=clip_to_terrain),
        planner=LawnmowerConfig(swaths=4),
    )
    document = tomlkit.document()
    for line in _HEAD:
        document.add(tomlkit.comment(line))
    _fill_template(document, mission)
    return _DIRECTIVE + tomlkit.dumps(document)


def _fill_template(table: Table | tomlkit.TOMLDocument, section: BaseModel) -> None:
    nested: list[tuple[str, BaseModel]] = []
    for key, info in type(section).model_fields.items():
        value = getattr(section, key)
        if isinstance(value, BaseModel):
            nested.append((key, value))
            continue
        meaning = _explained_setting(info)
        if value is None:
            table.add(tomlkit.comment(f"{key} =    # {meaning}"))
        else:
            table.add(key, _toml_item(value).comment(meaning) if meaning else _toml_item(value))
    for key, inner in nested:
        block = tomlkit.table()
        _fill_template(block, inner)
        table.add(tomlkit.nl())
        table.add(key, block)


def _explained_setting(info: FieldInfo) -> str:
    """Return the meaning of a setting, with its choices or limits in brackets."""
    meaning = " ".join((info.description or "").split())
    if get_origin(info.annotation) is Literal:
        choices = get_args(info.annotation)
        allowed = ["one of " + ", ".join(map(str, choices))] if len(choices) > 1 else []
    else:
        bounds = ((word, getattr(part, key, None)) for part in info.metadata for key, word in _LIMITS)
        allowed = [f"{word} {bound:g}" for word, bound in bounds if bound is not None]
    return f"{meaning} ({', '.join(allowed)})".strip() if allowed else meaning


def _toml_item(value: Any) -> Any:
    return tomlkit.item(list(value) if isinstance(value, tuple) else value)


DIALECT = "https://json-schema.org/draft/2020-12/schema"


class _FileSchema(GenerateJsonSchema):
    """Describe objects that a file names by text, such as covariance functions, as text."""

    def is_instance_schema(self, schema: IsInstanceSchema) -> dict[str, Any]:  # noqa: ARG002
        return {"type": "string"}


def json_schema(model: type[BaseModel], title: str) -> dict[str, Any]:
    """Return the JSON Schema of a configuration: keys with type, limits, default and meaning.

    >>> from sim.config.mission import ScoreConfig
    >>> json_schema(ScoreConfig, "score")["properties"]["require"]["enum"]
    ['class-1', 'class-2', 'class-3']
    """
    schema = model.model_json_schema(schema_generator=_FileSchema)
    return {"$schema": DIALECT, **schema, "title": title}

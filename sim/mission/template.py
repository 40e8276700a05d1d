"""Template of a mission file with every setting explained, generated from the configuration models."""

import re
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import tomlkit
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from tomlkit.items import Table

from planners import LawnmowerConfig
from sim.config.mission import AreaConfig, MissionConfig
from sim.config.terrain import DemTerrain, RandomTerrain
from survey.core.files.links import resolved

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
    _fill(document, mission)
    return _DIRECTIVE + tomlkit.dumps(document)


def _fill(table: Table | tomlkit.TOMLDocument, section: BaseModel) -> None:
    nested: list[tuple[str, BaseModel]] = []
    for key, info in type(section).model_fields.items():
        value = getattr(section, key)
        if isinstance(value, BaseModel):
            nested.append((key, value))
            continue
        meaning = _explained(info)
        if value is None:
            table.add(tomlkit.comment(f"{key} =    # {meaning}"))
        else:
            table.add(key, _item(value).comment(meaning) if meaning else _item(value))
    for key, inner in nested:
        block = tomlkit.table()
        _fill(block, inner)
        table.add(tomlkit.nl())
        table.add(key, block)


def _explained(info: FieldInfo) -> str:
    """Return the meaning of a setting, with its choices or limits in brackets."""
    meaning = " ".join((info.description or "").split())
    if get_origin(info.annotation) is Literal:
        choices = get_args(info.annotation)
        allowed = ["one of " + ", ".join(map(str, choices))] if len(choices) > 1 else []
    else:
        bounds = ((word, getattr(part, key, None)) for part in info.metadata for key, word in _LIMITS)
        allowed = [f"{word} {bound:g}" for word, bound in bounds if bound is not None]
    return f"{meaning} ({', '.join(allowed)})".strip() if allowed else meaning


def _item(value: Any) -> Any:
    return tomlkit.item(list(value) if isinstance(value, tuple) else value)

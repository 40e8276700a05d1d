"""Template of a mission file with every setting explained, generated from the configuration models."""

import re
from pathlib import Path
from typing import Any

import tomlkit
from pydantic import BaseModel
from tomlkit.items import Table

from planners import LawnmowerConfig
from sim.config.mission import AreaConfig, MissionConfig
from sim.config.terrain import DemTerrain, RandomTerrain
from survey.core.files.links import resolved


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
    document.add(
        tomlkit.comment("A firnline mission; lengths in metres, times in seconds, angles in degrees.")
    )
    _fill(document, mission)
    return tomlkit.dumps(document)


def _fill(table: Table | tomlkit.TOMLDocument, section: BaseModel) -> None:
    nested: list[tuple[str, BaseModel]] = []
    for key, info in type(section).model_fields.items():
        value = getattr(section, key)
        if isinstance(value, BaseModel):
            nested.append((key, value))
            continue
        meaning = " ".join((info.description or "").split())
        if value is None:
            table.add(tomlkit.comment(f"{key} =    # {meaning}"))
        else:
            table.add(key, _item(value).comment(meaning) if meaning else _item(value))
    for key, inner in nested:
        block = tomlkit.table()
        _fill(block, inner)
        table.add(tomlkit.nl())
        table.add(key, block)


def _item(value: Any) -> Any:
    return tomlkit.item(list(value) if isinstance(value, tuple) else value)

"""Files of the mission of a plan: settings, area, prior."""

import math
import re
from pathlib import Path
from typing import Any

import tomlkit

from desk.plan.document import PlanDocument
from desk.plan.live import LivePlan
from sim.config.mission import MissionConfig
from survey.core.config import validated
from survey.core.errors import InputError
from survey.core.files import replacing
from survey.data.dem import Dem

_MOST_TERRAIN_CELLS = 4_000_000
_MARGIN_CELLS = 2.0
_NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9_.-]+")


def write_mission(live: LivePlan, document: PlanDocument, name: str, folder: Path) -> Path:
    """Write a mission file with the area and the prior that it names.

    The true terrain of its simulation is drawn about the prior, as ``role = "prior"`` in a mission file says.
    """
    folder.mkdir(parents=True, exist_ok=True)
    stem = _NOT_IN_NAMES.sub("-", name).strip("-._") or "survey"
    content = _mission(live, document, stem)
    validated(MissionConfig, content, "the mission of the plan")
    live.plan.area.write(folder / f"{stem}.gpkg")
    _mission_prior(live).write(folder / f"{stem}_prior.tif")
    place = folder / f"{stem}.toml"
    with replacing(place) as draft:
        draft.write_text(tomlkit.dumps(content), encoding="utf-8")
    return place


def _mission_prior(live: LivePlan) -> Dem:
    """Return the cells of the prior on the area and two more to each side."""
    if live.plan.prior is None:
        raise InputError("a mission needs a prior; open the desk with a raster of elevations.")
    prior = live.plan.prior
    west, south, east, north = live.plan.area.bounds
    margin_m = _MARGIN_CELLS * prior.step_m
    return prior.window((west - margin_m, south - margin_m, east + margin_m, north + margin_m))


def _mission(live: LivePlan, document: PlanDocument, stem: str) -> dict[str, Any]:
    """Return the settings of the mission; those at their defaults are left out."""
    given = document.model_dump(mode="json")
    sections = {name: _stated(given[name]) for name in ("planner", "rover", "fleet")}
    terrain = {"source": "dem", "file": f"{stem}_prior.tif", "role": "prior", "step_m": _step_m(live)}
    return {
        "schema_version": 1,
        "name": stem,
        "fidelity": "statistical",
        **_stated(given["simulation"]),
        "terrain": terrain,
        "area": {"file": f"{stem}.gpkg"},
        **{name: values for name, values in sections.items() if values},
    }


def _stated(values: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def _step_m(live: LivePlan) -> float:
    """Return the cell of the fine terrain: a metre, more where there would be too many."""
    xmin, ymin, xmax, ymax = _mission_prior(live).bounds
    least = math.sqrt((xmax - xmin) * (ymax - ymin) / _MOST_TERRAIN_CELLS)
    return float(max(1, math.ceil(least)))

"""Fields of the page's forms: name, kind, limits and help of every setting, from the configurations themselves."""

from dataclasses import fields as dataclass_fields
from functools import cache
from typing import Any, Literal, get_args, get_origin, get_type_hints

from desk.plan.request import REQUIREMENTS
from firnline.cli.planning.options import PlanOptions
from planners.guarantee.requirement import SURFACE_NAMES
from planners.registry import PLANNERS
from planners.routes.rover import Fleet, Rover
from sim.config.mission import MissionConfig
from survey.core.config import Section

_SIMULATION = ("fidelity", "seed")


@cache
def settings_fields() -> dict[str, Any]:
    """Return the fields of the sections ``planner`` (by pattern), ``rover`` and ``fleet``.

    Returns: for each section a list of fields with ``name``, ``help``, ``default``, ``kind`` and ``choices``.

    >>> names = [field["name"] for field in settings_fields()["planner"]["lawnmower"]]
    >>> "swaths" in names, "pattern" in names
    (True, False)
    """
    patterns = {planner.name: _fields(planner.config) for planner in PLANNERS}
    return {
        "planner": patterns,
        "rover": _fields(Rover),
        "fleet": _fields(Fleet),
        "requirement": _requirement_fields(),
        "simulation": [_simulation_field(name) for name in _SIMULATION],
    }


def _requirement_fields() -> list[dict[str, Any]]:
    """Return the fields of a required class; help and defaults are those of the command's options."""
    choices = {
        "require": ["class-1", "class-2", "class-3"],
        "surface": list(SURFACE_NAMES),
        "assume": ["squared-exponential", "matern-5/2", "matern-3/2", "whittle"],
    }
    kinds = {"max_swaths": "integer", "require": "text", "surface": "choice", "assume": "choice"}
    stated = {field.name: field.default for field in dataclass_fields(PlanOptions)}
    hints = get_type_hints(PlanOptions, include_extras=True)
    return [
        {
            "name": name,
            "help": next(part.help for part in hints[name].__metadata__ if hasattr(part, "help")),
            "default": stated[name],
            "kind": kinds.get(name, "number"),
            "choices": choices.get(name, []),
        }
        for name in REQUIREMENTS
    ]


def _simulation_field(name: str) -> dict[str, Any]:
    """Return a field of a mission that is no section; one of several values, or a whole number."""
    stated = MissionConfig.model_fields[name]
    choices = list(get_args(stated.annotation)) if get_origin(stated.annotation) is Literal else []
    return {
        "name": name,
        "help": stated.description or "",
        "default": stated.default,
        "kind": "choice" if choices else "integer",
        "choices": choices,
    }


def _fields(section: type[Section]) -> list[dict[str, Any]]:
    properties = section.model_json_schema()["properties"]
    return [_field(name, about) for name, about in properties.items() if name != "pattern"]


def _field(name: str, about: dict[str, Any]) -> dict[str, Any]:
    """Return what a form needs of one setting."""
    variants = about.get("anyOf", [about])
    kinds = [variant["type"] for variant in variants if variant.get("type") not in (None, "null")]
    choices: list[str] = next((variant["enum"] for variant in variants if "enum" in variant), [])
    default = about.get("default")
    return {
        "name": name,
        "help": about.get("description", ""),
        "default": default,
        "kind": "choice" if choices else kinds[0] if kinds else "string",
        "choices": choices,
    }

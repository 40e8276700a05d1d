"""Fields of the page's forms: name, kind, limits and help of every setting, from the configurations themselves."""

from functools import cache
from typing import Any

from planners.driving.rover import Fleet, Rover
from planners.registry import PLANNERS
from survey.core.config import Section


@cache
def settings_fields() -> dict[str, Any]:
    """Return the fields of the sections ``planner`` (by pattern), ``rover`` and ``fleet``.

    Returns
    -------
    dict
        For each section a list of fields with ``name``, ``help``, ``default``, ``kind`` and ``choices``.

    Examples
    --------
    >>> names = [field["name"] for field in settings_fields()["planner"]["lawnmower"]]
    >>> "swaths" in names, "pattern" in names
    (True, False)
    """
    patterns = {planner.name: _fields(planner.config) for planner in PLANNERS}
    return {"planner": patterns, "rover": _fields(Rover), "fleet": _fields(Fleet)}


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

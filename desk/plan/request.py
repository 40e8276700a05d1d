"""Request of ``firnline plan`` that stands for a plan document, the command that is the same, and the fields of the forms."""

import shlex
from dataclasses import fields as dataclass_fields
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

from desk.plan.document import PlanDocument, Setting
from firnline.actions.plan_request import PlanRequest
from planners.prediction.assumptions import SURFACE_NAMES
from planners.registry import PLANNERS
from planners.routes.rover import Fleet, Rover
from sim.config.mission import MissionConfig
from survey.core.config import Section

_OPTIONS = {
    "pattern": "pattern",
    "swaths": "swaths",
    "spacing_m": "spacing",
    "budget_m": "budget",
    "rmse_m": "rmse",
}
"""Settings of the section ``planner`` that are options of their own."""
REQUIREMENTS = (
    "require", "probability", "surface", "max_swaths", "noise_m", "localization_m", "prior_sigma_m",
    "assume", "micro_relief_m", "shared_m",
)  # fmt: skip
"""Options of a required class or error, in the order of the form."""
_ASSUMED = REQUIREMENTS[4:] + ("surface",)
"""Those of them that every predicted error rests on."""
_SPELLINGS = {"noise_m": "noise", "localization_m": "localization", "prior_sigma_m": "prior-sigma"}
_SPELLINGS |= {"micro_relief_m": "micro-relief", "shared_m": "shared", "max_swaths": "max-swaths"}


def request_of(document: PlanDocument, area: Path, terrain: Path, out: Path) -> PlanRequest:
    """Return the options with which ``firnline plan`` makes the plan of a document."""
    return PlanRequest(source=area, out=out, prior=terrain, **_given(document), **_assumed(document))


def requirement_request(document: PlanDocument, terrain: Path) -> PlanRequest:
    """Return the options with which ``firnline plan --require`` guarantees the required class of a document."""
    return PlanRequest(
        source=Path("site.gpkg"), out=Path("route.geojson"), prior=terrain, **_required(document)
    )


def command_of(document: PlanDocument, area: str, terrain: str, out: str, *, required: bool = False) -> str:
    """Return the command that makes the same plan.

    >>> document = PlanDocument(planner={"pattern": "wavy", "swaths": 6}, rover={"max_pitch_deg": 20.0})
    >>> command_of(document, "site.gpkg", "srtm.tif", "route.geojson").split(" --")[2:]
    ['pattern wavy', 'swaths 6', 'set rover.max_pitch_deg=20.0 -o route.geojson']
    """
    words = ["firnline", "plan", area, "--prior", terrain]
    given = _required(document) if required else _given(document) | _assumed(document)
    settings = given.pop("settings", ())
    for name, value in given.items():
        words += [f"--{_SPELLINGS.get(name, name)}", str(value)]
    for setting in settings:
        words += ["--set", setting]
    return shlex.join([*words, "-o", out])


def _given(document: PlanDocument) -> dict[str, Any]:
    """Return the options that differ from those of the command."""
    planner = {name: value for name, value in document.planner.items() if value is not None}
    given: dict[str, Any] = {option: planner[name] for name, option in _OPTIONS.items() if name in planner}
    sections: dict[str, dict[str, Setting]] = {
        "planner": {name: planner[name] for name in planner if name not in _OPTIONS}
    }
    sections |= {"rover": document.rover, "fleet": document.fleet}
    settings = tuple(
        f"{section}.{name}={_toml(value)}"
        for section, values in sections.items()
        for name, value in values.items()
        if value is not None
    )
    return given | ({"settings": settings} if settings else {})


def _assumed(document: PlanDocument) -> dict[str, Any]:
    """Return the stated options that the predicted error rests on."""
    return {name: value for name, value in _required(document).items() if name in _ASSUMED}


def _required(document: PlanDocument) -> dict[str, Any]:
    """Return the options of the required class that are stated."""
    stated = {name: document.requirement.get(name) for name in REQUIREMENTS}
    return {name: value for name, value in stated.items() if value is not None}


def _toml(value: Setting) -> str:
    """Return a value as TOML; text as it is, which an override takes for text."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(list(value)) if isinstance(value, tuple) else str(value)


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
    stated = {field.name: field.default for field in dataclass_fields(PlanRequest)}
    hints = get_type_hints(PlanRequest, include_extras=True)
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

"""Request of ``firnline plan`` that stands for a plan document, and the command that is the same."""

import shlex
from pathlib import Path
from typing import Any

from desk.plan.document import PlanDocument, Setting
from firnline.cli.planning.request import PlanRequest

_OPTIONS = {
    "pattern": "pattern",
    "swaths": "swaths",
    "spacing_m": "spacing",
    "budget_m": "budget",
    "rmse_m": "rmse",
}
"""Settings of the section ``planner`` that are options of their own."""
REQUIREMENTS = (
    "require",
    "probability",
    "surface",
    "max_swaths",
    "noise_m",
    "localization_m",
    "prior_sigma_m",
    "assume",
    "micro_relief_m",
    "shared_m",
)
"""Options of a required class or error, in the order of the form."""
_SPELLINGS = {"noise_m": "noise", "localization_m": "localization", "prior_sigma_m": "prior-sigma"}
_SPELLINGS |= {"micro_relief_m": "micro-relief", "shared_m": "shared", "max_swaths": "max-swaths"}


def request_of(document: PlanDocument, area: Path, terrain: Path, out: Path) -> PlanRequest:
    """Return the options with which ``firnline plan`` makes the plan of a document."""
    return PlanRequest(source=area, out=out, prior=terrain, **_given(document))


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
    given = _required(document) if required else _given(document)
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


def _required(document: PlanDocument) -> dict[str, Any]:
    """Return the options of the required class that are stated."""
    stated = {name: document.requirement.get(name) for name in REQUIREMENTS}
    return {name: value for name, value in stated.items() if value is not None}


def _toml(value: Setting) -> str:
    """Return a value as TOML; text as it is, which an override takes for text."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(list(value)) if isinstance(value, tuple) else str(value)

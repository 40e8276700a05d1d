"""Numpydoc validation of the public interface: ``python -m tests.test_docstrings`` lists what is missing.

Public are the names that `firnline` and the packages export in ``__all__``, and the public methods of
exported classes. A docstring is complete when it has a summary, documents every parameter and no other,
and has a Returns section where something is returned. Settings of a configuration are documented by
the strings below its fields, fields of a request by the help of their options, and a method that stands for one of a base
class needs a summary only.
"""

import inspect
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import cached_property
from importlib import import_module
from typing import Any, NamedTuple

from numpydoc.validate import validate
from pydantic import BaseModel

from firnline.actions.interface import Parameter

PACKAGES = ("firnline", "survey", "planners", "vision_slam", "sim", "live", "desk", "papers")
EXPORTING = (
    "firnline",
    "firnline.actions",
    "survey",
    "survey.terrain",
    "survey.scoring",
    "survey.figures",
    "survey.reconstruction",
    "planners",
    "vision_slam",
)
CHECKS = {"GL08": "no docstring", "SS01": "no summary", "PR01": "", "PR02": "", "RT01": "no Returns section"}


REQUIRED_SHARE = 0.95


class Finding(NamedTuple):
    """A public object and what its docstring lacks; empty when it is complete."""

    name: str
    lacks: tuple[str, ...]


def findings() -> list[Finding]:
    """Return one finding for each public function, class and method, sorted by name."""
    members = {name for value in exported().values() for name in public_members(value)}
    return [Finding(name, tuple(lacking(name))) for name in sorted(members)]


def exported() -> dict[str, Any]:
    """Return the exported functions and classes by their qualified names."""
    found = {}
    for package in EXPORTING:
        module = import_module(package)
        for name in module.__all__:
            value = getattr(module, name)
            if inspect.isfunction(value) or inspect.isclass(value):
                found[f"{value.__module__}.{value.__qualname__}"] = value
    return found


def public_members(value: Any) -> Iterator[str]:
    """Yield the qualified name of a function or class, and those of the class's own public methods and properties."""
    yield f"{value.__module__}.{value.__qualname__}"
    if not inspect.isclass(value):
        return
    for owner in value.__mro__:
        if owner.__module__.split(".")[0] not in PACKAGES:
            continue
        inherited = vars(BaseModel) if issubclass(owner, BaseModel) else {}
        for name, member in vars(owner).items():
            documented = inspect.isroutine(member) or isinstance(
                member, property | cached_property | classmethod
            )
            if documented and not name.startswith("_") and name not in inherited:
                yield f"{owner.__module__}.{owner.__qualname__}.{name}"


def lacking(name: str) -> Iterator[str]:
    """Yield what the docstring of an object lacks."""
    module, _, rest = name.rpartition(".")
    try:
        kind = getattr(import_module(module), rest)
    except ModuleNotFoundError:
        kind = None
    codes = dict(CHECKS)
    if kind is None and overrides(name):
        codes.pop("PR01"), codes.pop("RT01")
    if inspect.isclass(kind) and has_parameters(kind):
        codes.pop("PR01"), codes.pop("PR02")
    if inspect.isclass(kind) and issubclass(kind, BaseModel):
        yield from (f"{field} has no description" for field in undescribed(kind))
        codes.pop("PR01"), codes.pop("PR02")
    if getattr(kind, "_is_protocol", False):
        codes.pop("PR01")
    yield from (CHECKS[code] or text for code, text in validate(name)["errors"] if code in codes)


def overrides(name: str) -> bool:
    """Return whether a method stands for one that a base class of the project documents."""
    owner, _, member = name.rpartition(".")
    module, _, rest = owner.rpartition(".")
    kind = getattr(import_module(module), rest)
    return any(member in vars(base) for base in kind.__mro__[1:] if base.__module__.split(".")[0] in PACKAGES)


def has_parameters(kind: type) -> bool:
    """Return whether the fields of a request state their meaning themselves, as options of the command line do."""
    declared = fields(kind) if is_dataclass(kind) else ()
    marks = [mark for field in declared for mark in getattr(field.type, "__metadata__", ())]
    return any(isinstance(mark, Parameter) for mark in marks)


def undescribed(model: type[BaseModel]) -> list[str]:
    """Return the fields of a configuration that no string describes."""
    return [name for name, field in model.model_fields.items() if not field.description]


def share(found: list[Finding]) -> float:
    """Return the share of public objects whose docstring is complete."""
    return sum(not finding.lacks for finding in found) / len(found)


def test_docstrings_of_the_public_interface_are_complete():
    found = findings()
    incomplete = "\n".join(
        f"{finding.name}: {'; '.join(finding.lacks)}" for finding in found if finding.lacks
    )
    assert share(found) >= REQUIRED_SHARE, f"{share(found):.1%} are complete; these are not:\n{incomplete}"


if __name__ == "__main__":
    everything = findings()
    for finding in everything:
        if finding.lacks:
            print(f"{finding.name}: {'; '.join(finding.lacks)}")  # noqa: T201
    print(f"{share(everything):.1%} of {len(everything)} public docstrings are complete")  # noqa: T201

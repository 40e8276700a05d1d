"""Pages of the Python interface: every name of the packages' ``__all__``, each documented once."""

import inspect
from importlib import import_module
from types import ModuleType
from typing import Any

from pydantic import BaseModel

PACKAGES = (
    "firnline",
    "firnline.actions",
    "survey.reconstruction",
    "survey.scoring",
    "survey.figures",
    "survey.terrain",
    "planners",
    "vision_slam",
    "survey",
)
"""Packages in the order in which a name is documented: at the first that exports it."""
_KINDS = ("Functions", "Data and results", "Settings", "Exceptions")


def pages() -> dict[str, str]:
    """Return one page for each package, and a list of them."""
    texts = {f"reference/api/{package}.rst": package_page(package) for package in PACKAGES}
    texts["reference/api/index.rst"] = index_page()
    return texts


def homes() -> dict[int, str]:
    """Return under which qualified name each exported object is documented, by its identity."""
    found: dict[int, str] = {}
    for package in PACKAGES:
        module = import_module(package)
        for name in documented(module):
            found.setdefault(id(getattr(module, name)), f"{package}.{name}")
    return found


def documented(module: ModuleType) -> list[str]:
    """Return the names of a package that have pages: all but the version."""
    return [name for name in module.__all__ if name != "__version__"]


def kind(value: Any) -> str:
    """Return the heading under which an object stands."""
    if inspect.isclass(value):
        if issubclass(value, Exception):
            return "Exceptions"
        return "Settings" if issubclass(value, BaseModel) else "Data and results"
    return "Functions"


def package_page(package: str) -> str:
    """Return the page of a package: its names by kind, each with a page of its own or a link to it."""
    module = import_module(package)
    places = homes()
    own: dict[str, list[str]] = {name: [] for name in _KINDS}
    elsewhere: list[str] = []
    for name in documented(module):
        value = getattr(module, name)
        home = places[id(value)]
        if home == f"{package}.{name}":
            own[kind(value)].append(name)
        else:
            elsewhere.append(home)
    parts = [heading(package, "="), summary(module)]
    parts += [section(title, package, names) for title, names in own.items() if names]
    if elsewhere:
        parts.append(heading("Also exported here", "-") + "\n" + listing(sorted(elsewhere)))
    return "\n".join(parts)


def section(title: str, package: str, names: list[str]) -> str:
    """Return a heading and the table of names that have their pages here."""
    listed = "\n".join(f"   {name}" for name in sorted(names))
    head = f"{heading(title, '-')}\n.. currentmodule:: {package}\n\n"
    return f"{head}.. autosummary::\n   :toctree: objects\n   :nosignatures:\n\n{listed}\n"


def listing(names: list[str]) -> str:
    """Return the table of names whose pages stand with another package."""
    return ".. autosummary::\n   :nosignatures:\n\n" + "\n".join(f"   ~{name}" for name in names) + "\n"


def index_page() -> str:
    """Return the list of packages."""
    rows = "\n".join(
        f"   * - :doc:`{package}`\n     - {summary(import_module(package)).strip()}"
        for package in sorted(PACKAGES)
    )
    tree = "\n".join(f"   {package}" for package in sorted(PACKAGES))
    head = (
        heading("Python interface", "=")
        + "\nUsers need the package ``firnline`` alone; the others are for those who extend it.\n\n"
    )
    return f"{head}.. list-table::\n   :widths: 25 75\n\n{rows}\n\n.. toctree::\n   :hidden:\n\n{tree}\n"


def summary(module: ModuleType) -> str:
    """Return the first paragraph of a package's docstring."""
    return " ".join((module.__doc__ or "").strip().split("\n\n")[0].split()) + "\n"


def heading(text: str, sign: str) -> str:
    """Return a heading in reST."""
    return f"{text}\n{sign * len(text)}\n"

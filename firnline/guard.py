"""Check that firnline's packages are not hidden by modules of the same names."""

import sys
from importlib.util import find_spec
from pathlib import Path

PACKAGES = ("survey", "planners", "vision_slam", "sim", "live", "desk", "papers")


def foreign_package() -> str | None:
    """Return a sentence about the first package that resolves to another place than firnline's, or None.

    Python finds the modules of the current folder first, so that a script ``sim.py`` hides the
    package `sim`.

    >>> foreign_package() is None
    True
    """
    home = Path(__file__).resolve().parents[1]
    for name in PACKAGES:
        found = _place_of(name)
        if found is None or found.parents[1] != home:
            place = "nowhere" if found is None else str(found)
            return (
                f"firnline: the package {name!r} resolves to {place}, not to {home / name}; rename that "
                "file or folder, or install firnline into an environment of its own."
            )
    return None


def _place_of(name: str) -> Path | None:
    """Return the file that ``import name`` would run."""
    loaded = sys.modules.get(name)
    origin = getattr(loaded, "__file__", None) if loaded is not None else None
    if origin is None:
        spec = find_spec(name)
        origin = None if spec is None else spec.origin
    return None if origin is None else Path(origin).resolve()

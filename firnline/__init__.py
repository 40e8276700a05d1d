"""Public interface of firnline: plan, simulate and judge robotic surveys of glaciers and other terrain.

Names are imported when they are first used, so that ``import firnline`` is quick. They are listed
in ``__init__.pyi`` with the modules that define them.
"""

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

from firnline.guard import foreign_package


def _modules_by_name() -> dict[str, str]:
    """Read from the stub file which module defines each public name."""
    tree = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    return {alias.name: node.module or "" for node in imports for alias in node.names}


_MODULES = _modules_by_name()

__all__ = ["__version__", *_MODULES]  # noqa: PLE0604  # names from the stub file


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name == "__version__":
        from importlib.metadata import version

        return version("firnline")
    if name not in _MODULES:
        raise AttributeError(f"module 'firnline' has no attribute {name!r}")
    foreign = foreign_package()
    if foreign is not None:
        raise ImportError(foreign)
    value = getattr(import_module(_MODULES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names."""
    return sorted(__all__)

"""Lazy import of a package's public names: each is imported when it is first used (PEP 562).

The names and the modules that define them are read from the package's stub file ``__init__.pyi``, which is also
what type checkers read.
"""

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

# lazy_loader.attach_stub serves the same purpose, but it refuses stubs with absolute imports, such as ours.


def attach(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package whose names are in its stub file.

    Returns: functions ``__getattr__`` and ``__dir__``, and the list ``__all__``.

    >>> import survey
    >>> get, _, names = attach("survey", survey.__file__)
    >>> "Dem" in names, get("Dem").__module__
    (True, 'survey.data.dem')
    """
    modules = modules_by_name(Path(file).with_suffix(".pyi"))

    def get(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(modules[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    return get, lambda: sorted(modules), list(modules)


def modules_by_name(stub: Path) -> dict[str, str]:
    """Return the module that defines each public name of a stub file."""
    tree = ast.parse(stub.read_text(encoding="utf-8"))
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    return {alias.name: node.module or "" for node in imports for alias in node.names}

"""The public interface: names are imported when used, and the types that its functions take and return are public."""

import ast
import inspect
import os
import subprocess
import sys
import typing
from importlib.metadata import version
from pathlib import Path

import pytest

import firnline

ROOT = Path(__file__).resolve().parents[2]
OWN = ("firnline", "survey", "planners", "vision_slam", "sim", "live", "desk", "papers")
# Users hand it on to functions of the package, and read nothing of it.
HANDED_ON = {"JointSolution"}
NAMES = [name for name in firnline.__all__ if name != "__version__"]
FUNCTIONS = [name for name in NAMES if inspect.isfunction(getattr(firnline, name))]
INTERFACES = {"Section", "DisplacementField", "ErrorModel"}
"""Types of parameters that users do not construct: settings of a method, a field of their choice, `planners.prior_model`."""


def run(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    settings = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=folder, env=settings, check=False
    )


def test_importing_firnline_imports_nothing_heavy(tmp_path):
    code = "import firnline, sys; print(len(firnline.__all__)); print(*(set(sys.modules) & {%s}))"
    heavy = ("numpy", "scipy", "matplotlib", "rasterio", "pydantic", "shapely", "pyproj", "cv2", *OWN[1:])
    found = run(code % ", ".join(map(repr, heavy)), tmp_path)
    assert found.stdout.split() == [str(len(firnline.__all__))], found.stderr


def test_version_is_that_of_the_installed_package():
    assert firnline.__version__ == version("firnline")


@pytest.mark.parametrize("name", NAMES)
def test_every_name_is_defined_in_its_module_and_listed_by_dir(name):
    assert getattr(firnline, name).__name__ == name
    assert name in dir(firnline)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'firnline' has no attribute 'plane'"):
        _ = firnline.plane


@pytest.mark.parametrize("hidden", ["sim.py", "survey/__init__.py", "planners.py"])
def test_a_local_module_that_hides_a_package_is_named(hidden, tmp_path):
    file = tmp_path / hidden
    file.parent.mkdir(exist_ok=True)
    file.write_text("")
    package = hidden.split("/")[0].removesuffix(".py")
    found = run("import sys; sys.path.insert(0, ''); from firnline import plan", tmp_path)
    assert found.returncode == 1
    expected = (
        f"ImportError: firnline: the package '{package}' resolves to {file}, not to {ROOT / package}; rename"
    )
    assert found.stderr.splitlines()[-1].startswith(expected)
    command = run("import sys; sys.path.insert(0, ''); from firnline.__main__ import main; main()", tmp_path)
    assert (command.returncode, command.stderr.count("\n")) == (1, 1)
    assert command.stderr.startswith(f"firnline: the package '{package}' resolves to {file}")


def test_the_package_runs_as_a_command(tmp_path):
    settings = {**os.environ, "PYTHONPATH": str(ROOT)}
    found = subprocess.run(
        [sys.executable, "-m", "firnline", "--help"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=settings,
        check=True,
    )
    assert "firnline" in found.stdout


def own_classes(annotation: object) -> set[type]:
    if isinstance(annotation, list | tuple):
        return set().union(*map(own_classes, annotation)) if annotation else set()
    if inspect.isclass(annotation) and annotation.__module__.split(".")[0] in OWN:
        return {annotation}
    return own_classes(typing.get_args(annotation))


def hints(function: typing.Any) -> dict[str, object]:
    """Return the type hints of a function; names for type checking alone are public ones."""
    ours = {name: getattr(firnline, name) for name in NAMES}
    return typing.get_type_hints(inspect.unwrap(function), localns=ours)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_types_that_a_public_function_takes_and_returns_are_public(name):
    public = {getattr(firnline, each) for each in NAMES}
    needed = set().union(*map(own_classes, hints(getattr(firnline, name)).values()))
    missing = {kind.__qualname__ for kind in needed - public} - INTERFACES
    assert not missing, f"{name} needs {sorted(missing)}"


def test_the_stub_lists_each_name_once_in_its_defining_module():
    tree = ast.parse((ROOT / "firnline" / "__init__.pyi").read_text())
    listed = [
        (alias.name, alias.asname, node.module)
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    ]
    assert [name for name, _, _ in listed] == NAMES
    assert all(name == alias for name, alias, _ in listed)
    for name, _, module in listed:
        assert getattr(firnline, name).__module__ == module, name

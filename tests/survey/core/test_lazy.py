"""Public names of packages are imported when they are first used."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from survey.core.lazy import attach, modules_by_name

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = ("survey", "survey.reconstruction", "planners", "vision_slam")
WITHOUT_NAMES = ("sim", "live", "desk")


def loaded_by(statement: str) -> set[str]:
    """Return the packages that a statement imports in a new process."""
    code = f"{statement}\nimport sys; print(*(name for name in sys.modules if '.' not in name))"
    found = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, cwd=ROOT)
    return set(found.stdout.split())


@pytest.mark.parametrize("package", PACKAGES + WITHOUT_NAMES)
def test_a_package_imports_nothing_heavy_before_a_name_is_used(package):
    assert not loaded_by(f"import {package}") & {
        "numpy",
        "scipy",
        "matplotlib",
        "rasterio",
        "pydantic",
    }


def test_a_terrain_model_imports_neither_estimators_nor_plots():
    heavy = {"scipy", "matplotlib", "numba", "sklearn", "pydantic", "shapely", "pandas", "cv2"}
    assert not loaded_by("from firnline import Dem") & heavy


def test_settings_of_planners_import_no_compiled_layouts():
    heavy = {"numba", "matplotlib", "sklearn", "cv2"}
    assert not loaded_by("from firnline import LawnmowerConfig, WavyConfig, Rover, Fleet") & (
        heavy | {"scipy"}
    )
    assert (
        not loaded_by(
            "from planners import BestConfig, VarianceDrivenConfig; from planners.registry import PlannerConfig"
        )
        & heavy
    )


@pytest.mark.parametrize("package", PACKAGES)
def test_names_are_those_of_the_stub_file(package):
    module = import_module(package)
    stub = modules_by_name(Path(module.__file__).with_suffix(".pyi"))
    assert list(stub) == module.__all__ == sorted(dir(module), key=module.__all__.index)
    assert all(getattr(module, name) is not None for name in stub)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'survey' has no attribute 'Dom'"):
        import_module("survey").Dom  # noqa: B018


def test_a_name_is_looked_up_once(tmp_path, monkeypatch):
    package = tmp_path / "lazy_example"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "nouns.py").write_text("class Glacier: ...\n")
    (package / "__init__.pyi").write_text("from lazy_example.nouns import Glacier as Glacier\n")
    monkeypatch.syspath_prepend(tmp_path)
    module = import_module("lazy_example")
    get, listed, names = attach("lazy_example", module.__file__)
    assert names == listed() == ["Glacier"]
    assert not hasattr(module, "Glacier")
    assert get("Glacier") is module.Glacier

"""The conda recipe has the version, the Pythons, the requirements and the command of pyproject.toml, by the names of conda-forge."""

import tomllib
from pathlib import Path
from typing import Any

import yaml
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
RECIPE: dict[str, Any] = yaml.safe_load(
    (ROOT / "packaging" / "conda" / "recipe.yaml").read_text(encoding="utf-8")
)
NAMES = {"matplotlib": "matplotlib-base", "mujoco": "mujoco-python", "opencv-python-headless": "py-opencv"}
"""Names of conda-forge where they differ from those of PyPI."""
EXTRAS = {("laspy", "lazrs"): "lazrs-python"}
LEFT_OUT = {"pybullet"}
"""Requirements of some Pythons only, which a package for all of them cannot have."""


def expected(requirements: list[str]) -> set[str]:
    """Return requirements of PyPI as conda writes them."""
    found = set()
    for one in map(Requirement, requirements):
        if one.name not in LEFT_OUT:
            found.add(f"{NAMES.get(one.name, one.name)} {one.specifier}")
            found |= {EXTRAS[one.name, extra] for extra in one.extras}
    return found


def test_the_recipe_runs_with_the_requirements_of_the_project():
    project = PROJECT["project"]
    python = f"python {project['requires-python']}"
    assert set(RECIPE["requirements"]["run"]) == {python, *expected(project["dependencies"])}
    built = {python, "pip", *expected(PROJECT["build-system"]["requires"])}
    assert set(RECIPE["requirements"]["host"]) == built


def test_only_pybullet_is_left_out_and_only_older_pythons_need_it():
    marked = {one.name for one in map(Requirement, PROJECT["project"]["dependencies"]) if one.marker}
    assert marked == {*LEFT_OUT, "mujoco"}


def test_version_summary_licence_and_command_are_those_of_the_project():
    project = PROJECT["project"]
    assert RECIPE["context"]["version"] == project["version"]
    assert RECIPE["about"]["summary"] == project["description"]
    assert RECIPE["about"]["license"] == project["license"]
    (command,) = RECIPE["build"]["python"]["entry_points"]
    assert dict([command.split(" = ")]) == project["scripts"]


def test_the_recipe_builds_this_folder_once_for_every_python():
    assert (ROOT / "packaging" / "conda" / RECIPE["source"]["path"]).resolve() == ROOT
    assert RECIPE["build"]["noarch"] == "python"
    assert (ROOT / RECIPE["about"]["license_file"]).is_file()

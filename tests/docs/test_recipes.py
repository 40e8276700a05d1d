"""The recipes of CONTRIBUTING.md: each extension works in a copy of the packages, from as many files as are stated."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.recipes.command import COMMAND
from tests.docs.recipes.kernel import KERNEL
from tests.docs.recipes.method import METHOD
from tests.docs.recipes.planner import PLANNER
from tests.docs.recipes.recipe import Recipe
from tests.docs.recipes.route_format import ROUTE_FORMAT
from tests.docs.recipes.sensor import SENSOR

ROOT = Path(__file__).parents[2]
RECIPES = (PLANNER, METHOD, SENSOR, ROUTE_FORMAT, KERNEL, COMMAND)
PACKAGES = ("firnline", "survey", "planners", "vision_slam", "sim", "live", "desk", "papers")
PRELUDE = """
import sys
from firnline import MissionConfig
from typer.testing import CliRunner
from firnline.cli.main import app

def command(*words):
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output

def mission(**sections):
    needed = {"schema_version": 1, "name": "m", "terrain": {"source": "random"}, "planner": {"pattern": "lawnmower", "swaths": 2}}
    return MissionConfig.model_validate(needed | sections)
"""

pytestmark = pytest.mark.walkthrough


@pytest.fixture(scope="module")
def copy(tmp_path_factory) -> Path:
    """Copy the packages and follow all recipes in the copy."""
    folder = tmp_path_factory.mktemp("extended")
    for package in PACKAGES:
        # With the compiled loops, which took most of the time where they were compiled again.
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("vendor"))
    for recipe in RECIPES:
        recipe.follow(folder)
    return folder


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda recipe: recipe.heading)
def test_an_extension_needs_the_stated_files_and_works(recipe: Recipe, copy: Path, tmp_path: Path) -> None:
    headings = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    stated = re.search(rf"^## {recipe.heading} \((\d) files?\)", headings, flags=re.MULTILINE)
    assert stated
    assert len(recipe.added) + len(recipe.inserted) == int(stated[1]) <= recipe.most_files
    script = f"import sys; sys.path.insert(0, {str(copy)!r})\n" + PRELUDE + recipe.check
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr

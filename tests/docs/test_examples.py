"""Examples: scripts, notebooks, figures of the gallery."""

import re
import runpy
from collections import Counter
from importlib import import_module
from pathlib import Path

import matplotlib as mpl
import nbformat
import pytest
from matplotlib import pyplot as plt

from docs.generate.examples import LONG_TUTORIALS
from tests.docs.console import Shell
from tests.docs.scratch import make_scratch

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted((ROOT / "examples").glob("*.py"))
FIGURES = sorted((ROOT / "examples" / "gallery").rglob("plot_*.py"))
LONGEST_FIGURE_SCRIPT = 40
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
MOST_FILES = 15
INSTEAD = {
    "firnline export route.geojson survey.plan --area site.kml --dem copernicus.tif --speed 1.2": "firnline export route.geojson survey.plan --area site.kml --dem copernicus.tif --speed 1.2 --force",
    "firnline montecarlo study.toml --scheduler tcp://10.0.0.5:8786": "firnline montecarlo study.toml --engine dask",
    "firnline run srtm_ridge.toml": "firnline run srtm_ridge.toml --until localize",
    "firnline run srtm_ridge.toml --set planner.swaths=8": "firnline run srtm_ridge.toml --set planner.swaths=8 --dry-run",
    "firnline run white_out.toml": "firnline run white_out.toml --until plan",
    "firnline score 2026.tif --checkpoints gnss.csv --standard asprs-edition-2 --class 0.50": "firnline score 2026.tif --checkpoints gnss.csv --standard asprs-edition-2 --class 1.00",
}
"""Commands that take longer than a test should, that need files the script wrote before or that judge another map, and
what runs instead."""

pytestmark = pytest.mark.timeout(1800)


@pytest.mark.parametrize(
    "script",
    [
        pytest.param(
            script, marks=pytest.mark.exhaustive if script.stem in LONG_TUTORIALS else pytest.mark.walkthrough
        )
        for script in SCRIPTS
    ],
    ids=lambda script: script.stem,
)
def test_a_tutorial_runs_with_the_commands_that_it_shows(script, tmp_path, monkeypatch):
    make_scratch(tmp_path)
    monkeypatch.chdir(tmp_path)
    with mpl.rc_context({"backend": "Agg", "figure.max_open_warning": 0}):
        runpy.run_path(str(script), run_name="example")
    plt.close("all")
    shell = Shell()
    for command in shown_commands(script):
        output = shell.run(command)
        assert shell.code == 0, f"{command}\n{output}"


def shown_commands(script):
    """Return the commands in the text of a tutorial, some of them as `INSTEAD` says."""
    found = re.findall(r"^# (firnline .*)$", script.read_text(encoding="utf-8"), flags=re.MULTILINE)
    commands = [command.split("#")[0].rstrip() for command in found]
    return [INSTEAD.get(command, command) for command in commands]


@pytest.mark.parametrize("script", FIGURES, ids=lambda script: script.stem)
def test_the_script_of_a_figure_is_short(script):
    # `make docs` executes it, and ends at an error.
    assert len(script.read_text(encoding="utf-8").splitlines()) <= LONGEST_FIGURE_SCRIPT


def test_there_are_twenty_figures_in_sections_of_at_most_fifteen():
    assert len(FIGURES) >= 20
    sections = Counter(script.parent for script in FIGURES)
    assert max(sections.values()) <= MOST_FILES
    for section in sections:
        assert section.parent.name == "gallery"
        assert (section / "README.rst").is_file()


def test_the_notebooks_are_those_of_the_scripts(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    examples = import_module("generate.examples")
    for script in examples.scripts():
        notebook = script.parent / "notebooks" / f"{script.stem}.ipynb"
        assert notebook.read_text(encoding="utf-8") == examples.notebook_text(script), (
            f"run python docs/write_notebooks.py: {notebook.name} differs from its script"
        )


@pytest.mark.exhaustive
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda notebook: notebook.stem)
def test_a_notebook_runs(notebook, tmp_path, monkeypatch):
    execution = pytest.importorskip("nbclient", reason="the extra docs is not installed")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.delenv("MPLBACKEND", raising=False)
    cells = nbformat.read(notebook, as_version=4)
    execution.NotebookClient(cells, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()

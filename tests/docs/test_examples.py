"""Examples: scripts, notebooks, figures of the gallery."""

import runpy
from collections import Counter
from importlib import import_module
from pathlib import Path

import matplotlib as mpl
import pytest
from matplotlib import pyplot as plt

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted((ROOT / "examples").glob("*.py"))
FIGURES = sorted((ROOT / "examples" / "gallery").rglob("plot_*.py"))
LONGEST_FIGURE_SCRIPT = 40
MOST_FILES = 15


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_the_script_of_a_tutorial_runs(script, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with mpl.rc_context({"backend": "Agg", "figure.max_open_warning": 0}):
        runpy.run_path(str(script), run_name="example")
    plt.close("all")


@pytest.mark.parametrize("script", FIGURES, ids=lambda script: script.stem)
def test_the_script_of_a_figure_is_short_and_runs(script, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert len(script.read_text(encoding="utf-8").splitlines()) <= LONGEST_FIGURE_SCRIPT
    with mpl.rc_context({"backend": "Agg"}):
        runpy.run_path(str(script), run_name="example")
    plt.close("all")


def test_there_are_twenty_figures_in_sections_of_at_most_fifteen():
    assert len(FIGURES) >= 20
    sections = Counter(script.parent for script in FIGURES)
    assert max(sections.values()) <= MOST_FILES
    for section in sections:
        assert section.parent.name == "gallery"
        assert (section / "README.rst").is_file()


def test_the_notebooks_are_those_of_the_scripts(monkeypatch):
    pytest.importorskip("jupytext", reason="the extra docs is not installed")
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    examples = import_module("generate.examples")
    for script in examples.scripts():
        notebook = script.parent / "notebooks" / f"{script.stem}.ipynb"
        assert notebook.read_text(encoding="utf-8") == examples.notebook_text(script), (
            f"run python docs/write_notebooks.py: {notebook.name} differs from its script"
        )

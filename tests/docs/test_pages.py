"""README: the Python that it shows runs, and the version is stated once."""

import re
from pathlib import Path

import matplotlib as mpl
from matplotlib import pyplot as plt

from tests.docs.scratch import make_scratch

ROOT = Path(__file__).parents[2]


def blocks(page, language=None):
    """Return the fenced blocks of a page, those of one language where it is named."""
    found = re.findall(
        r"^```(\w*)\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    return [text for name, text in found if language in (None, name)]


def test_the_python_of_the_readme_runs(tmp_path, monkeypatch):
    make_scratch(tmp_path)
    monkeypatch.chdir(tmp_path)
    texts = blocks(ROOT / "README.md", "python")
    assert len(texts) == 2
    for text in texts:
        with mpl.rc_context({"backend": "Agg"}):
            exec(compile(text, "README.md", "exec"), {})
    plt.close("all")


def test_the_version_is_stated_once():
    stated = re.search(
        r'^version = "(.*)"', (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.MULTILINE
    )
    cited = re.search(r"^version: (.*)", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert stated
    assert cited
    assert stated[1] == cited[1]


def test_every_stored_table_stands_in_the_list_of_results():
    text = (ROOT / "results" / "README.md").read_text(encoding="utf-8")
    stored = sorted(file.name for file in (ROOT / "results" / "benchmarks").glob("*.json"))
    assert [name for name in stored if f"`benchmarks/{name}`" not in text] == []

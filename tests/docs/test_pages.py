"""Pages of README and docs: commands that they show exist, Python that README shows runs."""

import re
import shlex
from pathlib import Path

import matplotlib as mpl
import pytest
import typer
from matplotlib import pyplot as plt

from sim.cli.main import app
from tests.docs.scratch import make_scratch

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    *(p for p in sorted((ROOT / "docs").rglob("*.md")) if not {"_build", "reference"} & set(p.parts)),
]
COMMANDS = typer.main.get_command(app).commands


def blocks(page, language=None):
    """Return the fenced blocks of a page, those of one language where it is named."""
    found = re.findall(
        r"^```(\w*)\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    return [text for name, text in found if language in (None, name)]


def shown_commands(page):
    """Yield the words of every ``firnline`` command in the blocks of a page."""
    for text in blocks(page):
        for line in text.splitlines():
            command = re.sub(r"^(\$ )?(\.venv/bin/)?", "", line.strip())
            if command.startswith("firnline ") and not command.startswith("firnline:"):
                yield shlex.split(command, comments=True)[1:]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_commands_and_options_on_a_page_exist(page):
    for name, *words in shown_commands(page):
        if name.startswith("-") or not re.fullmatch(r"[a-z]+", name):
            continue
        assert name in COMMANDS, f"{page.name} shows firnline {name}"
        known = {spelling for p in COMMANDS[name].params for spelling in (*p.opts, *p.secondary_opts)}
        unknown = {word for word in words if re.match(r"--?[a-z]", word)} - known - {"--help", "-h"}
        assert not unknown, f"{page.name} shows firnline {name} with {unknown}"


def test_the_python_of_the_readme_runs(tmp_path, monkeypatch):
    make_scratch(tmp_path)
    monkeypatch.chdir(tmp_path)
    (text,) = blocks(ROOT / "README.md", "python")
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

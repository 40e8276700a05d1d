"""The console transcripts of README and docs run as shown.

A block that begins with three backticks and ``console`` holds lines ``$ command`` with their output, where ``...``
stands for anything. Blocks of one page run one after the other in one folder, which holds the files of
``tests/docs/scratch.py`` and the recordings of ``tests/docs/scratch_drives.py`` that its commands name. A command whose output is not shown must end with exit code 0; another exit code is shown by
``$ echo $?``. Commands are ``firnline`` (output to a file by ``>``), ``cat``, ``head -N``, ``ls`` and ``echo $?``; they
run in this process, so that hundreds of them are cheap.
"""

import doctest
import re
import shutil
from pathlib import Path

import pytest

from firnline.cli.main import app
from tests.docs.console import Entry, Shell, entries
from tests.docs.scratch import make_scratch
from tests.docs.scratch_drives import make_drives

ROOT = Path(__file__).parents[2]
PAGES = (
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *(p for p in sorted((ROOT / "docs").rglob("*.md")) if not {"_build", "reference"} & set(p.parts)),
)
SERVERS = ("desk", "rover", "upload", "download", "watch", r"simulate \S+ --serve")
"""Commands that run until they are stopped or speak to a rover; the tests of the desk and of live surveys start them."""
_LONGEST = 4000
_RULES = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scratch")
    make_scratch(folder)
    return folder


@pytest.mark.walkthrough
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_transcripts_of_a_page_run_as_shown(
    page: Path, scratch: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = list(entries(page.read_text(encoding="utf-8")))
    if not found:
        pytest.skip("no console transcripts")
    here = tmp_path / "here"
    shutil.copytree(scratch, here)
    make_drives(here, " ".join(entry.command for entry in found))
    monkeypatch.chdir(here)
    shell = Shell()
    for entry in found:
        output = shell.run(entry.command)
        where = f"{page.relative_to(ROOT)}, line {entry.line}: {entry.command}"
        want = "\n".join(entry.shown) + "\n"
        if entry.shown and not doctest.OutputChecker().check_output(want, output, _RULES):
            pytest.fail(f"{where}\nshown:\n{want}\nfound:\n{output[:_LONGEST]}", pytrace=False)
        if not entry.shown and shell.code != 0:
            pytest.fail(f"{where}\nended with exit code {shell.code}:\n{output[:_LONGEST]}", pytrace=False)
    assert shell.code == 0, f"{page} ends with exit code {shell.code}"


def test_a_transcript_is_cut_into_commands_and_output() -> None:
    page = "text\n```console\n$ firnline plan \\\n> a.kml\n6 lines\n...\n$ ls\n```\n```\n$ not run\n```\n"
    assert list(entries(page)) == [Entry(3, "firnline plan a.kml", ["6 lines", "..."]), Entry(7, "ls")]


def shown_elsewhere(page: Path) -> list[str]:
    """Return the commands of firnline in the blocks of a page that no test runs."""
    blocks = re.findall(
        r"^```(?!console)\S*\n(.*?)^```", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    lines = (line.strip() for text in blocks for line in text.splitlines())
    return [line for line in lines if re.match(rf"(\$ )?(\S*/)?firnline (?!{'|'.join(SERVERS)})", line)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_command_that_a_page_shows_is_run(page: Path) -> None:
    assert not shown_elsewhere(page)


def test_every_command_of_the_command_line_is_run_by_a_transcript() -> None:
    ran = {
        entry.command.split()[1]
        for page in PAGES
        for entry in entries(page.read_text("utf-8"))
        if entry.command.startswith("firnline ")
    }
    commands = {
        info.name or info.callback.__name__.strip("_") for info in app.registered_commands if not info.hidden
    }
    assert commands - ran == {"desk", "rover", "download", "watch"}

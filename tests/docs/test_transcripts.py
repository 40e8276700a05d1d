"""The console transcripts of README and docs run as shown.

A block that begins with three backticks and ``console`` holds lines ``$ command`` with their output, where ``...``
stands for anything. Blocks of one page run one after the other in one folder, which holds the files of
``tests/docs/scratch.py``. A command whose output is not shown must end with exit code 0; another exit code is shown by
``$ echo $?``. Commands are ``firnline`` (output to a file by ``>``), ``cat``, ``head -N``, ``ls`` and ``echo $?``; they
run in this process, so that hundreds of them are cheap.
"""

import doctest
import logging
import re
import shlex
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from typer.testing import CliRunner

from sim.cli.main import app
from tests.docs.scratch import make_scratch

ROOT = Path(__file__).parents[2]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
_LONGEST = 4000
_RULES = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


@dataclass
class Entry:
    """A command of a transcript with the line that it stands in, and the output that is shown."""

    line: int
    command: str
    shown: list[str] = field(default_factory=list)


def entries(page: str) -> Iterator[Entry]:
    """Yield the commands of a page in order."""
    entry: Entry | None = None
    inside = False
    for number, text in enumerate(page.splitlines(), start=1):
        if text.startswith("```"):
            if entry:
                yield entry
            inside, entry = text.strip() == "```console", None
        elif inside and text.startswith("$ "):
            if entry:
                yield entry
            entry = Entry(number, text[2:])
        elif inside and entry:
            if entry.command.endswith("\\"):
                entry.command = entry.command[:-1] + text.strip().removeprefix("> ")
            else:
                entry.shown.append(text)


class Shell:
    """The few commands that transcripts use, run in one folder."""

    def __init__(self) -> None:
        self.code = 0

    def run(self, command: str) -> str:
        """Run a command and return what a terminal would show."""
        words = shlex.split(command, comments=True)
        if words == ["echo", "$?"]:
            code, self.code = self.code, 0
            return f"{code}\n"
        assert self.code == 0, f"the command before ended with exit code {self.code}"
        return getattr(self, f"_{words[0]}")(words[1:])

    def _firnline(self, words: list[str]) -> str:
        target = None
        if ">" in words:
            words, (target,) = words[: words.index(">")], words[words.index(">") + 1 :]
        # What no handler takes goes to stderr, as in a process of its own.
        root = logging.getLogger()
        root.addHandler(logging.lastResort)
        try:
            done = CliRunner().invoke(app, words, env={"COLUMNS": "100"}, prog_name="firnline")
        finally:
            root.removeHandler(logging.lastResort)
        self.code = done.exit_code
        if done.exception and not isinstance(done.exception, SystemExit):
            raise done.exception
        if target is None:
            return done.output
        Path(target).write_text(done.stdout, encoding="utf-8")
        return done.stderr

    def _cat(self, words: list[str]) -> str:
        return "".join(Path(word).read_text(encoding="utf-8") for word in words)

    def _head(self, words: list[str]) -> str:
        lines = Path(words[1]).read_text(encoding="utf-8").splitlines(keepends=True)
        return "".join(lines[: int(words[0][1:])])

    def _ls(self, words: list[str]) -> str:
        folder = Path(words[0]) if words else Path()
        return "".join(f"{path.name}\n" for path in sorted(folder.iterdir()))


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scratch")
    make_scratch(folder)
    return folder


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_transcripts_of_a_page_run_as_shown(
    page: Path, scratch: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = list(entries(page.read_text(encoding="utf-8")))
    if not found:
        pytest.skip("no console transcripts")
    here = tmp_path / "here"
    shutil.copytree(scratch, here)
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


def test_every_command_of_the_command_line_is_run_by_a_transcript() -> None:
    ran = {
        e.command.split()[1]
        for page in PAGES
        for e in entries(page.read_text("utf-8"))
        if "firnline " in e.command
    }
    unknown = {name for name in ran if re.fullmatch("[a-z]+", name)} - {
        info.name or info.callback.__name__.strip("_") for info in app.registered_commands
    }
    assert not unknown

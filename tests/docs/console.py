"""Console transcripts: their commands with the output that is shown, and a shell that runs them in this process."""

import logging
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from typer.testing import CliRunner

from firnline.cli.main import app

# How far a command is; pages leave it out, since it depends on the time that the command takes.
_PROGRESS = re.compile(r"^[^:\n]+: \d+ of \d+(, about .* left)?\n", re.MULTILINE)


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
            return _PROGRESS.sub("", done.output)
        Path(target).write_text(done.stdout, encoding="utf-8")
        return _PROGRESS.sub("", done.stderr)

    def _cat(self, words: list[str]) -> str:
        return "".join(Path(word).read_text(encoding="utf-8") for word in words)

    def _head(self, words: list[str]) -> str:
        lines = Path(words[1]).read_text(encoding="utf-8").splitlines(keepends=True)
        return "".join(lines[: int(words[0][1:])])

    def _ls(self, words: list[str]) -> str:
        folder = Path(words[0]) if words else Path()
        return "".join(f"{path.name}\n" for path in sorted(folder.iterdir()))

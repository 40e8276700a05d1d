"""One case of bad input: a folder prepared for it, and a command line."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

Prepare = Callable[[Path], None]
Right = Callable[[Path, str], str]
"""From the folder and what the command printed to what is wrong with its result, ``""`` where nothing is."""


class Case(NamedTuple):
    """A command line that must not succeed silently.

    Parameters
    ----------
    name : str
        What is wrong, and where.
    prepare : callable
        Writes the files of the case into an empty folder.
    args : list of str
        Command line without the program's name; it runs in that folder.
    may_succeed : bool
        Whether exit code 0 is right: the input is odd and can be used.
    right : callable, optional
        Checks a result of a command that succeeded; without it every success counts that may be.
    words : tuple of str
        A refusal holds one of them, such as the option that helps; any refusal will do where it is empty.
    """

    name: str
    prepare: Prepare
    args: list[str]
    may_succeed: bool = False
    right: Right | None = None
    words: tuple[str, ...] = ()


def both(*steps: Prepare) -> Prepare:
    """Return a preparation that does several ones in turn."""

    def prepare(folder: Path) -> None:
        for step in steps:
            step(folder)

    return prepare


def text(name: str, content: str | bytes) -> Prepare:
    """Return a preparation that writes one file."""

    def prepare(folder: Path) -> None:
        raw = content.encode("utf-8") if isinstance(content, str) else content
        (folder / name).write_bytes(raw)

    return prepare

"""Files that are either whole or not there."""

import logging
import os
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from survey.core.errors import InputError


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; put it in place only when all went well.

    An interrupted writer leaves what stood at `path` before untouched. A format of several
    files (Shapefile, ASCII grid) is there once its main file is: what stood there goes first,
    the companions come, then the main file.

    Raises
    ------
    InputError
        When the folder is missing or may not be written to, or the disk is full.
    """
    target = Path(path)
    if not target.parent.is_dir():
        raise InputError(
            f"the folder {target.parent} does not exist; create it or choose another place for {target.name}."
        )
    try:
        with tempfile.TemporaryDirectory(prefix=f".{target.stem}-", dir=target.parent) as folder:
            draft = Path(folder) / target.name
            yield draft
            companions = sorted(
                f for f in Path(folder).iterdir() if f != draft and f.stem.startswith(target.stem)
            )
            for file in (*companions, draft):
                synced(file)
            if companions:
                target.unlink(missing_ok=True)
            for companion in companions:
                companion.replace(target.parent / companion.name)
            draft.replace(target)
    except OSError as error:
        raise InputError(
            f"{target} could not be written ({error.strerror or error}); free space or choose another place."
        ) from error


class DamagedError(ValueError):
    """A library has read a file that does not hold what it says."""


# What GDAL warns of and goes on with a value that the file does not hold.
_DAMAGE = ("parsed incompletely", "corrupt", "truncated", "unexpected end")


@contextmanager
def warnings_logged() -> Iterator[None]:
    """Send what libraries warn of while reading a file to the log: a refusal is one sentence, a success is silent.

    Raises
    ------
    DamagedError
        When a warning tells of damage: the values that were read are not those of the file.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    for warning in caught:
        words = str(warning.message)
        if any(sign in words.lower() for sign in _DAMAGE):
            raise DamagedError(words)
        logging.getLogger(__name__).info("%s", words)


def synced(path: Path) -> None:
    """Ask the operating system to put a file's content on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def existing_file(path: str | Path, what: str) -> Path:
    """Return the path of a readable, non-empty file, or refuse."""
    file = Path(path)
    if not file.exists():
        raise InputError(f"{what} {file} does not exist; check the path.")
    if not file.is_file():
        found = "a folder" if file.is_dir() else "no regular file"
        raise InputError(f"{what} {file} is {found}; name a file.")
    if file.stat().st_size == 0:
        raise InputError(f"{what} {file} is empty (0 bytes); get it again from where it came.")
    if not os.access(file, os.R_OK):
        raise InputError(f"{what} {file} may not be read; change its permissions.")
    return file


def first_line(reason: object) -> str:
    """Return the first line of a reason without its full stop, or the kind of fault where there are no words."""
    words = str(reason).strip()
    return words.splitlines()[0].rstrip(".") if words else type(reason).__name__


def unwritable(path: Path, reason: object) -> InputError:
    """Return the refusal of a file that could not be written."""
    words = first_line(reason)
    return InputError(f"{path} could not be written ({words}); free space or choose another place.")

"""Files that are either whole or not there."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from survey.errors import InputError


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; put it in place only when all went well.

    An interrupted writer leaves what stood at `path` before untouched.

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
            synced(draft)
            draft.replace(target)
    except OSError as error:
        raise InputError(
            f"{target} could not be written ({error.strerror or error}); free space or choose another place."
        ) from error


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
        raise InputError(f"{what} {file} is a folder; name a file.")
    if file.stat().st_size == 0:
        raise InputError(f"{what} {file} is empty (0 bytes); get it again from where it came.")
    if not os.access(file, os.R_OK):
        raise InputError(f"{what} {file} may not be read; change its permissions.")
    return file


def unwritable(path: Path, reason: object) -> InputError:
    """Return the refusal of a file that could not be written."""
    words = str(reason).splitlines()[0].rstrip(".") if str(reason) else type(reason).__name__
    return InputError(f"{path} could not be written ({words}); free space or choose another place.")

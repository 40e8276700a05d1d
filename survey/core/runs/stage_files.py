"""Files of the stages of a run: their checksums, their writing to the disk, and the lock of a folder."""

import fcntl
import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from survey.core.errors import InputError
from survey.core.files.writing import synced
from survey.core.runs.manifest import file_sha256

_SYNCED_AT_ONCE = 16


def files_of(folder: Path) -> set[str]:
    """Return the paths of all files of a folder, relative to it."""
    return {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}


def check_files(folder: Path, expected: Mapping[str, str], remedy: str) -> None:
    """Check files of a folder against their checksums.

    Raises
    ------
    InputError
        A file is missing or was changed; `remedy` ends its sentence.
    """
    for name, digest in expected.items():
        file = folder / name
        if not file.is_file() or file_sha256(file) != digest:
            raise InputError(f"{file} is missing or was changed after {remedy}.")


def sync_tree(folder: Path) -> None:
    """Put all files on the disk; many requests at once take a twentieth of the time of one after the other."""
    with ThreadPoolExecutor(_SYNCED_AT_ONCE) as pool:
        for _ in pool.map(synced, folder.rglob("*")):
            pass
    synced(folder)


@contextmanager
def locked(folder: Path, refusal: str) -> Iterator[None]:
    """Lock a folder against other processes; the lock of a killed process is released.

    Raises
    ------
    InputError
        Another process has locked it; `refusal` is the sentence.
    """
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        _lock(descriptor, refusal)
        yield
    finally:
        os.close(descriptor)


def _lock(descriptor: int, refusal: str) -> None:
    """Take the lock of an open folder without waiting."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise InputError(refusal) from error

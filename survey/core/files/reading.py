"""Checked reading of files: existence, kind and size."""

import os
import stat
from pathlib import Path

from survey.core.errors import CapacityError, InputError
from survey.core.files.writing import finish_exchange


def existing_file(path: str | Path, what: str) -> Path:
    """Return the path of a readable, non-empty file, or refuse.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    what : str
        What it is, for the message: "the raster".

    Returns
    -------
    pathlib.Path
        `path`, unchanged.

    Raises
    ------
    InputError
        It is missing, a folder, a pipe or a device, empty, or may not be read.
    """
    file = Path(path)
    try:
        finish_exchange(file)
        found = file.stat() if file.exists() else None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{what} {file} cannot be reached ({reason}); check the path.") from error
    if found is None:
        raise InputError(f"{what} {file} does not exist; check the path.")
    if not stat.S_ISREG(found.st_mode):
        kind = "a folder" if stat.S_ISDIR(found.st_mode) else "no regular file"
        raise InputError(f"{what} {file} is {kind}; name a file.")
    if found.st_size == 0:
        raise InputError(f"{what} {file} is empty (0 bytes); get it again from where it came.")
    if not os.access(file, os.R_OK):
        raise InputError(f"{what} {file} may not be read; change its permissions.")
    return file


def read_bytes(file: Path, what: str, largest_bytes: int | None = None) -> bytes:
    """Read a file that `existing_file` has returned, or refuse.

    Parameters
    ----------
    file : pathlib.Path
        The file.
    what : str
        What it is, for the message.
    largest_bytes : int, optional
        Larger files are refused.

    Returns
    -------
    bytes
        All of its content.

    Raises
    ------
    InputError
        The device fails, or the file is gone.
    CapacityError
        It is larger than `largest_bytes`.
    """
    try:
        n_bytes = file.stat().st_size
        if largest_bytes is not None and n_bytes > largest_bytes:
            raise CapacityError(f"{what} {file} has {n_bytes:,} bytes; {largest_bytes:,} can be read.")
        return file.read_bytes()
    except OSError as error:
        raise InputError(
            f"{what} {file} could not be read ({error.strerror or error}); get it again."
        ) from error

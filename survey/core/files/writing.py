"""Atomic writing of files: drafts, replacement in one step, refusals."""

import contextlib
import errno
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from survey.core.errors import InputError
from survey.core.files.library_messages import first_line

NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of the operating system whose remedy is to free space."""
# What a device or a file system says of a write without naming the file.
_WRITING = (*NO_SPACE, errno.EIO, errno.EROFS)
_LITTLE_SPACE_BYTES = 2**16
_REMOVED = ".removed"


@contextmanager
def replacing(path: str | Path, *, stale: Iterable[Path] = ()) -> Iterator[Path]:
    """Yield a draft file in a folder beside `path`; put it in place when the body ends without an error.

    An interrupted writer leaves what stood at `path` before. A single file is put in place by one
    rename. A format of several files (Shapefile, ASCII grid) cannot be: its files are first
    written to the disk in a folder ``.<name>.exchange`` that appears by one rename, and then moved.
    The next reader or writer of `path` through `existing_file` or this function completes the moves of a
    writer that was killed between them, so that only other programs could meet old and new files side by side.

    Parameters
    ----------
    path : str or pathlib.Path
        The file to write; its folder must exist.
    stale : iterable of pathlib.Path
        Files beside it that belong to what stood there before, and go with it.

    Yields
    ------
    pathlib.Path
        The draft, with the name of `path`. What a writer puts beside it is put in place too.

    Raises
    ------
    InputError
        The folder is missing or may not be written to, or the disk is full. Other errors of the body
        pass through unchanged.
    """
    target = Path(path)
    if not target.parent.is_dir():
        found = "is no folder" if os.path.lexists(target.parent) else "does not exist"
        raise InputError(
            f"the folder {target.parent} {found}; create it or choose another place for {target.name}."
        )
    try:
        folder = Path(tempfile.mkdtemp(prefix=f".{target.stem[:40]}-", dir=target.parent))
    except OSError as error:
        raise write_refusal(target, error) from error
    try:
        yield folder / target.name
        _put_in_place(folder, target, stale)
    except OSError as error:
        if not _of_writing(error, folder, target):
            raise
        raise write_refusal(target, error) from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _of_writing(error: OSError, folder: Path, target: Path) -> bool:
    """Return whether an error comes of writing a draft or of putting it in place."""
    names = [os.fsdecode(name) for name in (error.filename, error.filename2) if isinstance(name, str | bytes)]
    if not names:
        return error.errno in _WRITING
    return any(Path(name) == target or folder in (Path(name), *Path(name).parents) for name in names)


def _put_in_place(folder: Path, target: Path, stale: Iterable[Path]) -> None:
    draft = folder / target.name
    companions = [f for f in folder.iterdir() if f != draft and f.stem.startswith(target.stem)]
    for file in (*companions, draft):
        synced(file)
    written = {file.name for file in companions}
    removed = [file.name for file in stale if file.name not in written and file.name != target.name]
    if not companions and not removed:
        draft.replace(target)
        return
    finish_exchange(target)
    (folder / _REMOVED).write_text("\n".join(removed), encoding="utf-8")
    synced(folder / _REMOVED)
    folder.rename(_exchange_folder(target))
    finish_exchange(target)


def finish_exchange(path: Path) -> None:
    """Complete an exchange that a killed writer had begun: move its files to their place.

    Parameters
    ----------
    path : pathlib.Path
        The main file of the format; nothing is done where no exchange was begun.

    Raises
    ------
    OSError
        The folder may not be written to.
    """
    if not path.name or not (ready := _exchange_folder(path)).is_dir():
        return
    note = ready / _REMOVED
    names = note.read_text(encoding="utf-8").splitlines() if note.is_file() else []
    for name in names:
        if name == Path(name).name and name.startswith(path.stem):
            (path.parent / name).unlink(missing_ok=True)
    for file in sorted(ready.iterdir(), key=lambda file: (file.name == path.name, file.name)):
        # Another process may be completing the same exchange.
        with contextlib.suppress(FileNotFoundError):
            if file.name != _REMOVED and file.stem.startswith(path.stem):
                file.replace(path.parent / file.name)
    shutil.rmtree(ready, ignore_errors=True)


def _exchange_folder(path: Path) -> Path:
    return path.with_name(f".{path.name}.exchange")


def write_refusal(path: Path, error: OSError) -> InputError:
    """Return the refusal of an output that could not be written, with the remedy that its reason asks for.

    Parameters
    ----------
    path : pathlib.Path
        The output.
    error : OSError
        What the operating system said.

    Returns
    -------
    InputError
        Names the output and the reason. Only a full disk, quota or file size limit asks for space.

    Examples
    --------
    >>> print(write_refusal(Path("a.tif"), PermissionError(13, "Permission denied")))
    a.tif could not be written (Permission denied); choose another place.
    """
    remedy = "free space or choose another place" if error.errno in NO_SPACE else "choose another place"
    return InputError(f"{path} could not be written ({error.strerror or error}); {remedy}.")


def synced(path: Path) -> None:
    """Write a file's content from the operating system's cache to the disk.

    Parameters
    ----------
    path : pathlib.Path
        A file or folder.
    """
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def unwritable(path: Path, reason: object) -> InputError:
    """Return the refusal of a file that a library could not write; it asks for space where hardly any is left.

    Parameters
    ----------
    path : pathlib.Path
        The file.
    reason : object
        What the library said.

    Returns
    -------
    InputError
        Names the file and the reason.
    """
    words = first_line(reason)
    full = "space" in words.lower() or (
        path.parent.is_dir() and shutil.disk_usage(path.parent).free < _LITTLE_SPACE_BYTES
    )
    remedy = (
        "free space or choose another place"
        if full
        else "check the space on that disk, or choose another place"
    )
    return InputError(f"{path} could not be written ({words}); {remedy}.")

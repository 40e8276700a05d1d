"""Checked reading and atomic writing of single files.

`existing_file` refuses a file that is missing, empty or not a regular file. `replacing` yields a draft beside the file
and puts it in place by a rename, so an interrupted writer leaves what stood there before; `write_text` and `write_bytes`
are the short forms. `warnings_logged` sends the
warnings of libraries to the log, and raises `DamagedError` for those that report damage.
Folders and groups of files are replaced by `survey.core.replacement`.
"""

import contextlib
import errno
import logging
import os
import shutil
import stat
import sys
import tempfile
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, get_args

from survey.core.errors import CapacityError, InputError

PictureKind = Literal["png", "pdf", "svg"]
"""Formats of pictures that commands draw."""


def picture_files(*names: str) -> tuple[str, ...]:
    """Return the names of files that pictures can have, in every format.

    >>> picture_files("map")
    ('map.png', 'map.pdf', 'map.svg')
    """
    return tuple(f"{name}.{kind}" for name in names for kind in get_args(PictureKind))


def existing_file(path: str | Path, what: str) -> Path:
    """Return the path of a readable, non-empty file, or refuse."""
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
    """Read a file that `existing_file` has returned, or refuse."""
    try:
        n_bytes = file.stat().st_size
        if largest_bytes is not None and n_bytes > largest_bytes:
            raise CapacityError(f"{what} {file} has {n_bytes:,} bytes; {largest_bytes:,} can be read.")
        return file.read_bytes()
    except OSError as error:
        raise InputError(
            f"{what} {file} could not be read ({error.strerror or error}); get it again."
        ) from error


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
        _move_draft(folder, target, stale)
    except OSError as error:
        if not _of_writing(error, folder, target):
            raise
        raise write_refusal(target, error) from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def write_text(path: str | Path, text: str) -> None:
    """Write a text in UTF-8, or leave the file as it was."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: str | Path, content: bytes) -> None:
    """Write the content of a file, or leave the file as it was."""
    with replacing(path) as draft:
        draft.write_bytes(content)


def _of_writing(error: OSError, folder: Path, target: Path) -> bool:
    """Return whether an error comes of writing a draft or of putting it in place."""
    names = [os.fsdecode(name) for name in (error.filename, error.filename2) if isinstance(name, str | bytes)]
    if not names:
        return error.errno in _WRITING
    return any(Path(name) == target or folder in (Path(name), *Path(name).parents) for name in names)


def _move_draft(folder: Path, target: Path, stale: Iterable[Path]) -> None:
    """Put a draft and its companions in place, and remove the files of an older version that are stale."""
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
    """Complete an exchange that a killed writer had begun: move its files to their place."""
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

    >>> print(write_refusal(Path("a.tif"), PermissionError(13, "Permission denied")))
    a.tif could not be written (Permission denied); choose another place.
    """
    remedy = "free space or choose another place" if error.errno in NO_SPACE else "choose another place"
    return InputError(f"{path} could not be written ({error.strerror or error}); {remedy}.")


def synced(path: Path) -> None:
    """Write a file's content from the operating system's cache to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def unwritable(path: Path, reason: object) -> InputError:
    """Return the refusal of a file that a library could not write; it asks for space where hardly any is left."""
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


class DamagedError(ValueError):
    """Values that a library has read from a file in spite of damage."""


# What GDAL warns of and goes on with a value that the file does not hold.
_DAMAGE = ("parsed incompletely", "corrupt", "truncated", "unexpected end")


@contextmanager
def warnings_logged() -> Iterator[None]:
    """Send warnings of libraries that read a file to the log."""
    with warnings.catch_warnings(record=True) as caught, _unraisable_logged():
        warnings.simplefilter("always")
        yield
    for warning in caught:
        words = str(warning.message)
        if any(sign in words.lower() for sign in _DAMAGE):
            raise DamagedError(words)
        logging.getLogger(__name__).info("%s", words)


@contextmanager
def _unraisable_logged() -> Iterator[None]:
    """Send what a library cannot raise, such as a message that is no UTF-8, to the log instead of stderr."""
    before = sys.unraisablehook
    sys.unraisablehook = lambda fault: logging.getLogger(__name__).info("%s", fault.exc_value)
    try:
        yield
    finally:
        sys.unraisablehook = before


def first_line(reason: object) -> str:
    """Return the first line of a reason without its full stop, or the kind of fault where there are no words."""
    words = str(reason).strip()
    return words.splitlines()[0].rstrip(".") if words else type(reason).__name__

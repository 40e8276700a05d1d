"""Atomic replacement of output folders and of groups of output files.

New content is written to a draft beside the output and put in place by renaming, so a failed or killed writer leaves
the old output as it was. Linux exchanges two names in one step by ``renameat2``; where a system cannot, a kill between
two renames leaves the old output beside its place as ``.<name>.old``.
"""

import ctypes
import errno
import fcntl
import os
import shutil
import sys
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from fnmatch import fnmatch
from pathlib import Path

from survey.core.errors import InputError
from survey.core.files import synced, write_refusal


@contextmanager
def replacing_folder(path: str | Path, *, own: Collection[str]) -> Iterator[Path]:
    """Yield an empty draft folder that replaces `path` when the body ends without an error.

    The draft stands beside `path` as ``.<name>.draft``. Old and new folder are exchanged by one
    rename, then the old one is deleted with everything in it. An error in the body passes through
    unchanged, the draft is deleted and `path` stays as it was. A draft that a killed process left
    is deleted by the next call.

    Parameters
    ----------
    path : str or pathlib.Path
        The output folder; its parents are created.
    own : collection of str
        Patterns (`fnmatch`) of the file names that this output consists of, relative to the
        folder, for example ``("dem.tif", "*.png")``. Anything else in the old folder was not
        written by firnline and is never deleted: the call is refused.

    Yields
    ------
    pathlib.Path
        The draft folder.

    Raises
    ------
    InputError
        `path` is a file or the current folder, holds files that do not match `own`, cannot be
        written, the disk is full, or another process is writing it.

    Examples
    --------
    >>> import tempfile
    >>> out = Path(tempfile.mkdtemp()) / "map"
    >>> with replacing_folder(out, own=("*.txt",)) as draft:
    ...     _ = (draft / "a.txt").write_text("a")
    >>> [file.name for file in out.iterdir()]
    ['a.txt']
    """
    target = resolved(path)
    refuse_foreign(target, own)
    draft = target.with_name(f".{target.name}.draft")
    lock = _locked_draft(draft, target)
    try:
        yield draft
        _sync_and_exchange(draft, target)
    finally:
        os.close(lock)
        shutil.rmtree(draft, ignore_errors=True)


def refuse_foreign(folder: Path, own: Collection[str]) -> None:
    """Refuse an output folder that cannot be replaced without deleting the files of others.

    Parameters
    ----------
    folder : pathlib.Path
        The output folder, existing or not.
    own : collection of str
        Patterns of the files that may be deleted, see `replacing_folder`.

    Raises
    ------
    InputError
        `folder` is a file, contains the current folder, or holds a file that matches no pattern.
    """
    place = resolved(folder)
    if place == Path.cwd() or place in Path.cwd().parents:
        raise InputError(f"{folder} contains the current folder and cannot be replaced; name a folder in it.")
    if place.exists() and not place.is_dir():
        raise InputError(f"{folder} is a file, and a folder was expected; choose another name.")
    for file in sorted(place.rglob("*")):
        name = str(file.relative_to(place))
        if not file.is_dir() and not any(fnmatch(name, pattern) for pattern in own):
            raise InputError(
                f"{folder} holds {name!r}, which this command does not write and will not delete; "
                "move that file or choose another folder."
            )


@contextmanager
def replacing_files(*paths: str | Path) -> Iterator[tuple[Path, ...]]:
    """Yield a draft file for each path; put all of them in place when the body ends without an error.

    The first path is the main file, the others describe it (a picture, a table) and stand in the
    same folder. The old companions are removed before the main file is exchanged and the new ones
    follow, so at no time does a companion stand beside a main file that it does not belong to.

    Parameters
    ----------
    *paths : str or pathlib.Path
        The main file and its companions, all in one existing folder.

    Yields
    ------
    tuple of pathlib.Path
        The drafts, in the order of `paths`, with the same names. What a writer leaves beside them
        (``.prj``, ``.aux.xml``) is put in place too. A companion that was not written is left out. A
        companion may be a folder.

    Raises
    ------
    InputError
        The folder is missing or cannot be written, or the disk is full.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> with replacing_files(folder / "route.txt", folder / "route.log") as (route, log):
    ...     _ = route.write_text("north"), log.write_text("1 leg")
    >>> sorted(file.name for file in folder.iterdir())
    ['route.log', 'route.txt']
    """
    main, *companions = [Path(path) for path in paths]
    with _draft_beside(main) as folder:
        yield tuple(folder / Path(path).name for path in paths)
        try:
            _put_in_place(folder, main, companions)
        except OSError as error:
            raise write_refusal(main, error) from error


def refuse_unwritable(path: Path, *, is_folder: bool) -> None:
    """Refuse an output in whose place nothing can be created.

    Parameters
    ----------
    path : pathlib.Path
        The output, existing or not.
    is_folder : bool
        Whether the output is a folder, whose missing parents will be created.

    Raises
    ------
    InputError
        A parent is a file, the folder of a file is missing, or it may not be written to.
    """
    parent = resolved(path).parent
    while is_folder and not os.path.lexists(parent):
        parent = parent.parent
    if not parent.is_dir():
        found = "is a file" if os.path.lexists(parent) else "does not exist"
        raise InputError(
            f"{path} cannot be written: {parent} {found}, and a folder was expected; choose another place."
        )
    try:
        Path(tempfile.mkdtemp(prefix=".firnline-", dir=parent)).rmdir()
    except OSError as error:
        raise write_refusal(path, error) from error


def _locked_draft(draft: Path, target: Path) -> int:
    """Create the empty draft folder and return a descriptor that locks it."""
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if draft.exists():
            os.close(lock_folder(draft, target))
            shutil.rmtree(draft)
        draft.mkdir()
        return lock_folder(draft, target)
    except OSError as error:
        raise write_refusal(target, error) from error


def lock_folder(draft: Path, target: Path) -> int:
    """Lock a draft folder until the descriptor is closed; a process that is killed holds no lock.

    Parameters
    ----------
    draft : pathlib.Path
        The folder.
    target : pathlib.Path
        The output that the draft will replace, for the message.

    Returns
    -------
    int
        A descriptor of the folder.

    Raises
    ------
    InputError
        Another process has locked it.
    OSError
        The folder cannot be opened.
    """
    descriptor = os.open(draft, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(descriptor)
        raise InputError(
            f"another process is writing {target}; wait for it or choose another place."
        ) from error
    return descriptor


def _sync_and_exchange(draft: Path, target: Path) -> None:
    try:
        for file in (*draft.rglob("*"), draft):
            synced(file)
        exchange(draft, target)
        synced(target.parent)
    except OSError as error:
        raise write_refusal(target, error) from error


@contextmanager
def _draft_beside(main: Path) -> Iterator[Path]:
    """Yield a temporary folder beside a file."""
    try:
        folder = Path(tempfile.mkdtemp(prefix=f".{main.stem}-", dir=main.parent))
    except OSError as error:
        raise write_refusal(main, error) from error
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _put_in_place(drafts: Path, main: Path, companions: Collection[Path]) -> None:
    """Remove the old companions, exchange the main file, then add the new companions."""
    written = sorted(drafts.iterdir())
    for file in written:
        synced(file)
    for companion in companions:
        if companion.is_dir():
            companion.replace(drafts / f".{companion.name}.old")
        else:
            companion.unlink(missing_ok=True)
    (drafts / main.name).replace(main)
    for file in written:
        if file.name != main.name:
            exchange(file, main.parent / file.name)
    synced(main.parent)


_AT_FDCWD, _RENAME_EXCHANGE = -100, 2
_NOT_SUPPORTED = (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP)


def exchange(new: Path, old: Path) -> None:
    """Rename `new` to `old`; where `old` exists, it gets the name of `new` in the same step.

    Where the file system cannot exchange two names in one step, `old` is renamed first, so that a
    kill between the two renames leaves it beside its place as ``.<name>.old``.

    Parameters
    ----------
    new, old : pathlib.Path
        Two folders or files of one file system.
    """
    if not old.exists():
        new.replace(old)
        return
    if _exchanged_at_once(new, old):
        return
    spare = old.with_name(f".{old.name}.old")
    old.replace(spare)
    new.replace(old)
    spare.replace(new)


def _exchanged_at_once(new: Path, old: Path) -> bool:
    """Exchange two names by renameat2; return False where the system has no such call."""
    rename = (
        getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None) if sys.platform == "linux" else None
    )
    if rename is None:
        return False
    if rename(_AT_FDCWD, os.fsencode(new), _AT_FDCWD, os.fsencode(old), _RENAME_EXCHANGE) == 0:
        return True
    code = ctypes.get_errno()
    if code in _NOT_SUPPORTED:
        return False
    raise OSError(code, os.strerror(code), str(old))


def resolved(path: str | Path) -> Path:
    """Return the absolute path without symbolic links; links that lead around in a circle stay.

    Parameters
    ----------
    path : str or pathlib.Path
        Existing or not.

    Returns
    -------
    pathlib.Path
        Unlike `pathlib.Path.resolve`, a circle of links raises nothing; opening the path then fails.

    Examples
    --------
    >>> resolved("/usr/../usr").name
    'usr'
    """
    return Path(os.path.realpath(path))

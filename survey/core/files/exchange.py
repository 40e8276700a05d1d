"""Atomic exchange of two paths by the operating system."""

import ctypes
import errno
import os
import sys
from pathlib import Path

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

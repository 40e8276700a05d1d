"""Processes that end without clean-up before a chosen change of the file system, as if they were killed there.

A random kill rarely meets the moment between two renames. Here a child process counts the changes that it makes
(renames, removals, new folders, files opened for writing) and ends before the n-th.
"""

import os
import sys
from collections.abc import Callable, Iterator
from itertools import count
from typing import Any

_CHANGES = frozenset({"os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.truncate", "shutil.rmtree"})
_WRITING = os.O_WRONLY | os.O_RDWR
_ENDED = 9


def kill_points(act: Callable[[], object], prepare: Callable[[], object]) -> Iterator[int]:
    """Prepare, run `act` in a process that ends before its n-th change, and yield n; for every n in turn.

    Parameters
    ----------
    act : callable
        Changes files. It has to succeed when it is not ended.
    prepare : callable
        Restores what stands there before `act`; called in this process.

    Yields
    ------
    int
        Number of changes that were made before the end. The last kill point comes before the last change.
    """
    for n in count():
        prepare()
        if not _is_ended_at(n, act):
            return
        yield n


def _is_ended_at(n: int, act: Callable[[], object]) -> bool:
    """Return whether the process ended before its n-th change; False when it made fewer."""
    child = os.fork()
    if child == 0:
        _count_down(n)
        act()
        os._exit(0)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if code not in (0, _ENDED):
        raise RuntimeError(f"the process ended with the exit code {code}; 0 or {_ENDED} was expected.")
    return code == _ENDED


def _count_down(n: int) -> None:
    left = [n]

    def audit(event: str, arguments: tuple[Any, ...]) -> None:
        left[0] -= _is_change(event, arguments)
        if left[0] < 0:
            os._exit(_ENDED)

    sys.addaudithook(audit)


def _is_change(event: str, arguments: tuple[Any, ...]) -> bool:
    return event in _CHANGES or (event == "open" and bool(arguments[2] & _WRITING))

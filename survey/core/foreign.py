"""Reading of what other programs wrote: the one parser of JSON, and the one guard around libraries that read files.

`parse_json` refuses what two programs would read differently (a key given twice), what would end the interpreter's
recursion, and what is no UTF-8. `refusing_damage` turns whatever a library raises over a file into one sentence: readers
of damaged files fail in many ways, and no list of their exceptions is complete.
"""

import errno
import json
import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from survey.core.errors import CapacityError, FirnlineError, InputError
from survey.core.files import first_line

_MOST_LEVELS = 100
_NO_BRACKETS = bytes(set(range(256)) - set(b"[]{}"))
_TEXTS = re.compile(rb'"(?:[^"\\]|\\.)*"', re.DOTALL)
_LONGEST_REASON = 300  # characters
_LITTLE_BYTES = 2**28  # more than the largest library that is loaded


def parse_json(content: bytes | str, where: str, remedy: str = "get it again") -> Any:
    """Parse JSON in UTF-8, with or without a byte order mark, or refuse it in one sentence.

    Refused are a key given twice in one object, and more than 100 levels: other programs would read one of
    the values, or end. NaN and Infinity are numbers.

    `where`: begins the sentence. `remedy`: ends it.

    >>> parse_json('{"a": [1, 2]}', "the plan a.plan")
    {'a': [1, 2]}
    """
    try:
        text = content.decode("utf-8-sig") if isinstance(content, bytes) else content
        if _levels(text.encode("utf-8", "surrogatepass")) > _MOST_LEVELS:
            raise ValueError(f"nested deeper than {_MOST_LEVELS} levels")
        return json.loads(text, object_pairs_hook=_once)
    except ValueError as error:
        raise InputError(f"{where} is damaged or no JSON ({first_line(error)}); {remedy}.") from error


def _once(members: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object of its members; refuse a key that is given twice."""
    found = dict(members)
    if len(found) < len(members):
        keys = [key for key, _ in members]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"the key {twice[:40]!r} is given twice in one object")
    return found


def _levels(content: bytes) -> int:
    """Return how deep brackets are nested; those inside texts are left out where they would matter."""
    found = _balance(content)
    return found if found <= _MOST_LEVELS else _balance(_TEXTS.sub(b"", content))


def _balance(content: bytes) -> int:
    """Return by how many the brackets that open outnumber those that close, at most."""
    codes = np.frombuffer(content.translate(None, _NO_BRACKETS), np.uint8)
    return int(np.cumsum(np.where((codes == ord("[")) | (codes == ord("{")), 1, -1)).max(initial=0))


def limit_reached(error: BaseException) -> str | None:
    """Return in words which limit of this process a fault comes from, and how to raise it; None for other faults.

    >>> limit_reached(OSError(errno.EMFILE, "Too many open files"))
    'too many files are open; allow more (ulimit -n 4096)'
    """
    at: BaseException | None = error
    while at is not None:
        number = at.errno if isinstance(at, OSError) else None
        if number in (errno.EMFILE, errno.ENFILE):
            return "too many files are open; allow more (ulimit -n 4096)"
        if isinstance(at, MemoryError) or number == errno.ENOMEM or _memory_is_short():
            detail = f" ({first_line(at)})" if str(at) else ""
            return f"the memory does not suffice{detail}; allow more (ulimit -v unlimited)"
        at = at.__cause__ or at.__context__
    return None


def _memory_is_short() -> bool:
    """Return whether this process has used up a limit of its addresses, over which libraries fail in many ways."""
    try:
        import resource  # not on every system

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        pages = int(Path("/proc/self/statm").read_bytes().split()[0])
    except (ImportError, OSError):
        return False
    return limit != resource.RLIM_INFINITY and limit - pages * resource.getpagesize() < _LITTLE_BYTES


@contextmanager
def refusing_damage(where: str, kind: str, remedy: str = "get it again") -> Iterator[None]:
    """Refuse a file over which a library raises anything; refusals pass as they are.

    `where`: begins the sentence. `kind`: what was expected. `remedy`: ends the sentence.

    >>> with refusing_damage("the log a.ulg", "log of PX4"):
    ...     {}["GPS"]
    Traceback (most recent call last):
        ...
    survey.core.errors.InputError: the log a.ulg is damaged or no log of PX4 (it lacks 'GPS'); get it again.
    """
    try:
        yield
    except FirnlineError:
        raise
    except Exception as error:
        raise _refusal(error, where, kind, remedy) from error
    except BaseException as error:
        # Panics of libraries in Rust derive from no Exception and have no name to import.
        if type(error).__name__ != "PanicException":
            raise
        raise _refusal(error, where, kind, remedy) from error


def _refusal(error: BaseException, where: str, kind: str, remedy: str) -> InputError:
    logging.getLogger(__name__).debug("%s", where, exc_info=error)
    limit = limit_reached(error)
    if limit is not None:
        return CapacityError(f"{where} cannot be read: {limit}, or cut or thin it first.")
    words = " ".join(str(error).split())[:_LONGEST_REASON] or type(error).__name__
    reason = f"it lacks {words}" if isinstance(error, KeyError) else first_line(words)
    return InputError(f"{where} is damaged or no {kind} ({reason}); {remedy}.")

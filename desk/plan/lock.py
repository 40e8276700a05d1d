"""Lock of a plan: one desk at a time holds it open, and the next one learns its address."""

import fcntl
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from survey.core import FirnlineError, parse_json
from survey.core.files import write_refusal


class HeldError(FirnlineError):
    """A plan that another desk holds open; its argument is the address of that desk."""


@contextmanager
def held(plan: Path) -> Iterator[Callable[[str], None]]:
    """Hold a plan for one desk; yield what publishes its address to the next one.

    The address stands in a file beside the plan that only its owner reads. A killed desk holds nothing.
    """
    file = plan.with_name(plan.name.removesuffix(".json") + ".lock")
    descriptor = _locked_file(file)

    def publish(address: str) -> None:
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, json.dumps({"pid": os.getpid(), "address": address}).encode(), 0)

    try:
        yield publish
    finally:
        file.unlink(missing_ok=True)
        os.close(descriptor)


def _locked_file(file: Path) -> int:
    """Create and lock a file; refuse one that another process holds."""
    while True:
        try:
            descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o600)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            found = os.pread(descriptor, 10_000, 0)
            os.close(descriptor)
            stated = parse_json(found, str(file)) if found else {}
            raise HeldError(str(stated.get("address", "")) if isinstance(stated, dict) else "") from error
        except OSError as error:
            raise write_refusal(file, error) from error
        with suppress(FileNotFoundError):
            if file.stat().st_ino == os.fstat(descriptor).st_ino:
                return descriptor
        os.close(descriptor)  # the desk before removed it in between

"""Lock of a plan: one desk at a time holds it open, and the next one learns its address."""

import fcntl
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from survey.core.errors import FirnlineError
from survey.core.files import write_refusal

LOCK_SUFFIX = ".desk.lock"


class HeldError(FirnlineError):
    """A plan that another desk holds open, at an address."""

    def __init__(self, plan: Path, address: str) -> None:
        super().__init__(f"the plan {plan} is open already; join it at  {address}")
        self.address = address


@contextmanager
def held(plan: Path) -> Iterator[Callable[[str], None]]:
    """Hold a plan for one desk; yield what publishes its address to the next one.

    The address stands in a file beside the plan that only its owner reads. A killed desk holds nothing.
    """
    file = plan.with_name(plan.name.removesuffix(".desk.json") + LOCK_SUFFIX)
    descriptor = _locked_file(file, plan)

    def publish(address: str) -> None:
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, json.dumps({"pid": os.getpid(), "address": address}).encode(), 0)

    try:
        yield publish
    finally:
        file.unlink(missing_ok=True)
        os.close(descriptor)


def _locked_file(file: Path, plan: Path) -> int:
    """Create and lock a file; refuse one that another process holds."""
    while True:
        try:
            descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o600)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            found = os.pread(descriptor, 10_000, 0)
            os.close(descriptor)
            from survey.core.foreign import parse_json  # loads NumPy, which the first page does not wait for

            stated = parse_json(found, str(file)) if found else {}
            address = stated.get("address", "") if isinstance(stated, dict) else ""
            raise HeldError(plan, str(address)) from error
        except OSError as error:
            raise write_refusal(file, error) from error
        with suppress(FileNotFoundError):
            if file.stat().st_ino == os.fstat(descriptor).st_ino:
                return descriptor
        os.close(descriptor)  # the desk before removed it in between

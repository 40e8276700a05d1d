"""Jobs: computations in a thread of their own, whose events the page follows."""

import logging
import secrets
from collections.abc import Callable
from threading import Lock, Thread
from typing import Any

from survey.core import CapacityError, FirnlineError, InputError, printable

Event = dict[str, Any]
_MOST_JOBS = 40
_MOST_RUNNING = 3


class CancelledError(Exception):
    """The user gave a job up."""


class Job:
    """Computation that reports events until it is done, refused or given up.

    `work`: called with the job; returns the result as plain values.
    """

    def __init__(self, work: Callable[["Job"], dict[str, Any]]) -> None:
        self.name = secrets.token_hex(8)
        self.files: dict[str, Any] = {}
        self._work = work
        self._events: list[Event] = []
        self._lock = Lock()
        self._is_cancelled = False

    @property
    def is_over(self) -> bool:
        """Whether no further event follows."""
        with self._lock:
            return bool(self._events) and self._events[-1]["kind"] in ("done", "refused", "cancelled")

    def start(self) -> None:
        """Begin in a thread of its own."""
        Thread(target=self._run, name=f"desk-job-{self.name}", daemon=True).start()

    def cancel(self) -> None:
        """Give the job up at its next report of progress."""
        self._is_cancelled = True

    def report(self, kind: str, **values: Any) -> None:
        """Add an event."""
        self.require_wanted()
        self._add({"kind": kind, **values})

    def require_wanted(self) -> None:
        """End a job that was given up."""
        if self._is_cancelled:
            raise CancelledError

    def progress(self, what: str, done: int, total: int) -> None:
        """Report progress; the callback of planners and guarantees."""
        self.report("progress", what=what, done=done, total=total)

    def events(self, seen: int = 0) -> list[Event]:
        """Return the events that have come, without the first ones that were seen."""
        with self._lock:
            return self._events[seen:]

    def _run(self) -> None:
        try:
            self._add({"kind": "done", **self._work(self)})
        except CancelledError:
            self._add({"kind": "cancelled"})
        except FirnlineError as error:
            self._add({"kind": "refused", "error": printable(str(error))})
        except Exception as error:
            logging.getLogger("firnline").exception("a job of the desk failed")
            self._add(
                {"kind": "refused", "error": printable(f"internal fault, {type(error).__name__}: {error}.")}
            )

    def _add(self, event: Event) -> None:
        with self._lock:
            self._events.append(event)


class Jobs:
    """Jobs of a desk, the latest ones."""

    def __init__(self) -> None:
        self._jobs: dict[str, Job] = {}

    def start(self, work: Callable[[Job], dict[str, Any]]) -> Job:
        """Start a job."""
        if sum(not job.is_over for job in self._jobs.values()) >= _MOST_RUNNING:
            raise CapacityError(f"{_MOST_RUNNING} computations are running; wait for one, or give it up.")
        job = Job(work)
        self._jobs[job.name] = job
        for name in list(self._jobs)[:-_MOST_JOBS]:
            del self._jobs[name]
        job.start()
        return job

    def find(self, name: str) -> Job:
        """Return a job by its name."""
        job = self._jobs.get(name)
        if job is None:
            raise InputError(f"there is no computation {name[:40]!r}; start it again.")
        return job

    def cancel_all(self) -> None:
        """Give all jobs up."""
        for job in self._jobs.values():
            job.cancel()

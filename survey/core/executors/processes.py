"""Processes of this machine that run pieces of work; dead ones are replaced."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Hashable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from itertools import islice
from typing import Any, TypeVar

from survey.core.errors import InputError

P = TypeVar("P", bound=Hashable)
R = TypeVar("R")

MOST_DEATHS = 8
"""Deaths of workers in a row, without a piece finished, after which the work itself is the cause."""
FAILED_TO_START = 1
"""Exit code of a new process whose imports raise; a process that is killed has a negative one."""
UNGUARDED = (
    "failed to start; new processes import the script that starts them: "
    'put its calls under `if __name__ == "__main__":`.'
)


class Processes:
    """Processes of this machine that run pieces of one function after another; dead ones are replaced.

    Parameters
    ----------
    workers : int
        Number of processes; they start with the first piece.
    """

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._pool: ProcessPoolExecutor | None = None

    def __call__(self, work: Callable[[P], R], pieces: Sequence[P]) -> Iterator[tuple[P, R]]:
        """Run pieces, and yield each with its result as it is done."""
        left = dict.fromkeys(pieces)
        deaths = 0
        while left:
            try:
                for piece, result in _as_completed(self._submit, work, list(left), 2 * self._workers):
                    del left[piece]
                    deaths = 0
                    yield piece, result
            except BrokenProcessPool as error:
                failed_to_start = self._failed_to_start()
                self._kill()
                self.close()
                deaths += 1
                if failed_to_start:
                    raise InputError(f"the workers {UNGUARDED}") from error
                if deaths >= MOST_DEATHS:
                    raise InputError(
                        f"workers died {deaths} times in a row and finished nothing; they may lack memory, take fewer workers."
                    ) from error

    def _submit(self, work: Callable[[P], R], piece: P) -> "Future[R]":
        if self._pool is None:
            if _imports_the_script():
                raise InputError(f"the workers {UNGUARDED}")
            self._pool = ProcessPoolExecutor(self._workers, multiprocessing.get_context("spawn"), settled)
        future = self._pool.submit(work, piece)
        self._notice_new_process(self._pool)
        return future

    @staticmethod
    def _notice_new_process(pool: ProcessPoolExecutor) -> None:
        """Wake the pool's manager: `submit` does so before it starts a process, whose death could then pass unseen."""
        with pool._shutdown_lock:
            if pool._executor_manager_thread_wakeup is not None:
                pool._executor_manager_thread_wakeup.wakeup()

    def _failed_to_start(self) -> bool:
        """Return whether a process of a broken pool raised an exception before it took a piece."""
        processes = [] if self._pool is None else list(self._pool._processes.values())
        return any(process.exitcode == FAILED_TO_START for process in processes)

    def _kill(self) -> None:
        """Kill the processes of a broken pool: it waits for those that started while it broke, which wait for ever."""
        if self._pool is not None:
            for process in list(self._pool._processes.values()):
                with suppress(ProcessLookupError):
                    process.kill()

    def close(self) -> None:
        """End the processes when they have finished the pieces that run."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
        self._pool = None


def _as_completed(
    submit: Callable[[Callable[[P], R], P], "Future[R]"], work: Callable[[P], R], pieces: list[P], ahead: int
) -> Iterator[tuple[P, R]]:
    """Keep a few pieces submitted ahead, so that memory does not grow with their number."""
    rest = iter(pieces)
    running = {submit(work, piece): piece for piece in islice(rest, ahead)}
    try:
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                piece = running.pop(future)
                result = future.result()
                running |= {submit(work, following): following for following in islice(rest, 1)}
                yield piece, result
    finally:
        for future in running:
            future.cancel()


def _imports_the_script() -> bool:
    """Return whether this is a new process that imports its parent's script.

    A pool would fail there only after it made semaphores, and leave them behind when the process is terminated.
    """
    return getattr(multiprocessing.current_process(), "_inheriting", False)


def settled() -> None:
    """Let a worker ignore interrupts, and end when its parent process has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_follow, args=(parent,), daemon=True).start()


def _follow(parent: Any) -> None:
    parent.join()
    os._exit(1)

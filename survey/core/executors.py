"""Execution of independent pieces of work: in this process, in local processes, or on a dask cluster.

`run_all` and `open_workers` choose the engine. An engine yields results as they are done, in any order, each with its
piece. Local processes that die are replaced, and their pieces are done again; a dask cluster is one that a scheduler
names, or one on this machine. A piece may be done twice when a worker dies; the result is the same.
"""

import asyncio
import logging
import multiprocessing
import os
import signal
import socket
import threading
from collections.abc import Callable, Hashable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager, suppress
from functools import partial
from itertools import islice
from typing import Any, Literal, TypeVar
from urllib.parse import urlparse

from survey.core.errors import ConfigError, InputError

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


_REACH_S = 5.0
"""Seconds within which a scheduler must answer."""
_LONGEST_GREETING = 100_000
"""Bytes with which a scheduler may greet; it takes some hundred."""


@contextmanager
def dask_client(workers: int, scheduler: str | None) -> Iterator[Any]:
    """Yield a client of a scheduler, or of a cluster of this machine that ends with the block."""
    try:
        import dask
        import distributed
    except ImportError as error:
        raise ConfigError("dask.distributed is not installed; install firnline[cluster].") from error
    dask_of: Any = distributed  # carries no types
    if scheduler is not None:
        _require_answer(scheduler)
        with _connection_errors_refused(scheduler):
            client = dask_of.Client(scheduler, timeout=_REACH_S, set_as_default=False)
        try:
            yield client
        finally:
            with suppress(OSError, asyncio.CancelledError, CancelledError):
                client.close()
        return
    settings = {
        "distributed.scheduler.allowed-failures": 1000,
        "distributed.worker.daemon": True,
        # dask has its workers give memory back after every array, which takes longer than the arithmetic.
        "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
    }
    with (
        dask.config.set(settings),
        dask_of.LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster,
        dask_of.Client(cluster, set_as_default=False) as client,
    ):
        yield client


def run_on_dask(client: Any, work: Callable[[P], R], pieces: Sequence[P]) -> Iterator[tuple[P, R]]:
    """Run every piece on the workers of a dask client; a piece whose worker died is run again."""
    address = client.scheduler.address
    with _connection_errors_refused(address):
        yield from _completed_on_dask(client, work, pieces, address)


def _completed_on_dask(
    client: Any, work: Callable[[P], R], pieces: Sequence[P], address: str
) -> Iterator[tuple[P, R]]:
    """Keep some pieces submitted ahead, and yield each with its result as it is done."""
    import distributed

    rest = iter(pieces)
    ahead = 2 * max(sum(client.nthreads().values()), 4)
    running = {_submitted(client, work, piece): piece for piece in islice(rest, ahead)}
    deaths = 0
    completed: Any = distributed.as_completed  # carries no types
    finished = completed(running, loop=client.loop)
    for future in finished:
        piece = running.pop(future)
        if client.status != "running":
            raise _lost_scheduler(address)
        if _died_with_its_worker(future):
            deaths += 1
            if deaths >= MOST_DEATHS:
                raise InputError(
                    f"the cluster's workers died {deaths} times in a row and finished nothing; look into their logs."
                )
            again = _submitted(client, work, piece)
            running[again] = piece
            finished.add(again)
            continue
        deaths = 0
        result = future.result()
        for following in islice(rest, 1):
            fresh = _submitted(client, work, following)
            running[fresh] = following
            finished.add(fresh)
        yield piece, result


def _lost_scheduler(address: str) -> InputError:
    return InputError(
        f"the dask scheduler at {address} stopped answering; start it again and run the same command, "
        "which continues from what is stored."
    )


@contextmanager
def _connection_errors_refused(address: str) -> Iterator[None]:
    """Turn errors of a connection that broke off into one sentence that names the scheduler."""
    # The client logs the same error with its traceback, from a thread that may end later.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL + 1)
    try:
        yield
    except (OSError, asyncio.CancelledError, CancelledError) as error:
        raise _lost_scheduler(address) from error


def _submitted(client: Any, work: Callable[[P], R], piece: P) -> Any:
    return client.submit(work, piece, pure=False, retries=0)


def _died_with_its_worker(future: Any) -> bool:
    from distributed.scheduler import KilledWorker

    return future.status == "cancelled" or (
        future.status == "error" and isinstance(future.exception(), KilledWorker)
    )


def _require_answer(scheduler: str) -> None:
    """Refuse at once when nobody listens, instead of waiting for dask to give up."""
    address = urlparse(scheduler)
    try:
        host, port = address.hostname, address.port
    except ValueError:
        host, port = None, None
    if not host or not port:
        raise ConfigError(f"{scheduler!r} is no scheduler's address; give tcp://host:port.")
    try:
        with socket.create_connection((host, port), timeout=_REACH_S) as listener:
            # A scheduler speaks first, and the length of what it says comes first; with TLS it waits to be spoken to.
            greeting = listener.recv(8, socket.MSG_WAITALL) if address.scheme == "tcp" else bytes(8)
    except OSError as error:
        raise InputError(
            f"no dask scheduler answers at {scheduler} ({error.strerror or error}); start one there, or leave --scheduler out."
        ) from error
    if len(greeting) < 8 or int.from_bytes(greeting, "little") > _LONGEST_GREETING:
        raise InputError(
            f"what answers at {scheduler} is no dask scheduler; start one there, or leave --scheduler out."
        )


Engine = Literal["serial", "processes", "dask"]


def run_all(
    work: Callable[[P], R],
    pieces: Sequence[P],
    *,
    engine: Engine = "processes",
    workers: int | None = None,
    scheduler: str | None = None,
) -> Iterator[tuple[P, R]]:
    """Run every piece, and yield it with its result as soon as it is done.

    Parameters
    ----------
    work : callable
        A function of a module, or a `functools.partial` of one, so that workers can be sent it.
    pieces : sequence
        Arguments of `work`, one call each.
    engine : {"serial", "processes", "dask"}
        In this process; in new processes of this machine; or through dask.distributed.
    workers : int, optional
        Number of processes; as many as this process may use cores. A scheduler has its own.
    scheduler : str, optional
        Address of a dask scheduler, ``tcp://host:port``; without one, engine dask starts a cluster here.

    Raises
    ------
    ConfigError
        dask is asked for and not installed; a number of workers below 1.
    InputError
        The scheduler does not answer or stops answering; workers die again and again without finishing anything.
    """
    with open_workers(engine, workers, scheduler) as run:
        yield from run(work, pieces)


@contextmanager
def open_workers(
    engine: Engine, workers: int | None = None, scheduler: str | None = None
) -> Iterator[Callable[..., Iterator[tuple[Any, Any]]]]:
    """Yield a function that runs pieces like `run_all`; its workers stay until the block ends.

    Parameters
    ----------
    engine, workers, scheduler
        See `run_all`.

    Yields
    ------
    callable
        Takes a function and its pieces, and yields each piece with its result.

    Raises
    ------
    ConfigError, InputError
        See `run_all`.
    """
    n = workers if workers is not None else len(os.sched_getaffinity(0))
    if n < 1:
        raise ConfigError(f"{n} workers were asked for; at least 1 is needed.")
    if engine == "serial":
        yield _serially
    elif engine == "processes":
        with closing(Processes(n)) as processes:
            yield processes
    else:
        with dask_client(n, scheduler) as client:
            yield partial(run_on_dask, client)


def _serially(work: Callable[[P], R], pieces: Sequence[P]) -> Iterator[tuple[P, R]]:
    return ((piece, work(piece)) for piece in pieces)

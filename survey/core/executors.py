"""Execution of independent pieces of work: in this process, in local processes, or on a dask cluster.

An engine yields results as they are done, in any order, each with its piece. A piece may be done twice when a
worker dies; the result is the same.
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
from contextlib import contextmanager
from itertools import islice
from typing import Any, Literal, TypeVar
from urllib.parse import urlparse

from survey.core.errors import ConfigError, InputError

Engine = Literal["serial", "processes", "dask"]
P = TypeVar("P", bound=Hashable)
R = TypeVar("R")

_PATIENCE = 8
"""Deaths of workers in a row, without a piece finished, after which the work itself is to blame."""
_REACH_S = 5.0
"""Seconds within which a scheduler must answer."""
_LONGEST_GREETING = 100_000
"""Bytes with which a scheduler may greet; it takes some hundred."""


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
    n = workers if workers is not None else len(os.sched_getaffinity(0))
    if n < 1:
        raise ConfigError(f"{n} workers were asked for; at least 1 is needed.")
    if engine == "serial":
        yield from ((piece, work(piece)) for piece in pieces)
    elif engine == "processes":
        yield from _in_processes(work, pieces, n)
    else:
        yield from _by_dask(work, pieces, n, scheduler)


def _in_processes(work: Callable[[P], R], pieces: Sequence[P], workers: int) -> Iterator[tuple[P, R]]:
    left = dict.fromkeys(pieces)
    deaths = 0
    while left:
        n = min(workers, len(left))
        with ProcessPoolExecutor(n, multiprocessing.get_context("spawn"), settled) as pool:
            try:
                for piece, result in _as_completed(pool.submit, work, list(left), 2 * n):
                    del left[piece]
                    deaths = 0
                    yield piece, result
            except BrokenProcessPool as error:
                deaths += 1
                if deaths >= _PATIENCE:
                    raise InputError(
                        f"workers died {deaths} times in a row and finished nothing; they may lack memory, take fewer workers."
                    ) from error
            finally:
                pool.shutdown(wait=False, cancel_futures=True)


def _as_completed(
    submit: Callable[[Callable[[P], R], P], "Future[R]"], work: Callable[[P], R], pieces: list[P], ahead: int
) -> Iterator[tuple[P, R]]:
    """Keep a few pieces submitted ahead, so that memory does not grow with their number."""
    rest = iter(pieces)
    running = {submit(work, piece): piece for piece in islice(rest, ahead)}
    while running:
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            piece = running.pop(future)
            result = future.result()
            running |= {submit(work, following): following for following in islice(rest, 1)}
            yield piece, result


def settled() -> None:
    """Let a worker ignore interrupts, and end when its parent process has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_follow, args=(parent,), daemon=True).start()


def _follow(parent: Any) -> None:
    parent.join()
    os._exit(1)


def _by_dask(
    work: Callable[[P], R], pieces: Sequence[P], workers: int, scheduler: str | None
) -> Iterator[tuple[P, R]]:
    try:
        import dask
        import distributed
    except ImportError as error:
        raise ConfigError("dask.distributed is not installed; install firnline[cluster].") from error
    dask_of: Any = distributed  # carries no types
    if scheduler is not None:
        _require_answer(scheduler)
        with (
            _connection_errors_refused(scheduler),
            dask_of.Client(scheduler, timeout=_REACH_S, set_as_default=False) as client,
        ):
            yield from run_on_dask(client, work, pieces)
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
        yield from run_on_dask(client, work, pieces)


def run_on_dask(client: Any, work: Callable[[P], R], pieces: Sequence[P]) -> Iterator[tuple[P, R]]:
    """Run every piece on the workers of a dask client; a piece whose worker died is run again."""
    import distributed

    address = client.scheduler.address
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
            if deaths >= _PATIENCE:
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

"""Workers of a dask cluster: one that a scheduler names, or one on this machine."""

import asyncio
import logging
import socket
from collections.abc import Callable, Hashable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from itertools import islice
from typing import Any, TypeVar
from urllib.parse import urlparse

from survey.core.errors import ConfigError, InputError
from survey.core.executors.processes import MOST_DEATHS

P = TypeVar("P", bound=Hashable)
R = TypeVar("R")

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
        yield from _as_completed(client, work, pieces, address)


def _as_completed(
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

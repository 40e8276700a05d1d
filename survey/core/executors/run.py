"""Choice of the engine that runs pieces of work."""

import os
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from typing import Any, Literal, TypeVar

from survey.core.errors import ConfigError
from survey.core.executors.dask_cluster import dask_client, run_on_dask
from survey.core.executors.processes import Processes

Engine = Literal["serial", "processes", "dask"]
P = TypeVar("P", bound=Hashable)
R = TypeVar("R")


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

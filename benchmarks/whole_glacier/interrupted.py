"""Maps in tiles that are made by two workers, or whose workers, command or scheduler are killed."""

import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.report import Row
from benchmarks.whole_glacier.kills import (
    command_killed,
    dask_cluster,
    digest,
    free_address,
    scheduler_killed,
    workers_killed,
)
from benchmarks.whole_glacier.made_survey import MadeSurvey
from benchmarks.whole_glacier.mapping import command, used_by

_SEED = 103
_N_KILLS = 10
_SMALL_TILES = ("--set", "tiles.tile_cells=200", "--set", "tiles.n_draws=8")


def second_worker(folder: Path, density: float) -> Iterator[Row]:
    """Yield the gain by a second worker on 3·10⁷ points in eight tiles; nothing else may run on the machine."""
    made = MadeSurvey(_SEED, 4000.0, 2000.0, density)
    files = made.write(folder / "workers")
    seconds = []
    for n in (1, 2):
        began = time.perf_counter()
        used_by(command(files, folder / f"workers_{n}", "--workers", str(n)))
        seconds.append(time.perf_counter() - began)
    yield Row("time with one worker", seconds[0], "s")
    yield Row.of("time with one worker over that with two", seconds[0] / seconds[1], "", ">=", 1.8)
    same = digest(folder / "workers_1") == digest(folder / "workers_2")
    yield Row.of("same bytes with one worker and two", float(same), "", ">=", 1.0)


def killed_runs(folder: Path) -> Iterator[Row]:
    """Yield whether maps whose workers, or whose command, were killed ten times have the same bytes."""
    files = MadeSurvey(_SEED, 900.0, 600.0).write(folder / "kills")
    used_by(command(files, folder / "quiet", "--workers", "1", *_SMALL_TILES))
    quiet = digest(folder / "quiet")
    for kill, what in ((workers_killed, "workers"), (command_killed, "command")):
        out = folder / what
        n = kill(command(files, out, "--workers", "2", *_SMALL_TILES), out, _N_KILLS)
        yield Row.of(f"kills of the {what}", float(n), "", ">=", float(_N_KILLS))
        yield Row.of(f"same bytes after kills of the {what}", float(digest(out) == quiet), "", ">=", 1.0)


def lost_scheduler(folder: Path) -> Iterator[Row]:
    """Yield whether a map whose dask scheduler was killed has the same bytes."""
    files = MadeSurvey(_SEED, 600.0, 400.0).write(folder / "scheduler")
    used_by(command(files, folder / "quiet", "--workers", "1", *_SMALL_TILES))
    out, address = folder / "map", free_address()
    arguments = command(files, out, "--scheduler", address, *_SMALL_TILES)
    code = scheduler_killed(arguments, out, address, 4)
    yield Row.of("exit code after the scheduler was killed", float(code), "", ">=", 3.0)
    with dask_cluster(address, 2):
        used_by(arguments)
    same = digest(out) == digest(folder / "quiet")
    yield Row.of("same bytes after the scheduler was killed", float(same), "", ">=", 1.0)

"""Maps of surveys that do not fit the memory.

points ──▶ tiles on disk ──▶ cells of each strip ──▶ errors of strips, long relief ──▶ fine relief of each tile
       ──▶ mosaics, coverage map, record

Every stage consists of pieces that are stored one by one, so that a killed run goes on to the same bytes.
"""

import fcntl
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from survey.core import FloatArray, InputError, Progress
from survey.reconstruction.tiled.cells import present_tiles, sort_piece, sorted_points
from survey.reconstruction.tiled.global_parameters import (
    ReliefHyperparameters,
    Run,
    learn,
    read_global,
    solve_global,
)
from survey.reconstruction.tiled.job import TiledJob, begin
from survey.reconstruction.tiled.layout import MapTile
from survey.reconstruction.tiled.summaries import summarise
from survey.reconstruction.tiled.tile_map import TiledResult, map_tile, write_results


def map_in_tiles(job: TiledJob, run: Run, progress: Progress = lambda *_: None) -> TiledResult:
    """Map a survey tile by tile, or go on with a map that was broken off."""
    begin(job)
    with _locked(job):
        sort = partial(sort_piece, job.layout, job.sorted_folder)
        counts = _run_all(run, sort, job.pieces, "points sorted", progress)
        tiles = present_tiles(job.sorted_folder, list(job.pieces), job.layout)
        by_size = _largest_first(job, tiles)
        _run_all(run, partial(summarise, job), by_size, "tiles averaged", progress)
        with threadpool_limits(limits=1, user_api="blas"):
            shared = solve_global(job, tiles)
            learnt = learn(job, shared, tiles, run)
        _run_all(run, partial(_map_tile, job, learnt), by_size, "tiles mapped", progress)
        result = write_results(job, tiles, shared, learnt, sum(counts.values()))
    shutil.rmtree(job.work)
    return result


def _largest_first(job: TiledJob, tiles: Sequence[MapTile]) -> list[MapTile]:
    """Return the tiles by falling number of points, so that no worker begins a large one last."""
    n_bytes = {
        tile: sum(f.stat().st_size for f in sorted_points(job.sorted_folder, list(job.pieces), tile))
        for tile in tiles
    }
    return sorted(tiles, key=lambda tile: -n_bytes[tile])


def _map_tile(job: TiledJob, learnt: ReliefHyperparameters, tile: MapTile) -> int:
    """Map a tile in a worker, which reads what all tiles share itself."""
    return map_tile(job, read_global(job), learnt, tile)


def _run_all(
    run: Run, work: Callable[[Any], int], pieces: Sequence[Any], what: str, progress: Progress
) -> dict[Any, int]:
    """Run all pieces and report how many are done; return the number that each gave."""
    found: dict[Any, int] = {}
    progress(what, 0, len(pieces))
    for piece, n in run(work, pieces):
        found[piece] = n
        progress(what, len(found), len(pieces))
    return found


@contextmanager
def _locked(job: TiledJob) -> Iterator[None]:
    """Hold the folder for one run."""
    with (job.work / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise InputError(
                f"another run is at work in {job.folder}; wait for it, or choose another folder."
            ) from error
        yield


def prior_on_nodes(job: TiledJob, heights: FloatArray) -> None:
    """Store a prior's heights at the nodes of the long relief (H, W) [m], the first row the southern one."""
    job.work.mkdir(parents=True, exist_ok=True)
    np.save(job.prior_file, heights)

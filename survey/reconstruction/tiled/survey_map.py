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

from survey.core.arrays import FloatArray, Progress
from survey.core.errors import InputError
from survey.reconstruction.tiled.cells.sorting import present_tiles, sort_piece
from survey.reconstruction.tiled.job import TiledJob
from survey.reconstruction.tiled.layout import MapTile
from survey.reconstruction.tiled.relief.learning import Run, learn
from survey.reconstruction.tiled.relief.shared import Learnt, read_shared, solve_shared
from survey.reconstruction.tiled.relief.tile_map import map_tile
from survey.reconstruction.tiled.request import begin
from survey.reconstruction.tiled.results import TiledResult, write_results
from survey.reconstruction.tiled.summaries import summarise


def map_in_tiles(job: TiledJob, run: Run, progress: Progress = lambda *_: None) -> TiledResult:
    """Map a survey tile by tile, or go on with a map that was broken off.

    Parameters
    ----------
    job : TiledJob
        From `survey.reconstruction.tiled.request.tiled_job`.
    run : callable
        Runs a function on pieces, in any order, such as `survey.core.executors.run_all` with its engine.
    progress : callable
        Progress callback: what is being done, how many of it are done, and how many there are.

    Returns
    -------
    TiledResult
        Record and test; the map is in the job's folder.

    Raises
    ------
    InputError
        The folder holds another map or another run works there, files are damaged, or no point lies in the map.
    CapacityError
        The disk is too full, or the survey has more strips than can be solved together.
    """
    begin(job)
    with _held(job):
        sort = partial(sort_piece, job.layout, job.sorted_folder)
        counts = _counted(run, sort, job.pieces, "points sorted", progress)
        tiles = present_tiles(job.sorted_folder, list(job.pieces), job.layout)
        _counted(run, partial(summarise, job), tiles, "tiles averaged", progress)
        with threadpool_limits(limits=1, user_api="blas"):
            shared = solve_shared(job, tiles)
            learnt = learn(job, shared, tiles, run)
        _counted(run, partial(_map_tile, job, learnt), tiles, "tiles mapped", progress)
        result = write_results(job, tiles, shared, learnt, sum(counts.values()))
    shutil.rmtree(job.work)
    return result


def _map_tile(job: TiledJob, learnt: Learnt, tile: MapTile) -> int:
    """Map a tile in a worker, which reads what all tiles share itself."""
    return map_tile(job, read_shared(job), learnt, tile)


def _counted(
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
def _held(job: TiledJob) -> Iterator[None]:
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

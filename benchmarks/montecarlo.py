"""Monte Carlo: a full Fig. 10 against trial by trial with scikit-learn, workers, dask, and memory against trials.

``python -m benchmarks.montecarlo [--quick] [--json FILE]``

The figure is 100 random DEMs × 1 to 10 swaths × 2 patterns with a perfect sensor and a Gaussian process fitted
to every survey. scikit-learn fits and maps a stated subset of the same surveys, one by one, with its own
optimizer, from one start; both use the same families (here the squared exponential) and the ratio is per survey of the same
sizes, in CPU time of one process. Wall times are of this machine as it was; CPU times stand beside them.
"""

import resource
import shutil
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.report import Row, cpu_seconds, main
from sim.montecarlo.config import RandomKind, SearchedMap, StudyConfig, TrialBlock, blocks_of
from sim.montecarlo.study import run_study
from sim.montecarlo.trials import TrialTerrains, routes, samples_of, survey_block
from survey.core.arrays import FloatArray
from survey.core.executors import Engine, run_all

SWATHS = tuple(range(1, 11))


def study(
    trials: int,
    swaths: tuple[int, ...] = SWATHS,
    families: tuple[str, ...] | None = None,
    side_m: float = 600.0,
) -> StudyConfig:
    """Return the paper's study."""
    how = SearchedMap() if families is None else SearchedMap(families=families)  # type: ignore[arg-type]
    return StudyConfig(
        schema_version=1,
        name="fig10",
        seed=1001,
        trials=trials,
        terrains=(RandomKind(name="smooth", family="squared-exponential", size_m=side_m),),
        planners=({"pattern": "lawnmower"}, {"pattern": "piecewise-continuous"}),
        swaths=swaths,
        maps=(how,),
    )


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    survey_block(study(2, (1, 2)), TrialBlock(0, 0, 2))  # compiles, and fills caches
    yield from _full_figure()
    yield from _against_sklearn(n_dems=2 if quick else 5)
    yield from _workers(quick)
    yield from _memory((100, 400) if quick else (1000, 10_000))


def _full_figure() -> Iterator[Row]:
    place = Path(tempfile.mkdtemp())
    start = time.perf_counter()
    run_study(study(100), place / "fig10", engine="processes", workers=2)
    wall = time.perf_counter() - start
    yield Row.of("Fig. 10, 2 workers: wall, start of workers and page included", wall, "s", "<=", 10.0)
    shutil.rmtree(place)


def _against_sklearn(n_dems: int) -> Iterator[Row]:
    """Compare on the lawnmower and the steered pattern of 2, 4 and 6 swaths; ours surveys 50 DEMs, as it always does."""
    wanted = study(50, (2, 4, 6), ("squared-exponential",))
    (block,) = blocks_of(wanted)
    ours, ours_s = cpu_seconds(lambda: survey_block(wanted, block))
    theirs, theirs_s = cpu_seconds(lambda: _by_sklearn(wanted, block._replace(n=n_dems)))
    per_ours, per_theirs = ours_s / len(ours), theirs_s / len(theirs)
    where = f"{n_dems} DEMs × 2 patterns × 2, 4, 6 swaths"
    yield Row(f"scikit-learn, {where}: per survey", per_theirs, "s")
    yield Row("ours, 50 DEMs × 2 patterns × 2, 4, 6 swaths: per survey", per_ours, "s")
    yield Row.of("scikit-learn / ours", per_theirs / per_ours, "x", ">=", 50.0)
    same = {(t.planner, t.swaths, t.trial): t.rmse_m for t in ours}
    for pattern in ("lawnmower", "piecewise-continuous"):
        pairs = [(same[key], rmse) for key, rmse in theirs.items() if key[0] == pattern]
        our_mean, their_mean = np.mean(pairs, axis=0)
        yield Row(f"{pattern}: mean error, ours", float(our_mean), "m")
        yield Row(f"{pattern}: mean error, scikit-learn", float(their_mean), "m")


def _by_sklearn(wanted: StudyConfig, block: TrialBlock) -> dict[tuple[str, int, int], float]:
    """Return the error of each survey of a block, fitted and mapped by scikit-learn."""
    world = TrialTerrains(wanted, block)
    errors = {}
    for design in wanted.designs:
        for driven in routes(world, design):
            xy, heights = samples_of(world, driven)
            for column, index in enumerate(driven.mine):
                mapped = _sklearn_map(xy, heights[:, column], world.nodes.xy)
                error = float(np.sqrt(np.mean((mapped - world.actual[:, index]) ** 2)))
                errors[design.label, design.swaths, world.trials[index]] = error
    return errors


def _sklearn_map(xy: FloatArray, heights: FloatArray, nodes: FloatArray) -> FloatArray:
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel

    kernel = ConstantKernel(25.0, (1e-1, 1e4)) * RBF(100.0, (15.0, 1500.0))
    process = GaussianProcessRegressor(kernel, alpha=1e-7, normalize_y=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of optima at a bound
        fitted = process.fit(xy, heights - heights.mean())
    mapped: FloatArray = fitted.predict(nodes) + heights.mean()
    return mapped


def _workers(quick: bool) -> Iterator[Row]:
    """Trials per second of the same blocks by each engine, after its workers have started."""
    n_blocks = 4 if quick else 8
    wanted = study(50 * n_blocks, (2, 4))
    rates = {}
    engines: tuple[tuple[str, Engine, int], ...] = (
        ("1 process", "processes", 1),
        ("2 processes", "processes", 2),
        ("dask, 2 workers", "dask", 2),
    )
    for name, engine, workers in engines:
        rates[name] = _rate(wanted, engine, workers)
        yield Row(f"{name}: trials per second (2 patterns × 2 and 4 swaths each)", rates[name], "1/s")
    efficiency = rates["2 processes"] / rates["1 process"] / 2.0
    yield Row.of("efficiency of 2 processes", efficiency, "", ">=", 0.85)


def _rate(wanted: StudyConfig, engine: Engine, workers: int) -> float:
    """Count from the moment the first block of every worker is there, so that starting does not count."""
    from functools import partial

    n_done, start = 0, 0.0
    for index, (block, _) in enumerate(
        run_all(partial(survey_block, wanted), blocks_of(wanted), engine=engine, workers=workers)
    ):
        if index == workers - 1:
            start = time.perf_counter()
        elif index >= workers:
            n_done += block.n
    return n_done / (time.perf_counter() - start)


def _memory(sizes: tuple[int, int]) -> Iterator[Row]:
    """Peak memory of worker and table together, in processes of their own, against the number of trials."""
    peaks = []
    for n in sizes:
        peak = dict(run_all(_peak_mb, [n], engine="processes", workers=1))[n]
        peaks.append(peak)
        yield Row(f"{n} trials in one process, table and all: peak memory", peak, "MB")
    yield Row.of(f"memory of {sizes[1]} trials over that of {sizes[0]}", peaks[1] / peaks[0], "x", "<=", 1.1)


def _peak_mb(trials: int) -> float:
    """Survey a small site so many times, here, and return the peak memory [MB]."""
    place = Path(tempfile.mkdtemp())
    wanted = study(trials, (2,), side_m=600.0)
    wanted = wanted.model_copy(update={"planners": ({"pattern": "lawnmower"},)})
    with threadpool_limits(1):
        run_study(wanted, place / "s", engine="serial")
    shutil.rmtree(place)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


if __name__ == "__main__":
    main("Monte Carlo", measure, ("numpy", "scipy", "scikit-learn", "distributed", "pyarrow"))

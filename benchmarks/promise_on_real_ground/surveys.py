"""Surveys of the windows: promised beforehand or adaptive, and the lawnmower that needs the fewest swaths."""

import json
import os
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import TypeVar

import numpy as np

import planners
from benchmarks.promise_on_real_ground.windows import SEED, Site, site_of
from planners.guarantee.adaptive import AdaptiveConfig, survey_adaptively
from planners.guarantee.guarantee import guarantee, posterior_of
from planners.guarantee.requirement import MapRequirement
from planners.prediction.places import places
from planners.swaths.heading import across_marked_grain
from survey import SurfacePoints
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.reconstruction import reconstruct
from survey.reconstruction.gp.kernel_search import ALL, KernelSearch, map_surveys

STEP_M = 10.0
SHARED_M = 0.05
"""Standard deviation of the error that all samples of a survey share [m]."""
MOST_ORACLE = 20
NOISES_M = (0.05, 0.1, 0.2, 0.3)
FOLDER = Path(
    os.environ.get("FIRNLINE_REAL_PROMISE", Path(tempfile.gettempdir()) / "firnline-promise-on-real-ground")
)
"""Where finished parts are stored; a run that was ended goes on from them."""

T = TypeVar("T")


@dataclass(frozen=True)
class Task:
    """One survey: which window, how it is planned, and the probability that is asked for."""

    landscape: str
    index: int
    kind: str
    probability: float

    @property
    def noise_m(self) -> float:
        """Standard deviation of a sample [m], by the window."""
        return NOISES_M[self.index % len(NOISES_M)]


@dataclass(frozen=True)
class Outcome:
    """Whether the class was promised, the predicted and the actual error [m], and what was driven."""

    promised: bool
    predicted_m: float
    rmse_m: float
    length_m: float
    n_swaths: int


@dataclass(frozen=True)
class Oracle:
    """Swaths and length [m] of the shortest lawnmower that truly passes; infinite where none of those tried does."""

    n_swaths: float
    length_m: float


def stored(name: str, work: Callable[[], T], read: Callable[[dict[str, object]], T]) -> T:
    """Return a part that an earlier run has finished, or make and store it."""
    file = FOLDER / f"{name}.json"
    if file.exists():
        return read(json.loads(file.read_text(encoding="utf-8")))
    made = work()
    FOLDER.mkdir(parents=True, exist_ok=True)
    draft = file.with_suffix(".part")
    draft.write_text(json.dumps(asdict(made)), encoding="utf-8")  # type: ignore[call-overload]
    draft.replace(file)
    return made


def outcome_of(task: Task) -> Outcome:
    """Return the outcome of one survey, stored under its name."""
    name = f"{task.landscape}-{task.index}-{task.kind}-{task.probability:g}".replace(" ", "_")
    return stored(name, lambda: _surveyed(task), lambda record: Outcome(**record))  # type: ignore[arg-type]


def oracle_of(task: Task) -> Oracle:
    """Return the shortest lawnmower that truly passes on the window of a task."""
    name = f"{task.landscape}-{task.index}-oracle".replace(" ", "_")
    return stored(name, lambda: _oracle(task), lambda record: Oracle(**record))  # type: ignore[arg-type]


def _surveyed(task: Task) -> Outcome:
    """Make one survey and judge its map."""
    site = site_of(task.landscape, task.index)
    return _adaptive(site, task) if task.kind == "adaptive" else _beforehand(site, task)


def requirement_of(site: Site, task: Task) -> MapRequirement:
    """Return what the map of a task has to meet."""
    return MapRequirement(
        site.limit_m,
        task.probability,
        noise_m=task.noise_m,
        shared_m=SHARED_M,
        sample_step_m=STEP_M,
        prior_sigma_m=site.prior_sigma_m,
        n_simulations=24,
    )


def _beforehand(site: Site, task: Task) -> Outcome:
    made = guarantee(site.area, site.prior, requirement_of(site, task))
    xy = places(made.route, STEP_M)
    error_m = prior_map_error_m(site, xy, measured(site, task, xy, "beforehand"), task.noise_m)
    return Outcome(
        made.holds, made.predicted.rmse_m, error_m, made.route.length_m, int(made.config.swaths or 0)
    )


def _adaptive(site: Site, task: Task) -> Outcome:
    heights: list[FloatArray] = []
    wanted = requirement_of(site, task)

    def drive(xy: FloatArray) -> FloatArray:
        heights.append(measured(site, task, xy, "adaptive", len(heights)))
        return heights[-1]

    config = AdaptiveConfig.of(wanted, across_marked_grain(site.area.free, site.prior))
    made = survey_adaptively(site.area, posterior_of(site.area, site.prior, wanted), config, drive)
    if made.route is None:
        return Outcome(False, made.predicted.rmse_m, np.inf, np.inf, 0)
    error_m = map_error_m(site, made.samples, np.concatenate(heights), task.noise_m)
    return Outcome(made.holds, made.predicted.rmse_m, error_m, made.route.length_m, len(made.route.swaths))


def measured(site: Site, task: Task, xy: FloatArray, *names: str | int) -> FloatArray:
    """Return the heights (N,) that a survey measures at places (N, 2) [m]."""
    shared = stream(SEED, "shared", task.landscape, task.index, names[0], str(task.probability))
    rng = stream(SEED, "noise", task.landscape, task.index, *names, str(task.probability))
    heights: FloatArray = (
        site.terrain.at(xy)
        + task.noise_m * rng.standard_normal(len(xy))
        + SHARED_M * shared.standard_normal()
    )
    return heights


def map_error_m(site: Site, xy: FloatArray, heights: FloatArray, noise_m: float) -> float:
    """Return the root mean square error of the Gaussian process fitted to a survey [m]."""
    found = KernelSearch(xy, heights[:, None], noise_m, ALL, most=100).search()
    mean, _ = map_surveys(xy, heights[:, None], found, site.nodes)
    return float(np.sqrt(np.mean(np.square(mean[:, 0] - site.terrain.at(site.nodes)))))


def prior_map_error_m(site: Site, xy: FloatArray, heights: FloatArray, noise_m: float) -> float:
    """Return the root mean square error of the map that `reconstruct` makes of a survey and the prior [m]."""
    points = SurfacePoints(np.column_stack([xy, heights]), sigma_m=noise_m, crs=site.area.crs)
    error = reconstruct(points, site.grid, site.prior).mean.elevation - site.terrain.at(site.nodes).reshape(
        site.grid.shape
    )
    return float(np.sqrt(np.mean(np.square(error))))


def _oracle(task: Task) -> Oracle:
    """Try lawnmowers of more and more swaths until one truly passes."""
    site = site_of(task.landscape, task.index)
    for n in range(2, MOST_ORACLE + 1):
        route = planners.plan(site.area, None, planners.LawnmowerConfig(swaths=n))
        xy = places(route, STEP_M)
        if prior_map_error_m(site, xy, measured(site, task, xy, "oracle", n), task.noise_m) <= site.limit_m:
            return Oracle(n, route.length_m)
    return Oracle(float("inf"), float("inf"))


@cache
def _sorted(tasks: tuple[Task, ...]) -> tuple[Task, ...]:
    return tuple(sorted(tasks, key=lambda task: (task.index, task.landscape)))


def in_even_parts(tasks: Iterable[Task]) -> tuple[Task, ...]:
    """Return tasks in an order in which every landscape is begun at once."""
    return _sorted(tuple(tasks))

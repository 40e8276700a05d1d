"""Guarantees: how often they hold, how accurate the predicted errors are, and how far the rover drives.

``python -m benchmarks.promise [--quick] [--json FILE]``

Terrain of five families with 0.1 and 0.3 m of noise. A prior of 75 m cells that err by 1 m is known beforehand.
``adaptive`` surveys refit while they drive and stop by themselves; ``beforehand`` plans are fixed before the first
sample, for ground of an unknown class; ``surface`` ones for snow on smooth terrain and moraine on rough, ``assumed``
ones for the family of covariances that it is. The oracle is the lawnmower of fewest swaths that truly passed; it knows
the terrain, and maps it the same way. The terrain judged on here was used for no setting; its families were. Real
ground is judged by ``python -m benchmarks.promise_on_real_ground``.

Surveys are stored as they finish (FIRNLINE_PROMISE_SURVEYS, a file of JSON lines); a run that was ended goes on where it
was. FIRNLINE_PROMISE_N is the number of DEMs of each family and noise, 16 when left out; half of them are also surveyed
as promised beforehand.
"""

import json
import os
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

import planners
from benchmarks.equal_error import FAMILIES, Family
from benchmarks.report import Row, main
from planners.guarantee.adaptive import AdaptiveConfig, survey_adaptively
from planners.guarantee.guarantee import guarantee
from planners.guarantee.requirement import MapRequirement
from planners.prediction.assumptions import Surface
from planners.prediction.kernel_posterior import PriorBlocks, posterior_from_prior
from planners.prediction.places import places
from planners.swaths.heading import across_marked_grain
from survey import Dem, Grid, Route, SurfacePoints, SurveyArea
from survey.core.arrays import FloatArray
from survey.core.executors import run_all
from survey.core.streams import stream
from survey.reconstruction import reconstruct
from survey.reconstruction.gp.families import SearchedFamily
from survey.reconstruction.gp.kernel_search import KernelSearch, map_surveys
from survey.terrain import random_dem, satellite_copy

JUDGED_SEED = 27_182
ASSUMED: dict[str, SearchedFamily] = {
    "Matérn 3/2, 200 m": "matern-3/2",
    "diamond-square": "whittle",
}
"""Families of covariance of the terrain; of what is not named here, the squared exponential."""
CLASS_3_M = 0.4572
STEP_M = 10.0
MOST_ORACLE = 24
N_SIMULATIONS = 60
N_DEMS = int(os.environ.get("FIRNLINE_PROMISE_N", "16"))
N_WORKERS = int(os.environ.get("FIRNLINE_PROMISE_WORKERS", "2"))
STORED = Path(
    os.environ.get("FIRNLINE_PROMISE_SURVEYS", Path(tempfile.gettempdir()) / "firnline-promise.jsonl")
)


@dataclass(frozen=True)
class Site:
    """Terrain with the area on it, its prior, and the nodes where maps are judged."""

    terrain: Dem
    prior: Dem
    area: SurveyArea

    @property
    def grid(self) -> Grid:
        """Nodes where maps are judged."""
        xmin, ymin, _, _ = self.area.bounds
        return Grid((xmin + 10.0, ymin + 10.0, xmin + 590.0, ymin + 590.0), 20.0, self.area.crs)

    @property
    def nodes(self) -> FloatArray:
        """Places (M, 2) where maps are judged [m]."""
        return self.grid.xy


@dataclass(frozen=True)
class Outcome:
    """One survey: whether it was guaranteed, the predicted and the actual error [m], and the oracle's distance [m]."""

    promised: bool
    predicted_error_m: float
    rmse_m: float
    length_m: float
    oracle_m: float
    n_swaths: int


@dataclass(frozen=True)
class Task:
    """A survey to make: of which family, on which of its terrains, with which noise."""

    family: str
    index: int
    noise_m: float
    kind: str


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows of every family and noise."""
    n, n_before = (4, 2) if quick else (N_DEMS, max(N_DEMS // 2, 1))
    families = [FAMILIES[0], FAMILIES[4]] if quick else FAMILIES
    noises = (0.1,) if quick else (0.1, 0.3)
    counts = {(family.name, "adaptive"): n for family in families}
    counts |= {
        (family.name, kind): n_before for family in families for kind in ("beforehand", "surface", "assumed")
    }
    # A run that is ended early has the same share of each.
    tasks = sorted(
        (
            Task(family, i, noise_m, kind)
            for (family, kind), count in counts.items()
            for noise_m in noises
            for i in range(count)
        ),
        key=lambda task: (task.index + 1) / counts[task.family, task.kind],
    )
    made = surveyed(tasks, None if quick else STORED)
    for cell, outcomes in _cells(made).items():
        where = f"{cell.family}, noise {cell.noise_m:g} m, {cell.kind}"
        is_smooth = any(family.name == cell.family and family.is_smooth for family in FAMILIES)
        yield Row(f"{where}: surveys", len(outcomes), "")
        yield from _rows(where, outcomes, is_smooth)
    for kind in ("adaptive", "beforehand", "surface", "assumed"):
        every = [one for task, one in made.items() if task.kind == kind]
        yield Row.of(f"all random terrain, {kind}: guarantees that held", kept(every), "", ">=", 0.95)
        yield Row(f"all random terrain, {kind}: refused", 1.0 - _share_promised(every), "")
    smooth = {family.name for family in FAMILIES if family.is_smooth}
    stated = [one for task, one in made.items() if task.kind == "surface" and task.family in smooth]
    yield Row.of("smooth terrain, surface: distance / oracle", _price(stated), "x", "<=", 1.8)


def surveyed(tasks: Sequence[Task], file: Path | None) -> dict[Task, Outcome]:
    """Make those surveys that the file does not hold, each stored there once it is done."""
    known = _read(file) if file is not None and file.exists() else {}
    missing = [task for task in tasks if task not in known]
    for task, made in run_all(outcome, missing, engine="processes", workers=N_WORKERS):
        known[task] = made
        if file is not None:
            record = {"seed": JUDGED_SEED, "task": asdict(task), "outcome": asdict(made)}
            with file.open("a", encoding="utf-8") as lines:
                lines.write(json.dumps(record) + "\n")
    return {task: known[task] for task in tasks}


def _read(file: Path) -> dict[Task, Outcome]:
    """Read the surveys of this seed that were made before."""
    lines = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    return {Task(**line["task"]): Outcome(**line["outcome"]) for line in lines if line["seed"] == JUDGED_SEED}


def _cells(made: dict[Task, Outcome]) -> dict[Task, list[Outcome]]:
    """Gather the surveys of one family, noise and kind, named by their first."""
    cells: dict[Task, list[Outcome]] = {}
    for task, one in made.items():
        cells.setdefault(replace(task, index=0), []).append(one)
    return cells


def _share_promised(outcomes: Sequence[Outcome]) -> float:
    return float(np.mean([one.promised for one in outcomes]))


def kept(outcomes: Sequence[Outcome]) -> float:
    """Return the share of guarantees that held; 1 where all were refused."""
    errors = [one.rmse_m for one in outcomes if one.promised]
    return float(np.mean(np.array(errors) <= CLASS_3_M)) if errors else 1.0


def _rows(where: str, outcomes: Sequence[Outcome], is_smooth: bool) -> Iterator[Row]:
    made = [one for one in outcomes if one.promised]
    yield Row(f"{where}: refused", 1.0 - _share_promised(outcomes), "")
    yield Row.of(f"{where}: guarantees that held", kept(outcomes), "", ">=", 0.9)
    if not made:
        return
    ratio = float(np.mean([one.predicted_error_m for one in made]) / np.mean([one.rmse_m for one in made]))
    # Within 25 % either way: the larger over the smaller.
    yield Row(f"{where}: predicted / actual mean error", ratio, "x", "0.75 to 1.25", 0.75 <= ratio <= 1.25)
    yield Row(
        f"{where}: 95th percentile of the error", float(np.percentile([o.rmse_m for o in made], 95.0)), "m"
    )
    distance = _price(made)
    name = f"{where}: distance / oracle"
    if "adaptive" in where:
        yield Row.of(name, distance, "x", "<=", 1.0 if is_smooth else 1.2)
    else:
        yield Row(name, distance, "x")


def _price(outcomes: Sequence[Outcome]) -> float:
    """Return the distance of the guaranteed surveys over that of the oracle; NaN where it never passes."""
    known = [one for one in outcomes if one.promised and np.isfinite(one.oracle_m)]
    if not known:
        return float("nan")
    return float(np.mean([one.length_m for one in known]) / np.mean([one.oracle_m for one in known]))


def outcome(task: Task) -> Outcome:
    """Make one survey and judge it."""
    with threadpool_limits(1):
        site = site_of(task)
        return _adaptive(site, task) if task.kind == "adaptive" else _beforehand(site, task)


def _adaptive(site: Site, task: Task) -> Outcome:
    posterior = posterior_from_prior(PriorBlocks.of(site.area, site.prior), noise_m=task.noise_m)
    measured: list[FloatArray] = []

    def drive(xy: FloatArray) -> FloatArray:
        measured.append(heights_at(site, xy, task, len(measured)))
        return measured[-1]

    config = AdaptiveConfig(
        limit_m=CLASS_3_M,
        noise_m=task.noise_m,
        sample_step_m=STEP_M,
        heading_deg=across_marked_grain(site.area.free, site.prior),
    )
    survey = survey_adaptively(site.area, posterior, config, drive)
    if survey.route is None:
        return Outcome(False, survey.predicted.rmse_m, np.nan, np.nan, np.nan, 0)
    error = map_error(site, survey.samples, np.concatenate(measured), task.noise_m)
    length_m, n = survey.route.length_m, len(survey.route.swaths)
    return Outcome(survey.holds, survey.predicted.rmse_m, error, length_m, oracle_m(site, task), n)


def _beforehand(site: Site, task: Task) -> Outcome:
    wanted = MapRequirement(
        CLASS_3_M,
        noise_m=task.noise_m,
        sample_step_m=STEP_M,
        n_simulations=N_SIMULATIONS,
        assumed=ASSUMED.get(task.family, "squared-exponential") if task.kind == "assumed" else None,
        surface=_surface_of(task),
    )
    made = guarantee(site.area, site.prior, wanted)
    xy = places(made.route, STEP_M)
    error = prior_map_error(site, xy, heights_at(site, xy, task, 0), task.noise_m)
    length_m, n = made.route.length_m, len(made.route.swaths)
    return Outcome(made.holds, made.predicted.rmse_m, error, length_m, oracle_m(site, task), n)


def _surface_of(task: Task) -> Surface:
    """Return the class of surface that is stated: snow on smooth terrain, moraine on rough."""
    if task.kind != "surface":
        return "unknown"
    return "moraine" if task.family in ASSUMED else "snow"


def oracle_m(site: Site, task: Task) -> float:
    """Return the distance of the lawnmower of fewest swaths that truly passes; NaN when none of those tried does."""
    for n in range(2, MOST_ORACLE + 1):
        route = lawnmower(site.area.bounds, str(site.area.crs.to_epsg()), n)
        xy = places(route, STEP_M)
        if prior_map_error(site, xy, heights_at(site, xy, task, n, "oracle"), task.noise_m) <= CLASS_3_M:
            return route.length_m
    return float("nan")


@cache
def lawnmower(bounds: tuple[float, float, float, float], epsg: str, n: int) -> Route:
    """Return the paper's lawnmower of n swaths."""
    area = SurveyArea.rectangle(bounds, f"EPSG:{epsg}")
    return planners.plan(area, None, planners.LawnmowerConfig(swaths=n))


def heights_at(site: Site, xy: FloatArray, task: Task, *names: str | int) -> FloatArray:
    """Return what the rover measures at places."""
    rng = stream(JUDGED_SEED, "noise", task.family, task.index, str(task.noise_m), task.kind, *names)
    heights: FloatArray = site.terrain.at(xy) + task.noise_m * rng.standard_normal(len(xy))
    return heights


def map_error(site: Site, xy: FloatArray, heights: FloatArray, noise_m: float) -> float:
    """Return the root mean square error of the Gaussian process fitted to a survey [m]."""
    columns = heights[:, None]
    mean, _ = map_surveys(xy, columns, KernelSearch(xy, columns, noise_m).search(), site.nodes)
    return float(np.sqrt(np.mean((mean[:, 0] - site.terrain.at(site.nodes)) ** 2)))


def prior_map_error(site: Site, xy: FloatArray, heights: FloatArray, noise_m: float) -> float:
    """Return the root mean square error of the map that `reconstruct` makes of a survey and the prior [m]."""
    points = SurfacePoints(np.column_stack([xy, heights]), sigma_m=noise_m, crs=site.area.crs)
    made = reconstruct(points, site.grid, site.prior)
    return float(np.sqrt(np.mean((made.mean.elevation.ravel() - site.terrain.at(site.nodes)) ** 2)))


def site_of(task: Task) -> Site:
    """Return the site of a task."""
    family = next(f for f in FAMILIES if f.name == task.family)
    terrain = _drawn(family, task.index)
    area = SurveyArea.rectangle(terrain.grid().bounds, terrain.crs)
    prior = satellite_copy(terrain, rng=stream(JUDGED_SEED, "satellite", family.name, task.index))
    return Site(terrain, prior, area)


def _drawn(family: Family, index: int) -> Dem:
    grid = Grid((0.0, 0.0, 600.0, 600.0), 5.0)
    rng = stream(JUDGED_SEED, "terrain", family.name, index)
    return random_dem(family.generator, grid, rng, 25.0, **dict(family.parameters))


if __name__ == "__main__":
    main("Promise", measure, ("numpy", "scipy"))

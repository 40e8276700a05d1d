"""Monte Carlo trials: draw terrain, survey it by every planner at every size, map it and score the map.

Terrains are random surfaces, or surfaces that agree with a coarse prior. Trials come in blocks, because surveys of one
route share the factorization of their maps. The bytes of a block depend on the study and the block alone.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from pyproj import CRS
from threadpoolctl import threadpool_limits

import planners
import survey
from planners.prediction.places import places
from planners.registry import planner_of, steering_of
from sim.montecarlo.config import (
    ConditionalKind,
    Design,
    GivenMap,
    Map,
    RandomKind,
    ReconstructedMap,
    SearchedMap,
    StudyConfig,
    Trial,
    TrialBlock,
)
from sim.simulate.simulation import mission_of_drive, simulate_statistical
from sim.simulate.steering import AttitudeErrors, drive_steered
from sim.world.site import erroneous_copy
from survey import Dem, Grid, InputError, Route, SurveyArea
from survey.core import FloatArray, stream
from survey.data.path_error import PathError
from survey.reconstruction.gp.kernel_search import Cell, FoundKernel, KernelSearch, map_surveys
from survey.reconstruction.mapping import map_landmarks
from survey.terrain.random_fields import CoarseCells, ConditionalTerrain
from survey.terrain.synthetic import ice_micro_relief, random_dem
from vision_slam import localize

_WITH_LENGTH = ("squared-exponential", "matern-3/2", "matern-5/2")
_CRS = CRS("EPSG:32608")


class TrialTerrains:
    """The terrains of a block, and what every survey of them needs."""

    def __init__(self, study: StudyConfig, block: TrialBlock) -> None:
        self.study = study
        self.kind = study.terrains[block.terrain]
        self.trials = range(block.first, block.first + block.n)
        self.dems = [generate_terrain(study, self.kind, trial) for trial in self.trials]
        self.area = SurveyArea.rectangle(self.dems[0].grid().bounds, self.dems[0].crs)
        self.nodes = map_nodes(self.area, study.map_step_m)
        self.actual = np.column_stack([dem.at(self.nodes.xy) for dem in self.dems])

    def stream(self, what: str, trial: int, *names: str | int) -> np.random.Generator:
        """Return the stream of one trial."""
        return stream(self.study.seed, what, self.kind.name, trial, *names)

    def prior(self, index: int) -> Dem:
        """Return the satellite's cells of one terrain."""
        satellite = self.study.satellite
        trial = self.trials[index]
        rng, errors_rng = self.stream("satellite", trial), self.stream("satellite errors", trial)
        return erroneous_copy(self.dems[index], satellite, rng, errors_rng)


def map_nodes(area: SurveyArea, step_m: float) -> Grid:
    """Return the centres of square cells over a rectangle, where maps are judged."""
    xmin, ymin, xmax, ymax = area.bounds
    columns, rows = (int(side / step_m + 1e-9) for side in (xmax - xmin, ymax - ymin))
    if min(columns, rows) < 2:
        raise InputError(f"nodes {step_m:g} m apart do not fit the site; set map_step_m smaller.")
    x0, y0 = xmin + 0.5 * step_m, ymin + 0.5 * step_m
    return Grid((x0, y0, x0 + (columns - 1) * step_m, y0 + (rows - 1) * step_m), step_m, area.crs)


def generate_terrain(study: StudyConfig, kind: RandomKind | ConditionalKind, trial: int) -> Dem:
    """Return the terrain of one trial."""
    rng = stream(study.seed, "terrain", kind.name, trial)
    if isinstance(kind, ConditionalKind):
        return _conditional(study, kind).draw(rng)
    grid = Grid((0.0, 0.0, kind.size_m, kind.size_m), kind.step_m, _CRS)
    scale = {"length_scale_m": kind.length_scale_m} if kind.family in _WITH_LENGTH else {}
    dem = random_dem(kind.family, grid, rng, relief_m=kind.relief_m, **scale)
    if kind.micro_relief_sd_m == 0.0:
        return dem
    relief = ice_micro_relief(
        grid, stream(study.seed, "micro-relief", kind.name, trial), sd_m=kind.micro_relief_sd_m
    )
    return Dem.on(grid, dem.elevation + relief)


def _conditional(study: StudyConfig, kind: ConditionalKind) -> ConditionalTerrain:
    return _conditional_on(str(study.path(kind.file)), kind.sigma_m, kind.step_m)


@lru_cache(maxsize=4)
def _conditional_on(file: str, sigma_m: float, step_m: float) -> ConditionalTerrain:
    """Learn the covariance from the prior's cells; the terrain ends at the centres of the outer ones."""
    prior = Dem.read(file)
    xmin, ymin, xmax, ymax = prior.grid().bounds
    columns, rows = (int(side / step_m + 1e-9) for side in (xmax - xmin, ymax - ymin))
    grid = Grid((xmin, ymin, xmin + columns * step_m, ymin + rows * step_m), step_m, prior.crs)
    area = SurveyArea.rectangle(prior.bounds, prior.crs)
    return ConditionalTerrain(CoarseCells(prior, sigma_m), planners.terrain_kernel(prior, area), grid)


def survey_block(study: StudyConfig, block: TrialBlock) -> list[Trial]:
    """Run the trials of one block, on one thread so that the order of sums does not change."""
    with threadpool_limits(1):
        world = TrialTerrains(study, block)
        survey_all = _surveyed_ideally if study.fidelity == "ideal" else _surveyed_statistically
        return [
            trial
            for design in study.designs
            for driven in routes(world, design)
            for trial in survey_all(world, driven)
        ]


class Driven(NamedTuple):
    """A route of a design, and the terrains of the block that it is driven on."""

    design: Design
    route: Route
    mine: Sequence[int]


def _surveyed_ideally(world: TrialTerrains, driven: Driven) -> Iterator[Trial]:
    xy, heights = samples_of(world, driven)
    for how in world.study.maps:
        yield from _judged(world, driven, how, _maps(world, how, xy, heights, driven.mine))


def routes(world: TrialTerrains, design: Design) -> list[Driven]:
    """Return the routes of a design: one for all terrains where it depends on none."""
    everyone = range(len(world.dems))
    if planner_of(design.planner).needs_kernel(design.planner):
        return [Driven(design, _planned(world, design, index), [index]) for index in everyone]
    route = _planned(world, design, None)
    steering = steering_of(design.planner)
    if steering is None:
        return [Driven(design, route, everyone)]
    trials = [(trial, design.label, design.swaths) for trial in world.trials]
    sensed = [world.stream("sensed attitude", *trial) for trial in trials]
    errors = AttitudeErrors(world.study.sensors, world.study.rover.speed_m_s, sensed)
    rngs = [world.stream("steering", *trial) for trial in trials]
    driven = drive_steered(world.area, route, steering, world.dems, rngs=rngs, errors=errors)
    return [Driven(design, route, [index]) for index, route in enumerate(driven)]


def _planned(world: TrialTerrains, design: Design, index: int | None) -> Route:
    prior = None if index is None else world.prior(index)
    samples = world.study.samples
    return planners.plan(
        world.area, prior, design.planner, noise_m=samples.noise_m, sample_step_m=samples.step_m
    )


def samples_of(world: TrialTerrains, driven: Driven) -> tuple[FloatArray, FloatArray]:
    """Return the estimated sample positions (N, 2) and the measured heights (N, B) [m]."""
    samples = world.study.samples
    xy = places(driven.route, samples.step_m)
    heights = np.empty((len(xy), len(driven.mine)))
    for column, index in enumerate(driven.mine):
        rng = world.stream("samples", world.trials[index], driven.design.label, driven.design.swaths)
        there = xy
        if samples.localization_m > 0.0:
            xmin, ymin, xmax, ymax = world.area.bounds
            there = np.clip(
                xy + samples.localization_m * rng.standard_normal(xy.shape), (xmin, ymin), (xmax, ymax)
            )
        heights[:, column] = world.dems[index].at(there) + samples.noise_m * rng.standard_normal(len(xy))
    return xy, heights


class _Mapped(NamedTuple):
    """Maps (M, B), what each claims to err (B,), the kernels behind them, and the number of samples of each."""

    mean: FloatArray
    claimed_m: FloatArray
    kernels: Sequence[tuple[str, float, float]]
    n_samples: int


def _maps(
    world: TrialTerrains, how: Map, xy: FloatArray, heights: FloatArray, mine: Sequence[int]
) -> _Mapped:
    if isinstance(how, ReconstructedMap):
        return _reconstructed(world, how, xy, heights, mine)
    if isinstance(how, SearchedMap):
        found = KernelSearch(xy, heights, _noise_m(world.study), how.families).search()
    else:
        found = [_given(how, world.study)] * len(mine)
    mean, claimed = map_surveys(xy, heights, found, world.nodes.xy)
    kernels = [(k.cell.family, k.cell.length_scale_m, float(np.sqrt(k.variance_m2))) for k in found]
    return _Mapped(mean, claimed, kernels, len(xy))


def _noise_m(study: StudyConfig) -> float:
    """Return the error of a sample that its sensor states; what localization adds shows in the fit."""
    return study.samples.noise_m


def _given(how: GivenMap, study: StudyConfig) -> FoundKernel:
    return FoundKernel(
        Cell.of(how.family, how.length_scale_m, _noise_m(study) ** 2 / how.variance_m2), how.variance_m2
    )


def _reconstructed(
    world: TrialTerrains, how: ReconstructedMap, xy: FloatArray, heights: FloatArray, mine: Sequence[int]
) -> _Mapped:
    noise = max(_noise_m(world.study), 1e-3)
    mean, claimed, kernels = np.empty((len(world.nodes.xy), len(mine))), np.empty(len(mine)), []
    for column, index in enumerate(mine):
        points = survey.SurfacePoints(
            np.column_stack([xy, heights[:, column]]), sigma_m=np.full(len(xy), noise), crs=world.area.crs
        )
        prior = world.prior(index) if how.use_prior else None
        mapped = map_landmarks(points, world.nodes, how.settings, prior=prior)
        mean[:, column], claimed[column], kernel = _facts_of(mapped.reconstruction)
        kernels.append(kernel)
    return _Mapped(mean, claimed, kernels, len(xy))


def _facts_of(result: survey.Reconstruction) -> tuple[FloatArray, float, tuple[str, float, float]]:
    """Return the heights of a map, its stated RMSE, and its kernel."""
    facts: Mapping[str, Any] = result.hyperparameters
    kernel = (
        str(facts.get("family", result.method)),
        float(facts.get("length_scale_m", np.nan)),
        float(np.sqrt(facts.get("variance_m2", np.nan))),
    )
    std = result.std.elevation
    claimed = float(np.sqrt(np.nanmean(std**2))) if np.isfinite(std).any() else float("nan")
    return result.mean.elevation.ravel(), claimed, kernel


def _judged(world: TrialTerrains, driven: Driven, how: Map, maps: _Mapped) -> Iterator[Trial]:
    design = driven.design
    for column, index in enumerate(driven.mine):
        error = maps.mean[:, column] - world.actual[:, index]
        known = error[np.isfinite(error)]
        if not len(known):
            raise InputError(
                f"the map {how.name} of {design.label} has no height at any node; ask for more swaths."
            )
        size = np.abs(known)
        family, length_scale_m, sd_m = maps.kernels[column]
        yield Trial(
            world.kind.name, world.trials[index], design.label, design.swaths, how.name,
            driven.route.length_m, maps.n_samples, float(np.sqrt(np.mean(known**2))), float(known.mean()),
            float(np.percentile(size, 95.0)), float(size.max()), float(maps.claimed_m[column]),
            1.0 - len(known) / len(error), family, length_scale_m, sd_m,
        )  # fmt: skip


def _surveyed_statistically(world: TrialTerrains, driven: Driven) -> Iterator[Trial]:
    """Drive with sensors that err, estimate path and landmarks from what was sensed, and map those."""
    for index in driven.mine:
        trajectory, points = _localized(world, driven, index)
        for how in world.study.maps:
            if not isinstance(how, ReconstructedMap):
                raise InputError(
                    "landmarks are mapped by a reconstruction method; searched and given kernels need the ideal fidelity."
                )
            maps = _mapped_landmarks(world, how, trajectory.error, points, index)
            yield from _judged(world, driven._replace(mine=[index]), how, maps)


def _mapped_landmarks(
    world: TrialTerrains,
    how: ReconstructedMap,
    path: PathError | None,
    points: survey.SurfacePoints,
    index: int,
) -> _Mapped:
    """Map landmarks as a mission does."""
    prior = world.prior(index) if how.use_prior else None
    mapped = map_landmarks(points, world.nodes, how.settings, prior=prior, path=path)
    mean, claimed, kernel = _facts_of(mapped.reconstruction)
    return _Mapped(mean[:, None], np.array([claimed]), [kernel], mapped.n_points)


def _localized(
    world: TrialTerrains, driven: Driven, index: int
) -> tuple[survey.Trajectory, survey.SurfacePoints]:
    """Return the path and the landmarks that one survey with sensors that err estimates."""
    design = driven.design
    seed = int(world.stream("sensors", world.trials[index], design.label, design.swaths).integers(2**62))
    study = world.study
    mission = mission_of_drive(
        seed=seed, rover=study.rover, sensors=study.sensors, localization=study.localization
    )
    recording, _ = simulate_statistical(world.dems[index], driven.route, mission)
    result = localize(recording, mission.assumed)
    return result.trajectory, result.points

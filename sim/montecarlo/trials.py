"""Monte Carlo trials: draw terrain, survey it by every planner at every size, map it and score the map.

Trials come in blocks, because surveys of one route share the factorization of their maps; a block is what
one worker does at a time and what is stored. Its bytes depend on the study and the block alone.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

import planners
import survey
from planners.prediction.error_model import places
from sim.config.mission import MissionConfig
from sim.config.terrain import RandomTerrain
from sim.montecarlo.blocks import Trial, TrialBlock
from sim.montecarlo.config import Design, StudyConfig
from sim.montecarlo.map_config import GivenMap, Map, ReconstructedMap, SearchedMap
from sim.montecarlo.terrains import TrialTerrains
from sim.simulate.sensed_attitude import sensed_attitudes
from sim.simulate.statistical import simulate_statistical
from survey import Route
from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.path_error import PathError
from survey.reconstruction.gp.kernel_search import Cell, FoundKernel, KernelSearch, mapped
from survey.reconstruction.policy import map_landmarks
from vision_slam import localize


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
    if planners.planner_of(design.planner).needs_kernel(design.planner):
        return [Driven(design, _planned(world, design, index), [index]) for index in everyone]
    route = _planned(world, design, None)
    steering = planners.steering_of(design.planner)
    if steering is None:
        return [Driven(design, route, everyone)]
    trials = [(trial, design.label, design.swaths) for trial in world.trials]
    sense = sensed_attitudes(
        planners.attitude_sensor(world.dems),
        world.study.sensors,
        world.study.rover.speed_m_s,
        [world.stream("sensed attitude", *trial) for trial in trials],
    )
    rngs = [world.stream("steering", *trial) for trial in trials]
    driven = planners.rollout(world.area, route, steering, sense, rngs)
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
        found = KernelSearch(xy, heights, _noise_m(world.study), how.families).found()
    else:
        found = [_given(how, world.study)] * len(mine)
    mean, claimed = mapped(xy, heights, found, world.nodes.xy)
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
    mission = MissionConfig(
        schema_version=1,
        name=study.name,
        seed=seed,
        terrain=RandomTerrain(source="random"),
        planner=design.planner,
        rover=study.rover,
        sensors=study.sensors,
        localization=study.localization,
    )
    recording, _ = simulate_statistical(world.dems[index], driven.route, mission)
    result = localize(recording, mission.assumed)
    return result.trajectory, result.points

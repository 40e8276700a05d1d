"""Types that a package exports beside those of `firnline` can be pickled and copied too."""

import copy
import pickle
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from inspect import isclass
from typing import Any

import numpy as np
import pytest

import firnline
from desk import PlanDocument
from planners import (
    PLANNERS,
    AdaptiveConfig,
    AdaptiveSurvey,
    Attitude,
    Band,
    Choice,
    ErrorModel,
    LayoutTask,
    LeftOut,
    Mobility,
    PiecewiseContinuousSteering,
    PredictedError,
    RandomWanderSteering,
    SteeringState,
    drivable,
)
from planners.guarantee.error_distribution import MapPrediction
from planners.guarantee.kernel_posterior import KernelPosterior
from planners.routes.rover import Crew
from survey.data.sensors.payload import Quantity
from survey.reconstruction import (
    ConstantMean,
    DemMean,
    FunctionMean,
    GaussianProcessTerrain,
    VelocityRasters,
)
from survey.reconstruction.gp.kernels import Matern32
from survey.reporting import (
    FleetResults,
    HazardResults,
    OnBoard,
    PayloadResults,
    RoverDrive,
    SurveyResults,
)
from survey.scoring import (
    Checkpoints,
    RasterField,
    SampleCells,
    SteadyField,
    TrackedField,
    TrackedMotion,
    map_classes,
    score_at,
)
from survey.scoring.standards.checkpoint_errors import compare
from survey.scoring.standards.standards import STANDARDS
from survey.terrain import SampleSite, SatelliteDem
from tests.firnline.test_objects import instances, parts
from vision_slam import LocalizationConfig, ParticleFilter, SeenDrive

PACKAGES = (
    "survey", "planners", "vision_slam", "sim", "live", "desk", "survey.terrain", "survey.scoring", "survey.figures",
    "survey.reporting", "survey.reconstruction",
)  # fmt: skip
INTERFACES = {"Steering", "TerrainModel"}
AT_WORK = {"VisualSlam"}
"""Trackers at work, which hold objects of GTSAM and OpenCV; their results are public types."""


def exported() -> set[type]:
    modules = [import_module(package) for package in PACKAGES]
    types = {getattr(module, name) for module in modules for name in module.__all__}
    public = {getattr(firnline, name) for name in firnline.__all__}
    return {kind for kind in types - public if isclass(kind) and kind.__name__ not in INTERFACES | AT_WORK}


def plans() -> Iterator[Any]:
    """Yield the types of planning."""
    made = instances()
    area, route, dem, grid = (made[name] for name in ("SurveyArea", "Route", "Dem", "Grid"))
    config = firnline.LawnmowerConfig(swaths=2)
    steered = firnline.RandomWanderConfig(swaths=2)
    yield from (Mobility(), PLANNERS[0], LayoutTask(area, Crew()), Choice(config, route, 0.5))
    yield drivable(area, None, firnline.RoverLimits())
    yield LeftOut(area.polygon, "too steep")
    yield from (AdaptiveConfig(0.5), SteeringState(0.0, np.zeros(2, dtype=np.int64)))
    yield AdaptiveSurvey(None, np.zeros((0, 2)), KernelPosterior(()), MapPrediction(0.5, 0.4), holds=False)
    yield ErrorModel(grid, np.ones(grid.shape, dtype=bool), Matern32(4.0, 30.0), 0.1, 10.0)
    yield PredictedError(dem, 0.1, 0.2, 0.3)
    yield Attitude(np.zeros(2), np.zeros(2), np.zeros(2))
    yield Band(np.eye(2), np.arange(2.0), np.ones(2), np.ones(2))
    yield from (PiecewiseContinuousSteering(steered), RandomWanderSteering(steered), PlanDocument())


def estimates() -> Iterator[Any]:
    """Yield the types of localization and mapping."""
    made = instances()
    yield ParticleFilter(LocalizationConfig(), np.random.default_rng(1), n_particles=10)
    yield from (ConstantMean(1.0), DemMean(made["Dem"]), FunctionMean(np.sum), GaussianProcessTerrain())
    yield SeenDrive(*(made[name] for name in ("Frames", "Camera", "VisualOdometry", "Trajectory")))
    yield VelocityRasters(*(made["Dem"],) * 4)
    yield SampleSite(made["Dem"], (0.0, 0.0, 1.0, 1.0))
    yield SatelliteDem(made["Dem"].elevation, made["Dem"].transform, made["Dem"].crs)


def judgements() -> Iterator[Any]:
    """Yield the types of scores and reports."""
    made = instances()
    area, dem, path = (made[name] for name in ("SurveyArea", "Dem", "Trajectory"))
    rng = np.random.default_rng(1)
    west, south, east, north = dem.bounds
    places = np.column_stack([rng.uniform(west, east, 40), rng.uniform(south, north, 40), np.zeros(40)])
    checkpoints = Checkpoints(places, 0.02, dem.crs)
    errors = compare(dem, checkpoints)
    yield from (checkpoints, errors, SampleCells(area, 10.0), STANDARDS["nssda-1998"])
    yield from (score_at(errors, class_m=0.1), map_classes()[0])
    drive = RoverDrive(
        trajectory=path, reference_trajectory=path, ending="arrived", duration_s=1.0, energy_j=2.0
    )
    yield from (FleetResults(rovers=(drive,)), OnBoard(video=b"RIFF"))
    still = np.zeros((2, 2))
    yield TrackedMotion(still, still, np.zeros((2, 2, 2)), np.ones(2), np.zeros(2, dtype=bool))
    yield SteadyField(firnline.IceMotion(np.ones((3, 1)), 0.0, np.zeros(2), np.eye(3)), 4.0)
    yield RasterField(VelocityRasters(dem, dem, dem, dem), 4.0)
    corners = np.array([[x, y] for x in (0.0, 1.0, 2.0) for y in (0.0, 1.0, 2.0)])
    seen = corners, 0.1 * corners, np.tile(0.01 * np.eye(2), (9, 1, 1)), np.ones(9)
    yield TrackedField.of(TrackedMotion(*seen, np.zeros(9, dtype=bool), 1.0))
    yield HazardResults(probability=dem, max_slope_deg=20.0, facts={})
    map_ = made["Reconstruction"]
    yield PayloadResults(quantity=Quantity(name="albedo", unit="1", noise_sd=0.1), mapped=map_)
    yield SurveyResults(
        area=area, prior=None, truth=dem, route=made["Route"], reconstruction=map_, score=made["Score"]
    )


@cache
def examples() -> dict[type, Any]:
    found = [part for source in (plans, estimates, judgements) for value in source() for part in parts(value)]
    return {type(value): value for value in found}


@pytest.mark.parametrize("kind", sorted(exported(), key=lambda kind: kind.__name__))
def test_every_exported_type_is_pickled_and_copied(kind: type) -> None:
    value = examples()[kind]
    for again in (pickle.loads(pickle.dumps(value)), copy.deepcopy(value)):
        assert type(again) is kind
        assert vars(again).keys() == vars(value).keys() if hasattr(value, "__dict__") else len(again)

"""Types of the packages beside those of `firnline` can be pickled and copied too."""

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
from desk.plan.document import PlanDocument
from planners.costs import Rates
from planners.guarantee.adaptive import AdaptiveConfig, AdaptiveSurvey
from planners.patterns.best import Choice
from planners.patterns.piecewise_continuous import PiecewiseContinuousSteering
from planners.patterns.planner import LayoutTask
from planners.patterns.random_wander import RandomWanderSteering
from planners.prediction.assumptions import MapAssumptions
from planners.prediction.error_distribution import MapPrediction
from planners.prediction.error_model import ErrorModel, PredictedError
from planners.prediction.kernel_posterior import KernelPosterior
from planners.registry import PLANNERS
from planners.routes.rover import Crew, Mobility
from planners.routes.traversability import LeftOut, drivable
from planners.steered_paths import Band
from planners.steering import Attitude, SteeringState
from survey.data.sensors.payload import Quantity
from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain
from survey.reconstruction.gp.kernels import Matern32
from survey.reconstruction.gp.mean import ConstantMean, DemMean, FunctionMean
from survey.reconstruction.lattice.free_surface import FreeSurface
from survey.reconstruction.motion.priors import VelocityRasters
from survey.reporting.survey_results import (
    FleetResults,
    HazardResults,
    OnBoard,
    PayloadResults,
    RoverDrive,
    SurveyResults,
)
from survey.scoring import Checkpoints, map_classes, score_at
from survey.scoring.coverage import SampleCells
from survey.scoring.differencing.displacements import RasterField, SteadyField, TrackedField
from survey.scoring.differencing.tracking import TrackedMotion
from survey.scoring.standards.checkpoint_errors import compare
from survey.scoring.standards.standards import STANDARDS
from survey.terrain.real import SampleSite
from survey.terrain.satellite import SatelliteDem
from tests.firnline.test_objects import instances, parts
from vision_slam import LocalizationConfig
from vision_slam.fusion.particle_filter import ParticleFilter
from vision_slam.places.loop_closures import SeenDrive

MODULES = {
    "desk.plan.document": "PlanDocument",
    "planners.costs": "FieldWork Rates",
    "planners.guarantee.adaptive": "AdaptiveConfig AdaptiveSurvey",
    "planners.patterns.best": "Choice",
    "planners.patterns.piecewise_continuous": "PiecewiseContinuousSteering",
    "planners.patterns.planner": "LayoutTask Planner",
    "planners.patterns.random_wander": "RandomWanderSteering",
    "planners.prediction.assumptions": "MapAssumptions",
    "planners.prediction.error_model": "ErrorModel PredictedError",
    "planners.routes.rover": "Mobility",
    "planners.routes.traversability": "Drivable LeftOut",
    "planners.steered_paths": "Band",
    "planners.steering": "Attitude SteeringState",
    "survey.reconstruction.gp.gp_terrain": "GaussianProcessTerrain",
    "survey.reconstruction.gp.mean": "ConstantMean DemMean FunctionMean",
    "survey.reconstruction.lattice.free_surface": "FreeSurface",
    "survey.reconstruction.motion.priors": "VelocityRasters",
    "survey.reporting.survey_results": "FleetResults HazardResults OnBoard PayloadResults RoverDrive SurveyResults",
    "survey.scoring.differencing.displacements": "RasterField SteadyField TrackedField",
    "survey.scoring.differencing.tracking": "TrackedMotion",
    "survey.scoring.coverage": "SampleCells",
    "survey.scoring.standards.assessment": "Assessment CheckpointScore",
    "survey.scoring.standards.checkpoint_errors": "CheckpointErrors RmseInterval Spread",
    "survey.scoring.standards.checkpoints": "Checkpoints",
    "survey.scoring.standards.map_classes": "MapClass",
    "survey.scoring.standards.standards": "Standard",
    "survey.terrain.real": "SampleSite",
    "survey.terrain.satellite": "SatelliteDem",
    "vision_slam.fusion.particle_filter": "ParticleFilter",
    "vision_slam.places.loop_closures": "SeenDrive",
}
KINDS = [getattr(import_module(module), name) for module, names in MODULES.items() for name in names.split()]
PACKAGES = ("survey", "survey.reconstruction", "survey.scoring", "survey.terrain", "planners", "vision_slam")


def plans() -> Iterator[Any]:
    """Yield the types of planning."""
    made = instances()
    area, route, dem = (made[name] for name in ("SurveyArea", "Route", "Dem"))
    config = firnline.LawnmowerConfig(swaths=2)
    steered = firnline.RandomWanderConfig(swaths=2)
    yield from (Mobility(), PLANNERS[0], LayoutTask(area, Crew()), Choice(config, route, 0.5))
    yield drivable(area, None, firnline.RoverLimits())
    yield LeftOut(area.polygon, "too steep")
    yield from (AdaptiveConfig(0.5), SteeringState(0.0, np.zeros(2, dtype=np.int64)))
    yield AdaptiveSurvey(None, np.zeros((0, 2)), KernelPosterior(()), MapPrediction(0.5, 0.4), holds=False)
    yield from (ErrorModel.of(area, Matern32(4.0, 30.0), noise_m=0.1), MapAssumptions())
    yield PredictedError(dem, 0.1, 0.2, 0.3)
    rates = Rates(currency="EUR", person_day=600.0)
    yield from (rates, rates.field_work(3600.0, 1))
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
    corners, one = np.eye(3), np.ones(3)
    yield FreeSurface(corners, np.array([[0, 1, 2]]), corners, one, one > 0.0, 1.0, 0.1, 0.1, (1.0, 1.0))
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


@pytest.mark.parametrize("kind", KINDS)
def test_every_type_is_pickled_and_copied(kind: type) -> None:
    value = examples()[kind]
    for again in (pickle.loads(pickle.dumps(value)), copy.deepcopy(value)):
        assert type(again) is kind
        assert vars(again).keys() == vars(value).keys() if hasattr(value, "__dict__") else len(again)


def test_every_type_that_a_package_exports_is_among_them():
    modules = [import_module(package) for package in PACKAGES]
    exported = {
        value for module in modules for name in module.__all__ if isclass(value := getattr(module, name))
    }
    assert exported - {getattr(firnline, name) for name in firnline.__all__} <= set(KINDS)

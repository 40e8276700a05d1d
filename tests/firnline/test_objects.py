"""Every public type, and every type that public ones hold, can be pickled, copied, compared and shown.

The instances come from one small survey.
"""

import copy
import inspect
import pickle
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from pydantic import BaseModel

import firnline
from survey.core.errors import FirnlineError
from survey.core.map_scale import MapScale
from survey.data.recording import OdometryRecording
from survey.data.sensors.lidar import LidarReturns, Scanner
from survey.data.sensors.odometry import Sightings
from survey.data.sensors.stakes import Stakes, StakeSurveys
from survey.reconstruction.checks import HeldOut, HeldOutGroups, PredictiveCheck, PredictiveScores, RmseClaim
from survey.reconstruction.gp.mean import DemMean
from survey.reconstruction.joint.drives import PathCorrection
from survey.reconstruction.method import MappedTerrain, MappingTask, MethodSettings, ScanSettings
from survey.reconstruction.registry import METHODS
from survey.scoring.coverage import NodeCounts
from survey.scoring.differencing.variogram import Structure
from survey.scoring.differencing.volume_change import AlongFlow, FlowBalance
from survey.terrain.synthetic import cosine_surface
from vision_slam.odometry.health import FrameHealth
from vision_slam.odometry.self_calibration import LensEstimate

CRS = "EPSG:32608"
TIMES = [0.0, 1.0]
HELD = {
    "sim.config.mission": "AreaConfig DrawnSetting MismatchConfig ScoreConfig",
    "sim.config.rover": "FleetConfig PayloadConfig PhysicsConfig",
    "sim.config.sensors": "BarometerConfig CompassConfig FaultConfig GpsConfig InertialConfig StakeConfig WeatherConfig WheelConfig",
    "sim.config.world": "AppearanceConfig IceAssumptions IceConfig ImagingConfig SatelliteConfig SceneryConfig",
    "survey.core.map_scale": "MapScale ScaleRange",
    "survey.data.recording": "OdometryRecording",
    "survey.data.route": "RouteSamples",
    "survey.data.sensors.lidar": "LidarReturns Scanner",
    "survey.data.sensors.odometry": "Sightings",
    "survey.data.sensors.records": "Weather",
    "survey.data.sensors.stakes": "Stakes StakeSightings StakeSurveys",
    "survey.reconstruction.checks": "HeldOut HeldOutGroups PredictiveCheck PredictiveScores RmseClaim RmsePosterior",
    "survey.reconstruction.joint.drives": "PathCorrection",
    "survey.reconstruction.method": "MappedTerrain MappingTask ReconstructionMethod ScanSettings",
    "survey.reconstruction.prior": "ErrorScale PriorErrors",
    "survey.reconstruction.registry": "ReconstructionConfig",
    "survey.scoring.differencing.coregistration": "SurveyAlignment",
    "survey.scoring.differencing.variogram": "Structure Variogram",
    "survey.scoring.differencing.volume_change": "AlongFlow FlowBalance MassBalance",
    "survey.scoring.coverage": "NodeCounts",
    "survey.scoring.standards.map_classes": "Verdict",
    "vision_slam.config": "ImageOdometryErrors",
    "vision_slam.odometry.health": "FrameHealth",
    "vision_slam.odometry.self_calibration": "LensEstimate",
}
"""Types that public ones hold, by the modules that define them."""
KINDS: dict[str, type[Any]] = {
    name: getattr(firnline, name) for name in firnline.__all__ if inspect.isclass(getattr(firnline, name))
} | {name: getattr(import_module(module), name) for module, names in HELD.items() for name in names.split()}
TYPES = list(KINDS)


class Blank:
    """Images of one grey."""

    def __getitem__(self, index: int) -> np.ndarray:
        return np.zeros((4, 6), np.uint8)


def sensors() -> Iterator[Any]:
    """Yield records of the sensors that the small survey does not carry."""
    vector, square = np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1))
    filled = {
        "time_s": TIMES,
        "index": [0.0, 0.0],
        "earlier_s": [0.0, 0.0],
        "offset": vector,
        "position": vector,
        "covariance": square,
        "angular_velocity_rad_s": vector,
        "specific_force_m_s2": vector,
    }
    for name in ("Compass", "Inertial", "LoopClosures", "StakeSightings", "Weather", "Wheels"):
        kind = KINDS[name]
        given = {
            field.name: filled.get(field.name, np.zeros((2, *kind._shape(field.name))))
            for field in fields(kind)
        }
        yield kind(**given)
    yield Stakes(vector, [0.1, 0.1])
    yield StakeSurveys(TIMES, [0.0, 0.0], vector, [0.1, 0.1])


def configurations() -> Iterator[Any]:
    """Yield one of each configuration, at its defaults where it has them."""
    needed = {
        "LawnmowerConfig": {"swaths": 3}, "WavyConfig": {"swaths": 3}, "PiecewiseContinuousConfig": {"swaths": 3},
        "RandomWanderConfig": {"swaths": 3}, "VarianceDrivenConfig": {"budget_m": 900.0}, "BestConfig": {"rmse_m": 0.5},
        "RandomTerrain": {"source": "random"}, "SampleTerrain": {"source": "srtm-sample"},
        "DemTerrain": {"source": "dem", "file": "dem.tif"}, "FaultConfig": {"component": "gps", "failure": "jump"},
        "Scanner": {"elevation_deg": (0.0,), "n_columns": 4}, "PayloadConfig": {"name": "albedo", "unit": "1"}, "DrawnSetting": {"setting": "rover.pitch_deg", "between": (0.0, 1.0)},
    }  # fmt: skip
    for name in TYPES:
        kind = KINDS[name]
        if issubclass(kind, BaseModel) and name != "MissionConfig":
            yield kind(**needed.get(name, {}))
    mission = firnline.MissionConfig(
        schema_version=1,
        name="small",
        terrain=firnline.SampleTerrain(source="srtm-sample"),
        planner=firnline.LawnmowerConfig(swaths=3),
    )
    yield from (mission, firnline.SharedWorld(mission))


def errors() -> Iterator[FirnlineError]:
    """Yield one of each error."""
    for name in TYPES:
        kind = KINDS[name]
        if issubclass(kind, FirnlineError):
            yield kind("the file is empty; get it again.")


def survey() -> Iterator[Any]:
    """Plan, simulate, localize, reconstruct and score a small survey, and yield what comes out."""
    grid = firnline.Grid((0.0, 0.0, 120.0, 120.0), 4.0, CRS)
    terrain = cosine_surface(grid, np.random.default_rng(0), relief_m=5.0)
    area = firnline.SurveyArea.rectangle((20.0, 20.0, 100.0, 100.0), CRS)
    route = firnline.plan(area, None, firnline.LawnmowerConfig(swaths=2))
    recording, truth = firnline.simulate(terrain, route)
    found = firnline.localize(recording)
    nodes = firnline.Grid((20.0, 20.0, 100.0, 100.0), 8.0, CRS)
    map_ = firnline.reconstruct(found.points, nodes, method="tin")
    yield from (route, route.sample(5.0), recording, truth, found, map_)
    yield firnline.World(terrain, terrain, area)
    yield firnline.score(map_, truth=terrain, route=route)
    yield firnline.trajectory_error(found.trajectory, truth.trajectory)
    yield MappingTask(found.points, nodes)
    yield MappedTerrain(map_)
    later = firnline.Dem.on(grid, terrain.elevation + np.random.default_rng(1).normal(0.0, 0.1, grid.shape))
    ice = {"ice": shapely.Point(60.0, 60.0).buffer(20.0)}
    found_change = firnline.change(later, terrain, ice, align=True)
    yield from (found_change, found_change.volumes[0].mass())
    rough = np.random.default_rng(2).uniform([20.0, 20.0, -0.1], [40.0, 40.0, 0.1], (2, 4000, 3))
    yield firnline.m3c2(
        *(firnline.SurfacePoints(xyz, sigma_m=0.02, crs=CRS) for xyz in rough), registration_m=0.01
    )


def others() -> Iterator[Any]:
    """Yield what no survey of the rover's own gives."""
    yield firnline.sample_survey(swaths=2)
    yield firnline.Camera("pinhole", 6, 4, [[4, 0, 3], [0, 4, 2], [0, 0, 1]], np.zeros(5), np.eye(4))
    yield firnline.Frames(TIMES, Blank())
    yield PathCorrection(np.array(TIMES), np.zeros((2, 3)), np.zeros((2, 3, 3)))
    odometry = firnline.Odometry(TIMES, [[1.0, 0.0, 0.0]], np.zeros((2, 3)))
    sightings = Sightings([0], [[1.0, 0.0, 0.0]], np.eye(3)[None], [1.0])
    yield firnline.VisualOdometry(odometry, sightings, (FrameHealth(1.0, 0.0, 2.0),), np.array([False, True]))
    gps = firnline.GpsFixes(TIMES, np.zeros((2, 3)))
    yield OdometryRecording(CRS, np.zeros(3), gps=gps, odometry=odometry, sightings=sightings)
    yield METHODS["tin"]
    yield MapScale.over(CRS, (499_000.0, 6_700_000.0, 501_000.0, 6_701_000.0))
    yield ScanSettings()
    yield NodeCounts(1, 2, 3)
    yield MethodSettings.of(firnline.JointConfig(slope_passes=3))

    yield firnline.RunFolder(Path("runs") / "small" / "1")
    yield DemMean(firnline.Dem.on(firnline.Grid((0.0, 0.0, 2.0, 1.0), 1.0), np.zeros((2, 3))))
    yield firnline.GaussianProcessConfig(fit=False, variance_m2=1.0, length_scale_m=9.0).stated_kernel()
    yield firnline.SatelliteErrors().model()
    yield RmseClaim.of(np.eye(3), np.ones(3))
    scores = PredictiveScores.of(np.array([0.1, -0.3]), np.array([0.1, 0.1]))
    yield PredictiveCheck("discs", 2, scores, scores, (1.0,), (2.0,), (0.5,), (1.0,))
    none = np.zeros(0)
    groups = HeldOutGroups(none, none, none, none, np.zeros((0, 0)))
    yield HeldOut("discs", 2, none, none, none, none, groups)
    yield Structure("spherical", 30.0, 0.25)
    yield firnline.Certificate(RmseClaim.of(np.eye(3), np.ones(3)), (), (), is_tested=True)
    yield firnline.Surroundings(speed_m_s=1.0)
    yield firnline.IceMotion(np.array([[2.0], [0.0], [0.1]]), 0.0, np.zeros(2), np.eye(3))
    balance = FlowBalance("ice", -0.8, 0.1, 0.3, 0.2, -0.5, 0.2, 80.0)
    flat, shift = (
        firnline.Dem.on(firnline.Grid((0.0, 0.0, 2.0, 2.0), 1.0), np.zeros((3, 3))),
        np.zeros((2, 3, 3)),
    )
    yield AlongFlow(flat, np.ones((3, 3)), shift, shift, (balance,))
    yield from (balance, firnline.Thickness(80.0))
    camera = firnline.Camera("pinhole", 6, 4, [[4, 0, 3], [0, 4, 2], [0, 0, 1]], np.zeros(5), np.eye(4))
    returns = LidarReturns(*(np.zeros(1, kind) for kind in (np.uint32, np.uint16, np.uint8, np.uint32)))
    scanner = Scanner(elevation_deg=(0.0,), n_columns=4)
    yield from (returns, firnline.BeamErrors(0.03), firnline.LidarScans(scanner, TIMES, (returns,)))
    yield firnline.SensorScan(np.zeros(1), np.zeros((1, 3)), np.zeros(3))
    yield LensEstimate(camera, False, np.zeros(3), np.zeros(3), 0.0, 0.0, 0.0, "no turn")


def parts(value: Any) -> Iterator[Any]:
    """Yield a value and everything that it holds."""
    yield value
    if isinstance(value, BaseModel):
        held = [getattr(value, name) for name in type(value).model_fields]
    elif is_dataclass(value):
        held = [getattr(value, field.name) for field in fields(value)]
    else:
        held = list(value) if isinstance(value, tuple) else []
    for each in held:
        yield from parts(each)


@cache
def instances() -> dict[str, Any]:
    """Return one instance of each public type, an instance of a subclass where the type is abstract."""
    found: list[Any] = []
    for source in (configurations, errors, sensors, survey, others):
        for value in source():
            found.extend(parts(value))
    result = {}
    for name in TYPES:
        kind = KINDS[name]
        exact = [value for value in found if type(value) is kind]
        result[name] = next(iter(exact or [value for value in found if isinstance(value, kind)]), None)
    return result


def same(a: Any, b: Any) -> bool:
    """Compare two objects; errors by their text, tuples with arrays by their parts."""
    if isinstance(a, FirnlineError):
        return type(a) is type(b) and str(a) == str(b)
    if isinstance(a, tuple):
        return all(
            np.array_equal(x, y) if isinstance(x, np.ndarray) else x == y for x, y in zip(a, b, strict=True)
        )
    return bool(a == b)


@pytest.mark.parametrize("name", TYPES)
def test_every_public_type_is_pickled_copied_and_compared(name):
    value = instances()[name]
    assert value is not None, f"no instance of {name}"
    if name == "Frames":  # Two sources of images are equal when they are the same object.
        value = firnline.Frames(TIMES, (np.zeros((4, 6), np.uint8),) * 2)
    for again in (pickle.loads(pickle.dumps(value)), copy.deepcopy(value)):
        assert type(again) is type(value)
        assert same(again, value)


@pytest.mark.parametrize("name", TYPES)
def test_every_public_type_is_shown_in_one_line(name):
    assert "\n" not in repr(instances()[name])


def test_score_is_shown_as_a_table():
    assert "<th style='text-align:left'>RMSE</th>" in instances()["Score"]._repr_html_()

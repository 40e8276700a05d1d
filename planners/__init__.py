"""Route planning: patterns of swaths, their choice by predicted error, and steering while driving.

Data types live in `survey`; this package neither localizes nor simulates.
"""

from planners.config import (
    BestConfig,
    LawnmowerConfig,
    PatternConfig,
    PiecewiseContinuousConfig,
    RandomWanderConfig,
    VarianceDrivenConfig,
    WavyConfig,
)
from planners.driving.energy import Mobility
from planners.driving.rover import Fleet, Rover
from planners.ground.drivable_area import Drivable, LeftOut
from planners.ground.traversability import RoverLimits, drivable
from planners.patterns.planner import LayoutTask, Planner
from planners.planning import plan
from planners.prediction.choose import Choice, choose
from planners.prediction.error_model import ErrorModel, PredictedError
from planners.prediction.predict import predict_error, terrain_kernel
from planners.registry import PLANNERS, PlannerConfig, pattern_names, planner_config, planner_of, steering_of
from planners.steering.attitude import Attitude, attitude_sensor
from planners.steering.band import Band
from planners.steering.piecewise_continuous import PiecewiseContinuousSteering
from planners.steering.random_wander import RandomWanderSteering
from planners.steering.rollout import rollout
from planners.steering.steering import Steering, SteeringState

__all__ = [
    "PLANNERS",
    "Attitude",
    "Band",
    "BestConfig",
    "Choice",
    "Drivable",
    "ErrorModel",
    "Fleet",
    "LawnmowerConfig",
    "LayoutTask",
    "LeftOut",
    "Mobility",
    "PatternConfig",
    "PiecewiseContinuousConfig",
    "PiecewiseContinuousSteering",
    "Planner",
    "PlannerConfig",
    "PredictedError",
    "RandomWanderConfig",
    "RandomWanderSteering",
    "Rover",
    "RoverLimits",
    "Steering",
    "SteeringState",
    "VarianceDrivenConfig",
    "WavyConfig",
    "attitude_sensor",
    "choose",
    "drivable",
    "pattern_names",
    "plan",
    "planner_config",
    "planner_of",
    "predict_error",
    "rollout",
    "steering_of",
    "terrain_kernel",
]

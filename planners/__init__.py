"""Planners of survey routes: patterns of swaths, their choice by predicted error, and steering while driving."""

from planners.choose import Choice, choose
from planners.config import (
    BestConfig,
    LawnmowerConfig,
    PiecewiseContinuousConfig,
    PlannerConfig,
    RandomWanderConfig,
    VarianceDrivenConfig,
    WavyConfig,
)
from planners.energy import Mobility
from planners.piecewise_continuous import PiecewiseContinuousSteering
from planners.planning import plan
from planners.predict import ErrorModel, PredictedError, predict_error, terrain_kernel
from planners.random_wander import RandomWanderSteering
from planners.rollout import rollout, steering_of
from planners.rover import Fleet, Rover
from planners.steering import Attitude, Band, Steering, SteeringState, attitude_sensor
from planners.traversability import Drivable, LeftOut, RoverLimits, drivable

__all__ = [
    "Attitude",
    "Band",
    "BestConfig",
    "Choice",
    "Drivable",
    "ErrorModel",
    "Fleet",
    "LawnmowerConfig",
    "LeftOut",
    "Mobility",
    "PiecewiseContinuousConfig",
    "PiecewiseContinuousSteering",
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
    "plan",
    "predict_error",
    "rollout",
    "steering_of",
    "terrain_kernel",
]

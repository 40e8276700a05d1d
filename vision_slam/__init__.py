"""Localization from what a rover senses: it is given a recording, never a world."""

from vision_slam.config import LocalizationConfig
from vision_slam.evaluation import TrajectoryError, trajectory_error
from vision_slam.pipeline import localize

__all__ = ["LocalizationConfig", "TrajectoryError", "localize", "trajectory_error"]

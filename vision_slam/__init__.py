"""Localization of a rover from its recording: visual odometry, sensor fusion, loop closures.

The truth of a simulation never reaches this package.
"""

from vision_slam.config import LocalizationConfig
from vision_slam.evaluation import TrajectoryError, trajectory_error
from vision_slam.fusion.particle_filter import ParticleFilter
from vision_slam.odometry.config import VisualOdometryConfig
from vision_slam.odometry.visual_odometry import visual_odometry
from vision_slam.odometry.visual_slam import VisualSlam
from vision_slam.pipeline import localize

__all__ = [
    "LocalizationConfig",
    "ParticleFilter",
    "TrajectoryError",
    "VisualOdometryConfig",
    "VisualSlam",
    "localize",
    "trajectory_error",
    "visual_odometry",
]

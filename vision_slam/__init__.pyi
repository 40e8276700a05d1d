"""Public names and the modules that define them."""

from vision_slam.config import LocalizationConfig as LocalizationConfig
from vision_slam.config import VisualOdometryConfig as VisualOdometryConfig
from vision_slam.evaluation import TrajectoryError as TrajectoryError
from vision_slam.evaluation import trajectory_error as trajectory_error
from vision_slam.fusion.particle_filter import ParticleFilter as ParticleFilter
from vision_slam.odometry.visual_odometry import visual_odometry as visual_odometry
from vision_slam.odometry.visual_slam import VisualSlam as VisualSlam
from vision_slam.pipeline import localize as localize
from vision_slam.pipeline import localize_on_ice as localize_on_ice
from vision_slam.places.loop_closures import SeenDrive as SeenDrive
from vision_slam.places.loop_closures import detect_drive_ties as detect_drive_ties

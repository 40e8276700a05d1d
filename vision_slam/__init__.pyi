"""Public names and the modules that define them."""

from vision_slam.config import LocalizationConfig as LocalizationConfig
from vision_slam.evaluation import trajectory_error as trajectory_error
from vision_slam.pipeline import localize as localize

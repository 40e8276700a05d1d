"""Data types of a survey, file formats, terrain reconstruction, scoring, figures and reports.

Route planning lives in `planners`, localization in `vision_slam`, simulation in `sim`.
"""

from survey import terrain
from survey.core.errors import CapacityError, ConfigError, FirnlineError, InputError
from survey.data.area import SurveyArea
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Frames
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.legs import Leg
from survey.data.recording import Recording
from survey.data.route import Route
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.data.truth import Truth
from survey.reconstruction import GaussianProcessConfig, Reconstruction, reconstruct
from survey.scoring import Score, score

__all__ = [
    "Camera",
    "CapacityError",
    "ConfigError",
    "Dem",
    "FirnlineError",
    "Frames",
    "GaussianProcessConfig",
    "Grid",
    "InputError",
    "Leg",
    "Reconstruction",
    "Recording",
    "Route",
    "Score",
    "SurfacePoints",
    "SurveyArea",
    "Trajectory",
    "Truth",
    "reconstruct",
    "score",
    "terrain",
]

"""The foundation of firnline: the nouns of a survey, terrain reconstruction, scoring, formats, figures."""

from survey import terrain
from survey.area import SurveyArea
from survey.camera import Camera, Frames
from survey.dem import Dem
from survey.errors import CapacityError, ConfigError, FirnlineError, InputError
from survey.grid import Grid
from survey.reconstruction import GaussianProcessConfig, Reconstruction, reconstruct
from survey.recording import Recording
from survey.route import Leg, Route
from survey.scoring import Score, score
from survey.surface_points import SurfacePoints
from survey.trajectory import Trajectory
from survey.truth import Truth

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

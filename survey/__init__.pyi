"""Public names and the modules that define them."""

from survey import terrain as terrain
from survey.core.errors import CapacityError as CapacityError
from survey.core.errors import ConfigError as ConfigError
from survey.core.errors import FirnlineError as FirnlineError
from survey.core.errors import InputError as InputError
from survey.data.area import SurveyArea as SurveyArea
from survey.data.camera import Camera as Camera
from survey.data.dem import Dem as Dem
from survey.data.frames import Frames as Frames
from survey.data.grid import Grid as Grid
from survey.data.recording import Recording as Recording
from survey.data.route import Leg as Leg
from survey.data.route import Route as Route
from survey.data.surface_points import SurfacePoints as SurfacePoints
from survey.data.trajectory import Trajectory as Trajectory
from survey.data.truth import Truth as Truth
from survey.reconstruction.gp.config import GaussianProcessConfig as GaussianProcessConfig
from survey.reconstruction.mapping import reconstruct as reconstruct
from survey.reconstruction.terrain_map import Reconstruction as Reconstruction
from survey.scoring.scores import Score as Score
from survey.scoring.scores import score as score

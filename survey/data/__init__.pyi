"""Names that most modules use, and the modules that define them."""

from survey.data.area import SurveyArea as SurveyArea
from survey.data.dem import Dem as Dem
from survey.data.grid import Grid as Grid
from survey.data.ice_motion import IceMotion as IceMotion
from survey.data.path_error import PathError as PathError
from survey.data.recording import Recording as Recording
from survey.data.route import Route as Route
from survey.data.surface_points import SurfacePoints as SurfacePoints
from survey.data.trajectory import Trajectory as Trajectory

"""What a report shows: the survey, its map, how good it is, and what was on board."""

from dataclasses import dataclass

from matplotlib.figure import Figure

from survey.core.arrays import FloatArray
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.reconstruction.base import Reconstruction
from survey.scoring import Score


@dataclass(frozen=True, kw_only=True)
class OnBoard:
    """What a drive with a camera leaves to look at.

    Attributes
    ----------
    tracks : matplotlib.figure.Figure, optional
        What was followed in its images.
    video : bytes, optional
        What the camera saw, as an animated WebP.
    believed : (N, 2) ndarray, optional
        Where the rover thought that it was while it steered by that [m]: the drive is shown
        beside its plan.
    """

    tracks: Figure | None = None
    video: bytes | None = None
    believed: FloatArray | None = None


@dataclass(frozen=True, kw_only=True)
class SurveyResults:
    """A survey that came to its end, and all that it is judged by.

    Attributes
    ----------
    area : SurveyArea
        What was to be mapped; errors are shown inside it only.
    prior : Dem or None
        What was known before.
    truth : Dem
        The reference terrain.
    route : Route
        What was driven, or planned.
    reconstruction : Reconstruction
        The survey's map.
    score : Score
        How good it is; its first verdict is the headline.
    trajectory, reference_trajectory : Trajectory, optional
        Where the rover believed to be and where it was; drawn when both are given.
    points : SurfacePoints, optional
        What the map was made from.
    on_board : OnBoard, optional
        What the camera leaves to look at, where there was one.
    """

    area: SurveyArea
    prior: Dem | None
    truth: Dem
    route: Route
    reconstruction: Reconstruction
    score: Score
    trajectory: Trajectory | None = None
    reference_trajectory: Trajectory | None = None
    points: SurfacePoints | None = None
    on_board: OnBoard | None = None

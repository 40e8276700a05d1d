"""Content of a report: survey, map, score, and records of the camera."""

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
    """Camera records of a drive that a report shows.

    Parameters
    ----------
    tracks : matplotlib.figure.Figure, optional
        Feature tracks in its images.
    video : bytes, optional
        Images of the drive as an animated WebP.
    estimated : (N, 2) ndarray, optional
        Position by which the rover steered [m]; the drive is then shown beside its plan.
    """

    tracks: Figure | None = None
    video: bytes | None = None
    estimated: FloatArray | None = None


@dataclass(frozen=True, kw_only=True)
class SurveyResults:
    """A finished survey with its reference and score.

    Parameters
    ----------
    area : SurveyArea
        Area to be mapped; errors are shown inside it only.
    prior : Dem or None
        Prior terrain.
    truth : Dem
        The reference terrain.
    route : Route
        Driven or planned route.
    reconstruction : Reconstruction
        Map of the survey.
    score : Score
        Score of the map; its first verdict is the headline.
    trajectory, reference_trajectory : Trajectory, optional
        Estimated and true path; drawn when both are given.
    points : SurfacePoints, optional
        Points that the map was made from.
    on_board : OnBoard, optional
        Camera records, where there was a camera.
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

"""Content of a report: survey, map, score, and records of the camera."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from matplotlib.figure import Figure

from survey.core.arrays import FloatArray, ReadOnlyMapping
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.data.sensors.payload import Quantity
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.reconstruction.terrain_map import Reconstruction
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
class RoverDrive:
    """Drive of one rover of a fleet.

    Parameters
    ----------
    trajectory, reference_trajectory : Trajectory
        Estimated and true path.
    ending : str
        How the drive ended: ``arrived``, ``stalled`` …
    duration_s : float
        Time from the departure to the end of the drive [s].
    energy_j : float
        Energy drawn from the battery [J].
    horizontal_rms_m, vertical_rms_m : float, optional
        Error of the estimated path [m].
    n_ties : int
        Number of places that it shares with other rovers.
    """

    trajectory: Trajectory
    reference_trajectory: Trajectory
    ending: str
    duration_s: float
    energy_j: float
    horizontal_rms_m: float | None = None
    vertical_rms_m: float | None = None
    n_ties: int = 0


@dataclass(frozen=True, kw_only=True)
class FleetResults:
    """Drives of a fleet.

    Parameters
    ----------
    rovers : tuple of RoverDrive
        In the order of the rovers.
    losses : mapping of str to float
        What the loss of rovers cost, units in the names; empty without a loss.
    """

    rovers: tuple[RoverDrive, ...]
    losses: Mapping[str, float] = field(default_factory=lambda: ReadOnlyMapping({}))


@dataclass(frozen=True, kw_only=True)
class PayloadResults:
    """Map of one quantity of a science payload.

    Parameters
    ----------
    quantity : Quantity
        Name and unit.
    mapped : Reconstruction
        Its map.
    scores : mapping of str to float
        ``rmse``, ``coverage_95``, ``claimed_rms`` and ``scc``; empty without a reference.
    """

    quantity: Quantity
    mapped: Reconstruction
    scores: Mapping[str, float] = field(default_factory=lambda: ReadOnlyMapping({}))


@dataclass(frozen=True, kw_only=True)
class HazardResults:
    """Ground beyond the rover's largest slope.

    Parameters
    ----------
    probability : Dem
        Probability at each node.
    max_slope_deg : float
        The limit [deg].
    facts : mapping of str to float
        Share of no-go ground and risk of the route, units in the names.
    """

    probability: Dem
    max_slope_deg: float
    facts: Mapping[str, float]


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
    points_name : str
        What the points are.
    on_board : OnBoard, optional
        Camera records, where there was a camera.
    fleet : FleetResults, optional
        Drives of several rovers, instead of one trajectory.
    payload : tuple of PayloadResults
        Maps of the quantities that a science payload measured.
    hazard : HazardResults, optional
        Steep ground, and the risk of the route.
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
    points_name: str = "Landmarks"
    on_board: OnBoard | None = None
    fleet: FleetResults | None = None
    payload: tuple[PayloadResults, ...] = ()
    hazard: HazardResults | None = None

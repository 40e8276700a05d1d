"""Content of the sheets of a plan: what was planned, on what, and what is expected of it."""

from dataclasses import dataclass, field
from typing import NamedTuple

from shapely import Polygon

from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route


class RoverEffort(NamedTuple):
    """Length [m], turns, time [s] and energy [J] of one rover, and the batteries that it uses up.

    Parameters
    ----------
    length_m : float
        Length of its legs on the ground [m].
    n_turns : int
        Number of turns.
    time_s : float
        Time of driving [s].
    energy_j : float
        Energy that it takes from the battery [J].
    batteries : float, optional
        Energy in full batteries; None where the size of a battery was not stated.
    """

    length_m: float
    n_turns: int
    time_s: float
    energy_j: float
    batteries: float | None = None


@dataclass(frozen=True)
class PlanContent:
    """A plan with what its sheets state.

    Parameters
    ----------
    title : str
        Name of the survey.
    date : str
        Date of the plan.
    area : SurveyArea
        Outline and no-go zones.
    route : Route
        In the CRS of the area.
    efforts : tuple of RoverEffort
        One for each rover.
    swaths_text : str
        Number of swaths, such as ``"6 lines in 10 pieces"``.
    time_s : float
        Time until the last rover is done [s].
    terrain : Dem, optional
        Prior terrain.
    std : Dem, optional
        Predicted standard deviation of the map [m].
    left_out : tuple of (shapely.Polygon, str)
        Pieces of the area where rovers cannot be, with the reason.
    assumptions : tuple of str
        What the numbers rest on, one sentence each.
    """

    title: str
    date: str
    area: SurveyArea
    route: Route
    efforts: tuple[RoverEffort, ...]
    swaths_text: str
    time_s: float
    terrain: Dem | None = None
    std: Dem | None = None
    left_out: tuple[tuple[Polygon, str], ...] = ()
    assumptions: tuple[str, ...] = field(default_factory=tuple)

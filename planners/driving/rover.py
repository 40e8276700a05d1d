"""Rovers and fleets: limits, turning, energy, number and where they finish."""

from dataclasses import dataclass, field
from typing import Self

from pydantic import PositiveFloat, PositiveInt, model_validator

from planners.capacity import require_rovers
from planners.driving.energy import Mobility
from planners.driving.turns import Turning, turning_room_m
from planners.ground.traversability import RoverLimits
from planners.ground_metres import dem_in_grid_metres, in_grid_metres
from survey.core.arrays import FloatArray
from survey.core.config import Section
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem


class Rover(Mobility, RoverLimits, Turning):
    """Rover: energy and speed of driving, limits of the ground, turning.

    By default it pivots on the spot, its battery is endless and no ground is too steep.

    Examples
    --------
    >>> Rover(max_pitch_deg=20.0, max_roll_deg=15.0).max_slope_deg
    15.0
    """

    @property
    def turning_room_m(self) -> float:
        """Distance from every border that it needs where it turns [m]."""
        return turning_room_m(self.turn_radius_m)


class Fleet(Section):
    """Number of rovers that survey together, and where they finish.

    They begin at the area's starts: one start for all, or one for each. Several rovers,
    and rovers with a battery, return to where they began.
    """

    rovers: PositiveInt = 1
    """Number of rovers."""
    return_to_start: bool = False
    """Whether a single rover, too, drives back to its start."""
    end_m: tuple[float, float] | None = None
    """Where a single rover has to finish, easting and northing in the area's CRS [m]."""
    separation_m: PositiveFloat | None = None
    """Distance that rovers keep from one another by departing later [m], but within twice this distance of a depot; none when
    left out."""

    @model_validator(mode="after")
    def _one_end(self) -> Self:
        if self.end_m is not None and (self.rovers > 1 or self.return_to_start):
            raise ValueError("end_m is for a single rover that does not return to its start")
        return self


@dataclass(frozen=True)
class Crew:
    """Fleet of like rovers, with the prior heights ``dem`` of their ground, if any."""

    rover: Rover = field(default_factory=Rover)
    fleet: Fleet = field(default_factory=Fleet)
    dem: Dem | None = None

    @property
    def makes_round_trips(self) -> bool:
        """Whether all return to where they began: several rovers, or one with a battery."""
        return self.fleet.rovers > 1 or self.rover.battery_j is not None

    @property
    def is_unbound(self) -> bool:
        """Whether nothing is asked but to drive every swath."""
        finishes = self.fleet.return_to_start or self.fleet.end_m is not None
        return not (self.makes_round_trips or finishes or self.rover.turn_radius_m > 0.0)


def crew_in_grid_metres(crew: Crew, factor: float) -> Crew:
    """Return the rovers with lengths, speed and heights in grid metres.

    The energy for a grid metre is smaller by the factor, which a smaller mass and a higher
    speed express.

    Parameters
    ----------
    crew : Crew
        With metres on the ground.
    factor : float
        As `planners.ground_metres.settings_factor` returns it.

    Returns
    -------
    Crew
        The same object for a factor of 1.
    """
    if factor == 1.0:
        return crew
    rover = in_grid_metres(crew.rover, factor)
    rover = rover.model_copy(update={"mass_kg": rover.mass_kg / factor})
    return Crew(rover, in_grid_metres(crew.fleet, factor), dem_in_grid_metres(crew.dem, factor))


def depots(area: SurveyArea, fleet: Fleet) -> FloatArray | None:
    """Return where each rover begins (K, 2) [m]; None where a single rover may begin anywhere.

    Raises
    ------
    InputError
        Neither one start nor one for each rover; no start where rovers have to return to it.
    """
    require_rovers(fleet.rovers)
    n_starts = len(area.starts)
    if n_starts == fleet.rovers:
        return area.starts
    if n_starts == 1:
        return area.starts.repeat(fleet.rovers, axis=0)
    if n_starts == 0 and fleet.rovers == 1:
        return None
    rovers = "1 rover" if fleet.rovers == 1 else f"{fleet.rovers} rovers"
    raise InputError(
        f"the area has {n_starts} starts for {rovers}; mark one start for all of them, or one for each."
    )


def homes_of(area: SurveyArea, crew: Crew) -> FloatArray | None:
    """Return where each rover begins, as `depots` does, and refuse rovers that return without a start.

    Parameters
    ----------
    area : SurveyArea
        With its starts.
    crew : Crew
        Rovers and fleet.

    Returns
    -------
    (K, 2) ndarray or None
        Starts [m]; None where a single rover may begin anywhere.

    Raises
    ------
    InputError
        Neither one start nor one for each rover; no start where rovers have to return to it.
    """
    homes = depots(area, crew.fleet)
    if homes is None and (crew.fleet.return_to_start or crew.makes_round_trips):
        raise InputError("a rover that returns to its start needs one; mark a start in the area.")
    return homes

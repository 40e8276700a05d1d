r"""Rovers and fleets: speed, energy, limits of the ground, turning, number and where they finish.

A metre along a slope θ takes the energy

.. math:: e(\theta) = \frac{1}{\eta} \max(0, m g (c \cos\theta + \sin\theta)) + P / v

of `energy_per_metre`; `effort` adds length, time and energy of a polyline on a DEM, and `predicted` those of the legs of
a route. `Rover` holds the settings of one rover: `Mobility`, the `RoverLimits` of the ground and `Turning`. `Fleet` holds
their number and where they finish, and `Crew` both with the
prior heights. Nothing is won back downhill.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Self

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt, model_validator
from pyproj import CRS

from planners.capacity import require_rovers
from planners.config import dem_in_grid_metres, in_grid_metres
from survey import Dem, InputError, Leg, SurveyArea
from survey.core import FloatArray, Section
from survey.core.map_scale import ground_lengths_m
from survey.reconstruction.prior import ProductName

_GRAVITY_M_S2 = 9.81
_TURN_RAD = np.radians(30.0)
"""A change of heading above this at a waypoint counts as a turn."""


class Mobility(Section):
    """Speed, mass and efficiency of a rover; the defaults are those of a 250 kg electric rover on firm snow.

    >>> round(Mobility().flat_j_per_m)
    509
    """

    speed_m_s: PositiveFloat = 1.0
    """Speed on the way [m/s]."""
    turn_s: NonNegativeFloat = 4.0
    """Time for a turn on the spot [s]."""
    mass_kg: PositiveFloat = 250.0
    """Mass of the rover with its load [kg]."""
    rolling_resistance: NonNegativeFloat = 0.1
    """Resistance of the ground as a share of the weight; 0.05 on ice, 0.1 on firm snow, 0.3 on soft snow."""
    efficiency: float = Field(default=0.6, gt=0.0, le=1.0)
    """Share of the battery's energy that reaches the ground."""
    idle_w: NonNegativeFloat = 100.0
    """Power of computers, sensors and heating [W]."""
    battery_j: PositiveFloat | None = None
    """Usable energy of a full battery [J]; endless when left out."""
    recharge_s: NonNegativeFloat = 0.0
    """Time at the depot for a full or exchanged battery [s]."""

    @property
    def flat_j_per_m(self) -> float:
        """Energy per metre on level ground [J/m]."""
        return float(energy_per_metre(np.zeros(1), self)[0])


class Effort(NamedTuple):
    """Length [m], number of turns, time [s] and energy [J] of driving."""

    length_m: float
    n_turns: int
    time_s: float
    energy_j: float


def energy_per_metre(slope_rad: FloatArray, mobility: Mobility) -> FloatArray:
    r"""Return the energy that a metre along the ground takes [J/m].

    .. math:: e(\theta) = \frac{1}{\eta} \max(0, m g (c \cos\theta + \sin\theta)) + P / v

    with slope θ along the way (positive uphill), efficiency η, mass m, rolling
    resistance c, idle power P and speed v. Nothing is won back downhill.

    `slope_rad` (N,): slope along the direction of driving. Returns (N,): joules per metre along the slope.

    >>> rover = Mobility(mass_kg=100.0, rolling_resistance=0.0, efficiency=1.0, idle_w=0.0)
    >>> float(energy_per_metre(np.array([np.pi / 2]), rover)[0])
    981.0
    """
    weight = mobility.mass_kg * _GRAVITY_M_S2
    pull = weight * (mobility.rolling_resistance * np.cos(slope_rad) + np.sin(slope_rad))
    energy: FloatArray = np.maximum(pull, 0.0) / mobility.efficiency + mobility.idle_w / mobility.speed_m_s
    return energy


def effort(xy: FloatArray, mobility: Mobility, dem: Dem | None = None, *, crs: CRS | None = None) -> Effort:
    """Return length, time and energy of driving along a polyline.

    `xy` (N, 2): waypoints in driving order [m]. Returns: ``length_m`` in the horizontal plane; time and
    energy along the slope.

    >>> effort(np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 10.0]]), Mobility()).n_turns
    1
    """
    moves = np.diff(xy, axis=0)
    steps = np.hypot(*moves.T)
    heading = np.arctan2(moves[steps > 0.0, 1], moves[steps > 0.0, 0])
    change = np.abs((np.diff(heading) + np.pi) % (2.0 * np.pi) - np.pi)
    n_turns = int((change > _TURN_RAD).sum())
    ground_m = steps if crs is None else ground_lengths_m(crs, xy)
    run_m, rise_m = _runs(xy, steps, ground_m, dem)
    slant_m = np.hypot(run_m, rise_m)
    turning_s = n_turns * mobility.turn_s
    energy_j = (
        float(slant_m @ energy_per_metre(np.arctan2(rise_m, run_m), mobility)) + turning_s * mobility.idle_w
    )
    return Effort(
        float(ground_m.sum()), n_turns, float(slant_m.sum()) / mobility.speed_m_s + turning_s, energy_j
    )


def _runs(
    xy: FloatArray, steps: FloatArray, ground_m: FloatArray, dem: Dem | None
) -> tuple[FloatArray, FloatArray]:
    """Return run on the ground and rise [m] of short pieces of a path with segments of these grid and ground lengths."""
    if dem is None:
        return ground_m, np.zeros(len(steps))
    at = _summed(steps)
    n = max(int(np.ceil(at[-1] / dem.step_m)), 1)
    stations = np.union1d(np.linspace(0.0, at[-1], n + 1), at)
    points = np.column_stack([np.interp(stations, at, xy[:, k]) for k in (0, 1)])
    height = dem.at(points)
    if not np.isfinite(height).all():
        x, y = points[np.flatnonzero(~np.isfinite(height))[0]]
        raise InputError(
            f"the route passes ({x:.1f}, {y:.1f}), where the DEM has no height; keep the area on known ground."
        )
    run_m = np.diff(stations) if ground_m is steps else np.diff(np.interp(stations, at, _summed(ground_m)))
    return run_m, np.diff(height)


def _summed(lengths_m: FloatArray) -> FloatArray:
    """Return the distance along a path at its waypoints [m]."""
    distance: FloatArray = np.r_[0.0, np.cumsum(lengths_m)]
    return distance


def _swath_length_m(legs: Sequence[Leg], crs: CRS | None) -> float:
    """Return the length of all swaths together on the ground [m]."""
    swaths = [leg for leg in legs if leg.kind == "swath"]
    if crs is None or not swaths:
        return sum(leg.length_m for leg in swaths)
    # One call for all: each one begins with a transformation that takes longer than its points.
    lengths_m = ground_lengths_m(crs, np.vstack([leg.xy for leg in swaths]))
    ends = np.cumsum([len(leg.xy) for leg in swaths])
    return sum(
        float(lengths_m[end - len(leg.xy) : end - 1].sum()) for end, leg in zip(ends, swaths, strict=True)
    )


def predicted(
    legs: Sequence[Leg],
    mobility: Mobility,
    dem: Dem | None = None,
    *,
    waits_s: FloatArray | None = None,
    crs: CRS | None = None,
) -> dict[str, float]:
    """Return the expected length, time and energy of a route, for `Route.prediction`.

    `waits_s` (K,): how long each rover waits before it departs [s]. Returns: ``length_m``, ``n_turns`` and
    ``energy_j`` of all rovers together, ``time_s`` until the last one is done, and the share
    ``transit_share`` of transit in swath metres. With a battery ``n_recharges``, whose time is counted; with
    waits ``wait_s_rover_0`` and so on.

    >>> leg = Leg("swath", np.array([[0.0, 0.0], [100.0, 0.0]]))
    >>> predicted([leg], Mobility(speed_m_s=2.0))["time_s"]
    50.0
    """
    busy_s, efforts, n_recharges = [], [], 0
    for rover in sorted({leg.rover for leg in legs}):
        own = [leg.xy for leg in legs if leg.rover == rover]
        efforts.append(effort(np.vstack(own), mobility, dem, crs=crs))
        n_visits = sum(np.array_equal(xy[-1], own[0][0]) for xy in own[:-1])
        n_recharges += n_visits
        wait_s = 0.0 if waits_s is None else float(waits_s[rover])
        busy_s.append(wait_s + efforts[-1].time_s + n_visits * mobility.recharge_s)
    swath_m = _swath_length_m(legs, crs)
    length_m = sum(e.length_m for e in efforts)
    facts = {
        "length_m": length_m,
        "n_turns": float(sum(e.n_turns for e in efforts)),
        "time_s": max(busy_s),
        "energy_j": sum(e.energy_j for e in efforts),
        "transit_share": (length_m - swath_m) / swath_m if swath_m > 0.0 else 0.0,
    }
    if mobility.battery_j is not None:
        facts["n_recharges"] = float(n_recharges)
    if waits_s is not None:
        facts |= {f"wait_s_rover_{rover}": float(wait_s) for rover, wait_s in enumerate(waits_s)}
    return facts


class RoverLimits(Section):
    """Limits of the ground that a rover can drive on.

    Examples
    --------
    >>> RoverLimits(max_pitch_deg=25.0, max_roll_deg=15.0).max_slope_deg
    15.0
    """

    max_pitch_deg: float | None = Field(default=None, gt=0.0, lt=90.0)
    """Largest slope along the direction of driving [deg]; not checked when left out."""
    max_roll_deg: float | None = Field(default=None, gt=0.0, lt=90.0)
    """Largest slope across the direction of driving [deg]; not checked when left out."""
    max_roughness_m: PositiveFloat | None = None
    """Largest standard deviation of heights about the plane through 3 × 3 cells [m]; not checked when left out."""
    clearance_m: NonNegativeFloat = 0.0
    """Distance that the rover's centre keeps from every border, such as half its width [m]."""
    slope_product: ProductName | None = None
    """Class of the elevation product that slopes are read from, over a scale at which its errors tilt the ground by little
    (aster-30, srtm-90, copernicus-30, arcticdem-2, unknown); when left out, slopes are those between cells."""

    @model_validator(mode="after")
    def _product_with_limit(self) -> Self:
        if self.slope_product is not None and self.max_slope_deg is None:
            raise ValueError(
                "slope_product goes with a limit of slope; give max_pitch_deg or max_roll_deg (--max-slope) too"
            )
        return self

    @property
    def max_slope_deg(self) -> float | None:
        """Slope on which a rover may take any heading, as it must wherever it turns [deg]; None without limits."""
        return min((a for a in (self.max_pitch_deg, self.max_roll_deg) if a is not None), default=None)

    @property
    def turning_room_m(self) -> float:
        """Distance from every border that a rover needs where it turns [m]; 0 for one that pivots."""
        return 0.0

    @property
    def needs_heights(self) -> bool:
        """Whether heights of the ground are needed to find where the rover can drive."""
        return self.max_slope_deg is not None or self.max_roughness_m is not None


class Turning(Section):
    """Turning radius of a rover, and whether it may reverse.

    >>> Turning(turn_radius_m=3.0, reverse=True).turn_radius_m
    3.0
    """

    turn_radius_m: NonNegativeFloat = 0.0
    """Smallest turning radius [m]; 0 for a rover that pivots on the spot."""
    reverse: bool = False
    """Whether it may drive backwards while it turns."""


def turning_room_m(turn_radius_m: float) -> float:
    """Return how far from a border the way must run so that an arc rounds a right-angled corner: R (√2 - 1) [m]."""
    return turn_radius_m * float(np.sqrt(2.0) - 1.0)


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
        """Whether there is no constraint but to drive every swath."""
        finishes = self.fleet.return_to_start or self.fleet.end_m is not None
        return not (self.makes_round_trips or finishes or self.rover.turn_radius_m > 0.0)


def crew_in_grid_metres(crew: Crew, factor: float) -> Crew:
    """Return the rovers with lengths, speed and heights in grid metres.

    The energy for a grid metre is smaller by the factor, which a smaller mass and a higher
    speed express.
    """
    if factor == 1.0:
        return crew
    rover = in_grid_metres(crew.rover, factor)
    rover = rover.model_copy(update={"mass_kg": rover.mass_kg / factor})
    return Crew(rover, in_grid_metres(crew.fleet, factor), dem_in_grid_metres(crew.dem, factor))


def depots(area: SurveyArea, fleet: Fleet) -> FloatArray | None:
    """Return where each rover begins (K, 2) [m]; None where a single rover may begin anywhere."""
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

    Returns (K, 2): starts [m]; None where a single rover may begin anywhere.
    """
    homes = depots(area, crew.fleet)
    if homes is None and (crew.fleet.return_to_start or crew.makes_round_trips):
        raise InputError("a rover that returns to its start needs one; mark a start in the area.")
    return homes

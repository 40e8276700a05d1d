"""Steering while driving: sensed attitude, state, and the band about a swath."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
import shapely

from planners.config import SteeredConfig
from survey.core.arrays import FloatArray, IntArray
from survey.core.errors import InputError
from survey.data.dem import Dem


class Attitude(NamedTuple):
    """Attitude of N rovers, the only information on the ground that steering gets.

    Yaw, pitch, roll are rotations about up, left and forward.

    Parameters
    ----------
    roll_rad : (N,) ndarray
        Positive with the left side up.
    pitch_rad : (N,) ndarray
        Positive with the nose down.
    heading_rad : (N,) ndarray
        Counter-clockwise from east.

    Examples
    --------
    >>> uphill = Attitude(np.zeros(1), np.array([-0.1]), np.zeros(1))
    >>> uphill.slope_along(np.array([0.0, np.pi])).round(2)
    array([ 0.1, -0.1])
    """

    roll_rad: FloatArray
    pitch_rad: FloatArray
    heading_rad: FloatArray

    def slope_along(self, heading_rad: FloatArray) -> FloatArray:
        """Return the slope of the plane that the rover stands on, along other headings.

        Parameters
        ----------
        heading_rad : (..., N) ndarray
            Counter-clockwise from east.

        Returns
        -------
        (..., N) ndarray
            Rise per metre.
        """
        ahead = -np.tan(self.pitch_rad)
        left = np.tan(self.roll_rad) / np.cos(self.pitch_rad)
        turn = heading_rad - self.heading_rad
        slope: FloatArray = ahead * np.cos(turn) + left * np.sin(turn)
        return slope


AttitudeSensor = Callable[[FloatArray, FloatArray], Attitude]
"""Attitude of N rovers at the places (N, 2) [m] and headings (N,) [rad]."""


class SteeringState(NamedTuple):
    """State of steering between two steps.

    Parameters
    ----------
    swath_heading_rad : float
        Heading of the swath, counter-clockwise from east.
    mode : (N,) ndarray of int
        Rule or candidate in force for each rover.
    """

    swath_heading_rad: float
    mode: IntArray


class Steering(Protocol):
    """Protocol of steering: the next heading from the sensed attitude alone, without map or position.

    All arrays hold one value per rover, so that a thousand trials are steered together.
    The rover calls `begin` at each swath, and at every step `steer`, then `after_step`;
    ``draws`` (N,) are uniform on [0, 1) from its own generator.
    """

    @property
    def step_m(self) -> float:
        """Distance driven between two decisions [m]."""

    @property
    def band_share(self) -> float:
        """Greatest distance from the swath, in spacings."""

    def begin(self, swath_heading_rad: float, draws: FloatArray) -> SteeringState:
        """Return the state at the start of a swath.

        Parameters
        ----------
        swath_heading_rad : float
            Heading of the swath, counter-clockwise from east.
        draws : (N,) ndarray
            Uniform on [0, 1), one per rover.

        Returns
        -------
        SteeringState
            For N rovers.
        """

    def steer(self, attitude: Attitude, state: SteeringState) -> FloatArray:
        """Return the next headings.

        Parameters
        ----------
        attitude : Attitude
            Sensed attitude of N rovers.
        state : SteeringState
            As `begin` or `after_step` returned it.

        Returns
        -------
        (N,) ndarray
            Headings, counter-clockwise from east [rad].
        """

    def after_step(self, state: SteeringState, draws: FloatArray) -> SteeringState:
        """Return the state for the next step.

        Parameters
        ----------
        state : SteeringState
            The state during the step.
        draws : (N,) ndarray
            Uniform on [0, 1), one per rover; 1 changes nothing.

        Returns
        -------
        SteeringState
            The state for the next step.
        """


@dataclass(frozen=True)
class ConfiguredSteering:
    """Base of steering whose step and band are those of a configuration."""

    config: SteeredConfig

    @property
    def step_m(self) -> float:
        """Distance driven between two decisions [m]."""
        return self.config.step_m

    @property
    def band_share(self) -> float:
        """Greatest distance from the swath, in spacings."""
        return self.config.band_share


@dataclass(frozen=True)
class Band:
    """Strip about a swath that a rover may use.

    Parameters
    ----------
    axis : (2, 2) ndarray
        Both ends of the swath's line [m].
    knots_m : (K,) ndarray
        Distances along it [m].
    left_m, right_m : (K,) ndarray
        Largest deviation to both sides there [m].

    Examples
    --------
    >>> axis = np.array([[0.0, 5.0], [100.0, 5.0]])
    >>> band = Band.about(axis, 20.0, shapely.box(0.0, 0.0, 100.0, 30.0), step_m=10.0)
    >>> float(band.left_m.max()), float(band.right_m.max())
    (20.0, 5.0)
    """

    axis: FloatArray
    knots_m: FloatArray
    left_m: FloatArray
    right_m: FloatArray

    @classmethod
    def about(cls, axis: FloatArray, half_m: float, ground: Any, step_m: float) -> "Band":
        """Measure how far the free ground reaches on both sides of a swath.

        Every bound is the least one within a step before and behind, so that no step
        between two allowed places leaves the ground.

        Parameters
        ----------
        axis : (2, 2) ndarray
            Both ends of the swath's line [m].
        half_m : float
            Largest deviation [m].
        ground : shapely.Geometry
            The free ground.
        step_m : float
            Distance driven between two decisions [m].

        Returns
        -------
        Band
            With a knot at every metre or so.
        """
        length = float(np.hypot(*(axis[1] - axis[0])))
        along, left = _frame(axis)
        knots = np.linspace(0.0, length, max(int(np.ceil(length)), 2) + 1)
        # On the border itself rounding decides what is inside; a micrometre further in it does not.
        feet = axis[0] + np.clip(knots, 1e-6, length - 1e-6)[:, None] * along
        shapely.prepare(ground)
        reach = [_reach(feet, side * half_m * left, ground) for side in (1.0, -1.0)]
        window = int(np.ceil(step_m * len(knots) / length)) + 1
        left_m, right_m = (_least_within(np.minimum(r, half_m), window) for r in reach)
        return cls(axis, knots, left_m, right_m)

    @property
    def length_m(self) -> float:
        """Length of the swath's line [m]."""
        return float(self.knots_m[-1])

    @cached_property
    def heading_rad(self) -> float:
        """Heading of the swath's line."""
        along = self._frame[0]
        return float(np.arctan2(along[1], along[0]))

    @cached_property
    def _frame(self) -> tuple[FloatArray, FloatArray]:
        return _frame(self.axis)

    def next_waypoint(self, xy: FloatArray, heading_rad: FloatArray, step_m: float) -> FloatArray:
        """Return where a step ends: within the band, and at the swath's end at most.

        Parameters
        ----------
        xy : (N, 2) ndarray
            Where the rovers are [m].
        heading_rad : (N,) ndarray
            Their headings, counter-clockwise from east.
        step_m : float
            Length of the step [m].

        Returns
        -------
        (N, 2) ndarray
            Easting and northing [m].
        """
        along, left = self._frame
        u, v = (xy - self.axis[0]) @ along, (xy - self.axis[0]) @ left
        turn = heading_rad - self.heading_rad
        ahead, aside = step_m * np.cos(turn), step_m * np.sin(turn)
        share = np.minimum(1.0, (self.length_m - u) / ahead)
        u, v = np.minimum(u + share * ahead, self.length_m), v + share * aside
        v = np.clip(v, -np.interp(u, self.knots_m, self.right_m), np.interp(u, self.knots_m, self.left_m))
        waypoint: FloatArray = self.axis[0] + u[:, None] * along + v[:, None] * left
        return waypoint

    def is_at_end(self, xy: FloatArray) -> Any:
        """Return which places are at the swath's end, to a micrometre.

        Parameters
        ----------
        xy : (N, 2) ndarray
            Where the rovers are [m].

        Returns
        -------
        (N,) ndarray of bool
            Whether each rover has arrived.
        """
        return (xy - self.axis[0]) @ self._frame[0] >= self.length_m - 1e-6


def _frame(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    along = (axis[1] - axis[0]) / np.hypot(*(axis[1] - axis[0]))
    return along, np.array([-along[1], along[0]])


def _reach(feet: FloatArray, aside: FloatArray, ground: Any) -> FloatArray:
    """Return how far the ground reaches from each foot (K, 2) along a vector [m]."""
    rays = shapely.linestrings(np.stack([feet, feet + aside], axis=1))
    reach: FloatArray = shapely.length(rays)
    cut = ~shapely.covers(ground, rays)
    inside = shapely.intersection(ground, rays[cut])
    # Of several pieces the one that begins at the foot counts.
    first = shapely.get_geometry(shapely.line_merge(inside), 0)
    pieces = np.where(shapely.is_missing(first), inside, first)
    at_foot = shapely.distance(pieces, shapely.points(feet[cut])) < 1e-6
    reach[cut] = np.where(at_foot, shapely.length(pieces), 0.0)
    return reach


def _least_within(values: FloatArray, window: int) -> FloatArray:
    padded = np.pad(values, window, mode="edge")
    least: FloatArray = np.lib.stride_tricks.sliding_window_view(padded, 2 * window + 1).min(axis=1)
    return least


def attitude_sensor(dems: Dem | Sequence[Dem], base_m: float = 1.0) -> AttitudeSensor:
    """Return the attitude of rovers at rest on terrain: for simulation, one rover per DEM.

    Parameters
    ----------
    dems : Dem or sequence of Dem
        Terrain of each rover, all on one grid.
    base_m : float
        Length and width of the rover [m].

    Returns
    -------
    callable
        An `AttitudeSensor`; level where the terrain is not known.

    Raises
    ------
    InputError
        DEMs on different grids.

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 40.0, 40.0), 10.0)
    >>> sense = attitude_sensor(Dem.on(grid, np.tile(0.1 * grid.x, (5, 1))))
    >>> float(sense(np.array([[20.0, 20.0]]), np.zeros(1)).pitch_rad[0].round(3))
    -0.1
    """
    several = [dems] if isinstance(dems, Dem) else list(dems)
    first = several[0]
    if any(d.shape != first.shape or not d.transform.almost_equals(first.transform) for d in several):
        raise InputError("the DEMs lie on different grids; put all on one.")
    z = np.concatenate([dem.elevation.ravel() for dem in several])
    n_rows, n_columns = first.shape
    start = n_rows * n_columns * np.arange(len(several))

    def heights(xy: FloatArray) -> FloatArray:
        """Interpolate bilinearly at the places (..., N, 2), beyond the outer cells as at them."""
        column = np.clip((xy[..., 0] - first.transform.c) / first.transform.a - 0.5, 0.0, n_columns - 1.0)
        row = np.clip((xy[..., 1] - first.transform.f) / first.transform.e - 0.5, 0.0, n_rows - 1.0)
        i = np.minimum(row.astype(np.int64), n_rows - 2)
        j = np.minimum(column.astype(np.int64), n_columns - 2)
        s, t, cell = column - j, row - i, start + n_columns * i + j
        upper = (1.0 - s) * z[cell] + s * z[cell + 1]
        lower = (1.0 - s) * z[cell + n_columns] + s * z[cell + n_columns + 1]
        interpolated: FloatArray = (1.0 - t) * upper + t * lower
        return interpolated

    def rises(xy: FloatArray, directions_rad: FloatArray) -> FloatArray:
        """Return the rise per metre (D, N) of the rover's base in several directions (D, N)."""
        half = 0.5 * base_m * np.stack([np.cos(directions_rad), np.sin(directions_rad)], axis=-1)
        front, back = heights(np.stack([xy + half, xy - half]))
        rise = (front - back) / base_m
        return np.where(np.isnan(rise), 0.0, rise)

    def sense(xy: FloatArray, heading_rad: FloatArray) -> Attitude:
        ahead, left = rises(xy, np.stack([heading_rad, heading_rad + 0.5 * np.pi]))
        pitch = -np.arctan(ahead)
        roll = np.arctan(left * np.cos(pitch))
        return Attitude(roll, pitch, heading_rad)

    return sense

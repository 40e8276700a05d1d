"""Paths of steered patterns: at once on known terrain, or by one stretch at a time while the rover drives.

A `Band` bounds how far a rover may deviate from its swath to either side, so that no step leaves the free ground.
`rollout` drives a pattern on known terrain, for one rover or for many trials at once. `WaypointSteering` adds one
stretch at a time, from the attitude that the rover senses at its end; the same attitudes give the same path.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import shapely

from planners.capacity import require_waypoints
from planners.routes.rover import Mobility, predicted
from planners.steering import Attitude, AttitudeSensor, Steering, SteeringState
from survey import InputError, Leg, Route, SurveyArea
from survey.core import FloatArray


@dataclass(frozen=True)
class Band:
    """Strip about a swath that a rover may use.

    `axis` (2, 2): both ends of the swath's line [m]. `knots_m` (K,): distances along it [m]. `left_m`,
    `right_m` (K,): largest deviation to both sides there [m].

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

        `axis` (2, 2): both ends of the swath's line [m]. `half_m`: largest deviation [m]. `step_m`: distance
        driven between two decisions [m].
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

        `xy` (N, 2): where the rovers are [m]. `heading_rad` (N,): their headings, counter-clockwise from
        east. `step_m`: length of the step [m]. Returns (N, 2): easting and northing [m].
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

    def foot(self, xy: FloatArray) -> FloatArray:
        """Return the nearest places of the swath's line.

        `xy` (N, 2): where the rovers are [m]. Returns (N, 2): easting and northing [m].
        """
        along = self._frame[0]
        u = np.clip((xy - self.axis[0]) @ along, 0.0, self.length_m)
        feet: FloatArray = self.axis[0] + u[:, None] * along
        return feet

    def is_at_end(self, xy: FloatArray) -> Any:
        """Return which places are at the swath's end, to a micrometre.

        `xy` (N, 2): where the rovers are [m]. Returns (N,) bool: whether each rover has arrived.
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


def rollout(
    area: SurveyArea,
    route: Route,
    steering: Steering,
    sense: AttitudeSensor,
    rngs: Sequence[np.random.Generator],
    *,
    mobility: Mobility | None = None,
) -> list[Route]:
    """Drive a steered pattern once for every generator.

    `sense`: the attitude of the N rovers at places (N, 2) [m] and headings (N,) [rad], e.g. from
    `attitude_sensor`.

    >>> import planners
    >>> from planners.registry import steering_of
    >>> area = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), "EPSG:32608")
    >>> config = planners.RandomWanderConfig(swaths=2)
    >>> reference = planners.plan(area, None, config)
    >>> level = lambda xy, heading: Attitude(0.0 * heading, 0.0 * heading, heading)
    >>> routes = rollout(area, reference, steering_of(config), level, [np.random.default_rng(1)])
    >>> routes[0].length_m > reference.length_m
    True
    """
    if route.spacing_m is None or route.n_rovers > 1:
        raise InputError("a steered route needs a spacing and one rover; plan it for one rover.")
    require_waypoints(len(rngs) * route.length_m / steering.step_m, "the step", steering.step_m)
    ground = area.free.buffer(1e-6)
    shapely.prepare(ground)
    half_m = steering.band_share * route.spacing_m
    legs: list[list[Leg]] = [[] for _ in rngs]
    for leg in route.legs:
        if leg.kind == "transit":
            _add_transit(legs, leg, ground)
            continue
        band = Band.about(leg.axis, half_m, area.free, steering.step_m)
        for mine, track in zip(legs, _tracks(band, steering, sense, rngs), strict=True):
            xy = track if ground.covers(shapely.linestrings(track)) else leg.axis
            mine.append(Leg("swath", xy, leg.rover, leg.axis))
    mobility = mobility or Mobility()
    return [
        replace(route, legs=tuple(mine), prediction=predicted(mine, mobility, crs=route.crs)) for mine in legs
    ]


def _tracks(
    band: Band, steering: Steering, sense: AttitudeSensor, rngs: Sequence[np.random.Generator]
) -> list[FloatArray]:
    """Return what each rover drives (K, 2) along one swath."""
    n = len(rngs)
    here = np.tile(band.axis[0], (n, 1))
    heading = np.full(n, band.heading_rad)
    state = steering.begin(band.heading_rad, np.array([rng.random() for rng in rngs]))
    driven, n_points = [here], np.ones(n, dtype=np.int64)
    active = np.ones(n, dtype=bool)
    while active.any():
        heading = steering.steer(sense(here, heading), state)
        here = np.where(active[:, None], band.next_waypoint(here, heading, steering.step_m), here)
        driven.append(here)
        n_points += active
        active &= ~band.is_at_end(here)
        # Those that have arrived draw no more: a rover's route depends on its own generator alone.
        draws = np.array([rng.random() if on else 1.0 for rng, on in zip(rngs, active, strict=True)])
        state = steering.after_step(state, draws)
    tracks = np.stack(driven, axis=1)
    return [track[:k] for track, k in zip(tracks, n_points, strict=True)]


def _add_transit(legs: Sequence[list[Leg]], transit: Leg, ground: shapely.Geometry) -> None:
    """Lead each rover from where it is to the next swath, straight if that is free."""
    for mine in legs:
        here = mine[-1].xy[-1] if mine else transit.xy[0]
        direct = np.vstack([here, transit.xy[1:]])
        if not ground.covers(shapely.linestrings(direct)):
            direct = np.vstack([here, transit.xy])
        mine.append(Leg("transit", direct, transit.rover))


class WaypointSteering:
    """Path of a steered pattern, one stretch after another.

    The same attitudes give the same path as `rollout`, except where a swath cannot be driven as steered: there the
    rest of it follows the swath's line.

    `route`: the reference swaths of one rover, as `plan` returns them. `steering`: chooses the headings.
    `ground`: the free ground; waypoints stay on it. `rng`: source of the switching. `mobility`: for the time
    and energy of the route so far.

    >>> import planners
    >>> from planners.registry import steering_of
    >>> from survey.data.area import SurveyArea
    >>> area = SurveyArea.rectangle((0.0, 0.0, 100.0, 60.0), "EPSG:32608")
    >>> config = planners.PiecewiseContinuousConfig(swaths=2)
    >>> reference, rng = planners.plan(area, None, config), np.random.default_rng(1)
    >>> path = WaypointSteering(reference, steering_of(config), area.free, rng)
    >>> path.next_stretch(Attitude(np.zeros(1), np.zeros(1), np.zeros(1)))
    array([[10., 15.]])
    """

    def __init__(
        self,
        route: Route,
        steering: Steering,
        ground: Any,
        rng: np.random.Generator,
        mobility: Mobility | None = None,
    ) -> None:
        if route.spacing_m is None or route.n_rovers > 1:
            raise InputError("a steered route needs a spacing and one rover; plan it for one rover.")
        self._reference, self._steering, self._rng = route, steering, rng
        self._mobility = mobility or Mobility()
        self._free, self._ground = ground, ground.buffer(1e-6)
        shapely.prepare(self._ground)
        self._half_m = steering.band_share * route.spacing_m
        self._to_come = deque(route.legs)
        self._done: list[Leg] = []
        self._band: Band | None = None
        self._state: SteeringState | None = None
        self._track = [route.legs[0].xy[0]]

    @property
    def start(self) -> FloatArray:
        """Start of the route (2,) [m]."""
        start: FloatArray = self._reference.legs[0].xy[0]
        return start

    def driven(self) -> Route:
        """Return the route so far, with the swaths that it deviates from."""
        legs = list(self._done)
        if self._band is not None and len(self._track) > 1:
            legs.append(Leg("swath", np.array(self._track), axis=self._band.axis))
        prediction = predicted(legs, self._mobility, crs=self._reference.crs)
        return replace(self._reference, legs=tuple(legs), prediction=prediction)

    def next_stretch(self, attitude: Attitude) -> FloatArray | None:
        """Return the waypoints that follow the last ones, or None at the end of the route.

        Returns (K, 2): easting and northing [m].
        """
        if self._band is None:
            if not self._to_come:
                return None
            leg = self._to_come.popleft()
            if leg.kind == "transit":
                return self._transit(leg)
            self._begin(leg)
        return self._step(attitude)

    def _transit(self, leg: Leg) -> FloatArray:
        """Lead to the next swath, straight if that is free."""
        here = self._track[-1]
        way = np.vstack([here, leg.xy[1:]])
        if not self._ground.covers(shapely.linestrings(way)):
            way = np.vstack([here, leg.xy])
        self._done.append(Leg("transit", way, leg.rover))
        self._track = [way[-1]]
        return way[1:]

    def _begin(self, leg: Leg) -> None:
        """Begin a swath."""
        self._band = Band.about(leg.axis, self._half_m, self._free, self._steering.step_m)
        self._track = [self._band.axis[0]]
        self._state = self._steering.begin(self._band.heading_rad, np.array([self._rng.random()]))

    def _step(self, attitude: Attitude) -> FloatArray:
        """Choose the next waypoint of a swath."""
        band, state = self._band, self._state
        assert band is not None
        assert state is not None
        here = self._track[-1][None]
        heading = self._steering.steer(attitude, state)
        stretch = band.next_waypoint(here, heading, self._steering.step_m)
        if not self._ground.covers(shapely.linestrings(np.vstack([here, stretch]))):
            stretch = np.vstack([band.foot(here), band.axis[1:]])
        self._track += list(stretch)
        if band.is_at_end(stretch[-1:])[0]:
            self._done.append(Leg("swath", np.array(self._track), axis=band.axis))
            self._track, self._band = self._track[-1:], None
        else:
            self._state = self._steering.after_step(state, np.array([self._rng.random()]))
        return stretch

"""Steering of one rover while it drives: the path grows by one stretch at a time, from the attitude sensed there."""

from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from planners.driving.energy import Mobility, predicted
from planners.steering.attitude import Attitude
from planners.steering.band import Band
from planners.steering.steering import Steering, SteeringState
from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.route import Leg, Route


class WaypointSteering:
    """Path of a steered pattern, one stretch after another.

    The same attitudes give the same path as `rollout`, except where a swath cannot be driven as steered: there the
    rest of it follows the swath's line.

    Parameters
    ----------
    route : Route
        The reference swaths of one rover, as `plan` returns them.
    steering : Steering
        Chooses the headings.
    ground : shapely.Geometry
        The free ground; waypoints stay on it.
    rng : numpy.random.Generator
        Source of the switching.
    mobility : Mobility, optional
        For the time and energy of the route so far.

    Raises
    ------
    InputError
        A route without a spacing, or for several rovers.

    Examples
    --------
    >>> import planners
    >>> from survey.data.area import SurveyArea
    >>> area = SurveyArea.rectangle((0.0, 0.0, 100.0, 60.0), "EPSG:32608")
    >>> config = planners.PiecewiseContinuousConfig(swaths=2)
    >>> reference, rng = planners.plan(area, None, config), np.random.default_rng(1)
    >>> path = WaypointSteering(reference, planners.steering_of(config), area.free, rng)
    >>> path.next_stretch(planners.Attitude(np.zeros(1), np.zeros(1), np.zeros(1)))
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
        """Return the route so far, with the swaths that it deviates from.

        Returns
        -------
        Route
            Its last leg ends at the last waypoint that was chosen.
        """
        legs = list(self._done)
        if self._band is not None and len(self._track) > 1:
            legs.append(Leg("swath", np.array(self._track), axis=self._band.axis))
        prediction = predicted(legs, self._mobility, crs=self._reference.crs)
        return replace(self._reference, legs=tuple(legs), prediction=prediction)

    def next_stretch(self, attitude: Attitude) -> FloatArray | None:
        """Return the waypoints that follow the last ones, or None at the end of the route.

        Parameters
        ----------
        attitude : Attitude
            Sensed attitude of the rover at the last waypoint.

        Returns
        -------
        (K, 2) ndarray or None
            Easting and northing [m].
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

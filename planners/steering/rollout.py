"""Paths of a steered pattern on given terrain, for one rover or for many trials at once."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely

from planners.capacity import require_waypoints
from planners.driving.energy import Mobility, predicted
from planners.steering.attitude import AttitudeSensor
from planners.steering.band import Band
from planners.steering.steering import Steering
from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.route import Leg, Route


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

    Parameters
    ----------
    area : SurveyArea
        The free ground; no driven metre leaves it.
    route : Route
        The reference swaths, as `plan` returns them.
    steering : Steering
        Chooses the headings.
    sense : callable
        The attitude of the N rovers at places (N, 2) [m] and headings (N,) [rad], e.g.
        from `attitude_sensor`.
    rngs : sequence of numpy.random.Generator
        One per rover; a rover's route depends on its own alone.
    mobility : Mobility, optional
        For the prediction of time and energy.

    Returns
    -------
    list of Route
        The driven path of each rover; `Leg.axis` holds the swath that was deviated from.

    Raises
    ------
    InputError
        A route without a spacing, or for several rovers at once.

    Examples
    --------
    >>> import planners
    >>> area = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), "EPSG:32608")
    >>> config = planners.RandomWanderConfig(swaths=2)
    >>> reference = planners.plan(area, None, config)
    >>> level = lambda xy, heading: planners.Attitude(0.0 * heading, 0.0 * heading, heading)
    >>> routes = rollout(area, reference, planners.steering_of(config), level, [np.random.default_rng(1)])
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

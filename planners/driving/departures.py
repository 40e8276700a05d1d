"""Departure times of rovers that keep a distance from one another."""

from collections.abc import Sequence

import numpy as np

from planners.capacity import require_waypoints
from planners.driving.energy import Mobility
from survey.core.arrays import FloatArray
from survey.core.errors import ConfigError, InputError
from survey.data.route import Leg


def departures(legs: Sequence[Leg], mobility: Mobility, separation_m: float) -> FloatArray:
    """Return how long each rover waits at its depot so that rovers keep apart on the way [s].

    Rovers depart in the order of their numbers, each as early, in steps of ten seconds, as
    it stays `separation_m` away from all before it. While one of two rovers is within twice that
    distance of its own depot, they may be nearer, so that rovers can share a depot.

    Parameters
    ----------
    legs : sequence of Leg
        Of all rovers.
    mobility : Mobility
        Their speed; turns on the spot are not timed.
    separation_m : float
        Smallest distance between two rovers [m].

    Returns
    -------
    (K,) ndarray
        Waiting time of each rover [s].

    Raises
    ------
    InputError
        A rover that would have to wait until another one has finished.
    """
    if not separation_m > 0.0:
        raise ConfigError(f"the separation is {separation_m} m; it must be greater than 0.")
    step_s = max(0.25 * separation_m / mobility.speed_m_s, 1.0)
    step_m = step_s * mobility.speed_m_s
    require_waypoints(sum(leg.length_m for leg in legs) / step_m, "the separation", 4.0 * step_m)
    tracks = [_track(legs, rover, mobility, step_s) for rover in range(max(leg.rover for leg in legs) + 1)]
    longest_s = step_s * max(len(track) for track in tracks)
    waits = np.zeros(len(tracks))
    for rover, track in enumerate(tracks):
        while any(
            _too_near(track, tracks[k], round((waits[rover] - waits[k]) / step_s), separation_m)
            for k in range(rover)
        ):
            waits[rover] += max(10.0, step_s)
            if waits[rover] > longest_s:
                raise InputError(
                    f"rover {rover + 1} cannot keep {separation_m:g} m from the others without waiting for their end; separate the depots."
                )
    return waits


def _track(legs: Sequence[Leg], rover: int, mobility: Mobility, step_s: float) -> FloatArray:
    """Return where a rover is every `step_s` (N, 2); empty for one that stays at home."""
    own = [leg.xy for leg in legs if leg.rover == rover]
    if not own:
        return np.zeros((0, 2))
    xy = np.vstack(own)
    at_s = np.r_[0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T))] / mobility.speed_m_s
    times = np.arange(0.0, at_s[-1] + step_s, step_s)
    return np.column_stack([np.interp(times, at_s, xy[:, k]) for k in (0, 1)])


def _too_near(a: FloatArray, b: FloatArray, shift: int, separation_m: float) -> bool:
    """Return whether two rovers, the first departing `shift` steps later, meet away from their depots."""
    first, last = max(shift, 0), min(len(a) + shift, len(b))
    if last <= first:
        return False
    here, there = a[first - shift : last - shift], b[first:last]
    is_near = np.hypot(*(here - there).T) < separation_m
    at_home = np.minimum(np.hypot(*(here - a[0]).T), np.hypot(*(there - b[0]).T)) < 2.0 * separation_m
    return bool((is_near & ~at_home).any())

"""Changes of planned routes: replanning of a fleet after the loss of a rover, and a way home.

After a loss the other rovers share the swaths that are left.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from shapely import LineString, Point

from planners.routes.fleet import share
from planners.routes.rover import Rover
from planners.routes.shortest_paths import FreeGround
from planners.routes.traversability import on_free_ground
from survey import ConfigError, Dem, InputError, Leg, Route, SurveyArea
from survey.core import FloatArray

_SHORTEST_M = 1.0
"""Pieces of swaths shorter than this are not driven again [m]."""


class Loss(NamedTuple):
    """Loss of a rover: its number, counted from 0, time since the departure [s], and progress along its path [m].

    `rover`: number of the rover, counted from 0. `time_s`: time since the departure [s]. `progress_m`:
    distance along the rover's path, in the CRS of the route [m].
    """

    rover: int
    time_s: float
    progress_m: float


def with_way_home(route: Route, area: SurveyArea) -> Route:
    """Append the shortest path on free ground from the end of a route back to its start."""
    if route.n_rovers > 1:
        raise InputError("aids.way_home is for one rover; leave it out, or set fleet.rovers = 1.")
    start, end = route.legs[0].xy[0], route.legs[-1].xy[-1]
    way = FreeGround(area.free).way(end, start)
    return on_free_ground(replace(route, legs=(*route.legs, Leg("transit", way))), area.free)


def cut_short(route: Route, loss: Loss) -> Route:
    """Return a route in which the path of a lost rover ends where it was lost."""
    done, _ = _split(_legs_of(route.legs, loss.rover), loss.progress_m)
    legs = [leg for leg in route.legs if leg.rover != loss.rover]
    return replace(route, legs=tuple(sorted([*legs, *done], key=lambda leg: leg.rover)), prediction={})


def replanned(
    route: Route,
    loss: Loss,
    ground: FreeGround,
    *,
    rover: Rover,
    dem: Dem | None = None,
    lost: Collection[int] = (),
) -> Route:
    """Share the swaths that are left after the loss of a rover among the others.

    Every other rover finishes the leg that it is on at that time, drives its share of all swaths that no rover has
    driven (`planners.routes.fleet.share`), and returns to where it began.

    Rovers are assumed to drive at their speed without a stop. A rover that drives slower or stops has not come as far
    as this at the time of the loss, so that none is asked to turn back.
    """
    if rover.battery_j is not None:
        raise ConfigError("a fleet with batteries is not replanned; leave out rover.battery_j.")
    crew = [k for k in range(route.n_rovers) if k not in lost and k != loss.rover]
    left = list(remaining_swaths(route, loss))
    cut = cut_short(route, loss)
    done: list[Leg] = []
    for k in crew:
        driven, rest = _at_the_end_of_a_leg(_legs_of(cut.legs, k), loss.time_s * rover.speed_m_s)
        done += driven
        left += [leg for leg in rest if leg.kind == "swath"]
    if not crew or not left:
        return cut
    homes = np.array([cut.path(k)[0] for k in crew])
    here = np.array([_legs_of(done, k)[-1].xy[-1] for k in crew])
    added = _shared(left, ground, (here, homes), rover, dem)
    ways = _ways_home(added, here, homes, ground)
    others = [leg for leg in cut.legs if leg.rover not in crew]
    numbered = [_of_rover(leg, crew[leg.rover]) for leg in [*added, *ways]]
    on_free_ground(replace(cut, legs=tuple(numbered)), ground.polygon)
    legs = sorted([*others, *done, *numbered], key=lambda leg: leg.rover)
    return replace(cut, legs=tuple(legs))


def _shared(
    left: Sequence[Leg],
    ground: FreeGround,
    trips: tuple[FloatArray, FloatArray],
    rover: Rover,
    dem: Dem | None,
) -> tuple[Leg, ...]:
    """Share swaths among rovers with trips from (K, 2) to (K, 2); legs carry the index of the trip as their rover."""
    return share(
        [leg.xy for leg in left],
        ground,
        trips[0],
        finishes=trips[1],
        mobility=rover,
        dem=dem,
        axes=[leg.axis for leg in left],
        turning=rover,
    )


def rest_of(route: Route, at: FloatArray) -> Route:
    """Return what is left of a route of one rover that is at a place (2,) [m], from the nearest place of the route on."""
    if route.n_rovers > 1:
        raise InputError(f"the route is of {route.n_rovers} rovers; give the route of one.")
    path = LineString(route.path())
    _, left = _split(route.legs, min(path.project(Point(at)), path.length - _SHORTEST_M))
    first = replace(left[0], xy=np.vstack([at, left[0].xy[1:]]), axis=None)
    return replace(route, legs=(first, *left[1:]), prediction={})


def remaining_swaths(route: Route, loss: Loss) -> tuple[Leg, ...]:
    """Return the swaths that a lost rover leaves, its part of a swath among them."""
    _, left = _split(_legs_of(route.legs, loss.rover), loss.progress_m)
    return tuple(leg for leg in left if leg.kind == "swath" and leg.length_m >= _SHORTEST_M)


def _legs_of(legs: Sequence[Leg], rover: int) -> list[Leg]:
    return [leg for leg in legs if leg.rover == rover]


def _of_rover(leg: Leg, rover: int) -> Leg:
    return Leg(leg.kind, leg.xy, rover, leg.axis)


def _at_the_end_of_a_leg(legs: Sequence[Leg], distance_m: float) -> tuple[list[Leg], list[Leg]]:
    """Divide legs behind the one that is driven at a distance from the start."""
    ends = np.cumsum([leg.length_m for leg in legs])
    n = min(int(np.searchsorted(ends, distance_m)) + 1, len(legs))
    return list(legs[:n]), list(legs[n:])


def _split(legs: Sequence[Leg], distance_m: float) -> tuple[list[Leg], list[Leg]]:
    """Divide legs at a distance from the start; the leg that is driven there is cut in two."""
    done, left = _at_the_end_of_a_leg(legs, distance_m)
    here_m = distance_m - sum(leg.length_m for leg in done[:-1])
    last = done[-1]
    if here_m >= last.length_m:
        return done, left
    before, after = _cut(last.xy, here_m)
    first = [replace(last, xy=before)] if here_m > 0.0 else []
    return [*done[:-1], *first], [replace(last, xy=after), *left]


def _cut(xy: FloatArray, at_m: float) -> tuple[FloatArray, FloatArray]:
    """Cut a polyline (N, 2) at a distance from its start."""
    ends = np.r_[0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T))]
    here = np.column_stack([np.interp([at_m], ends, axis) for axis in xy.T])
    return np.vstack([xy[ends < at_m], here]), np.vstack([here, xy[ends > at_m]])


def _ways_home(added: Sequence[Leg], here: FloatArray, homes: FloatArray, ground: FreeGround) -> list[Leg]:
    """Return the transits home of rovers that are given no swath."""
    busy = {leg.rover for leg in added}
    return [
        Leg("transit", ground.way(place, home), k)
        for k, (place, home) in enumerate(zip(here, homes, strict=True))
        if k not in busy and np.hypot(*(place - home)) > 0.0
    ]

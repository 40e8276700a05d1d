"""From swaths to a route: how they are joined, and what driving them takes."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import shapely

from planners.swaths import Swath
from survey.area import SurveyArea
from survey.errors import InputError
from survey.route import Leg, Route

_TURN_RAD = np.radians(30.0)
"""A change of heading above this at a waypoint counts as a turn."""


def connect(swaths: Sequence[Swath], area: SurveyArea) -> tuple[Leg, ...]:
    """Join swaths, given in boustrophedon order, by transits on free ground.

    Raises
    ------
    InputError
        A transit would leave the free ground.
    """
    legs: list[Leg] = []
    here = area.starts[0] if len(area.starts) else swaths[0].xy[0]
    for swath in swaths:
        if np.hypot(*(swath.xy[0] - here)) > 0.0:
            legs.append(Leg("transit", np.array([here, swath.xy[0]])))
        legs.append(Leg("swath", swath.xy, axis=swath.axis))
        here = swath.xy[-1]
    # Ends on slanted borders lie a rounding error, far below a micrometre, on either side of them.
    ground = area.free.buffer(1e-6)
    for leg in legs:
        if not ground.covers(shapely.linestrings(leg.xy)):
            raise InputError(
                f"the straight way from ({leg.xy[0, 0]:.1f}, {leg.xy[0, 1]:.1f}) to ({leg.xy[1, 0]:.1f}, "
                f"{leg.xy[1, 1]:.1f}) leaves the free ground; plan a convex part of the area."
            )
    return tuple(legs)


def driven(legs: Sequence[Leg], speed_m_s: float) -> Mapping[str, float]:
    """Return length, number of turns and driving time of one rover's legs, turns on the spot not counted."""
    route_xy = np.vstack([leg.xy for leg in legs])
    moves = np.diff(route_xy, axis=0)
    moves = moves[np.hypot(*moves.T) > 0.0]
    heading = np.arctan2(moves[:, 1], moves[:, 0])
    change = np.abs([(b - a + np.pi) % (2.0 * np.pi) - np.pi for a, b in pairwise(heading)])
    length_m = float(sum(leg.length_m for leg in legs))
    return {
        "length_m": length_m,
        "n_turns": float(np.sum(change > _TURN_RAD)),
        "time_s": length_m / speed_m_s,
    }


def route_of(
    swaths: Sequence[Swath], area: SurveyArea, pattern: str, spacing_m: float, *, speed_m_s: float
) -> Route:
    """Return the route along swaths given in boustrophedon order."""
    legs = connect(swaths, area)
    return Route(legs, area.crs, pattern, spacing_m, driven(legs, speed_m_s))

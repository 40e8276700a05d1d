"""Limits of autopilots for missions and fences, checked before anything is sent."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from live.link.vehicle import ARDUPILOT, PX4
from live.mission.items import FENCE, KIND_NAMES, MISSION, LinkItem
from survey.core.errors import InputError

_MOST_ON_LINK = 65_535
_FRAMES = (0, 2, 3, 5, 6, 10, 11)


class Limits(NamedTuple):
    """Items and corners that an autopilot stores with the defaults of its makers; boards may hold more."""

    items: int
    fence_corners: int


_FEWER = {
    MISSION: "plan fewer or straighter swaths or divide the route",
    FENCE: "give the outline of the area and its no-go zones fewer corners",
}
_LIMITS = {ARDUPILOT: Limits(724, 70), PX4: Limits(2000, 64)}


def limits_of(autopilot: int) -> Limits:
    """Return the limits of an autopilot by its value of MAV_AUTOPILOT; those of the protocol where it is not known.

    Examples
    --------
    >>> limits_of(12).items
    2000
    """
    return _LIMITS.get(autopilot, Limits(_MOST_ON_LINK, _MOST_ON_LINK))


def n_home_items(autopilot: int) -> int:
    """Return how many items of a mission are the vehicle's home, which it replaces by its own: 1 of ArduPilot.

    Examples
    --------
    >>> n_home_items(3), n_home_items(12)
    (1, 0)
    """
    return int(autopilot == ARDUPILOT)


def require_storable(items: Sequence[LinkItem], kind: int, most: int, n_home: int = 0) -> None:
    """Refuse items that an autopilot cannot hold.

    Parameters
    ----------
    items : sequence of LinkItem
        Of a mission or a fence.
    kind : int
        `MISSION` or `FENCE`.
    most : int
        Largest number of items.
    n_home : int
        How many of the first items are the home position, which may be the first waypoint.

    Raises
    ------
    InputError
        Too many items, a frame that rovers do not know, a latitude or longitude out of range, or neighbouring
        waypoints that are one place on the link.
    """
    name = KIND_NAMES[kind]
    if len(items) > most:
        raise InputError(
            f"the {name} has {len(items)} items, and this autopilot holds {most}; {_FEWER[kind]}, or name with "
            "--most-items what the board holds."
        )
    for index, item in enumerate(items):
        _require_sound(index, item, name)
    if kind == MISSION:
        _require_apart(items[n_home:])


def _require_sound(index: int, item: LinkItem, name: str) -> None:
    """Refuse a frame or a place that no autopilot takes."""
    if item.frame not in _FRAMES:
        raise InputError(
            f"item {index} of the {name} has the altitude frame {item.frame}; one of {', '.join(map(str, _FRAMES))} was "
            "expected (above sea level, relative to home, above terrain)."
        )
    latitude, longitude = item.degrees
    if item.is_waypoint and not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
        raise InputError(
            f"item {index} of the {name} lies at {latitude:g}, {longitude:g}; degrees within 90 and 180 were expected."
        )


def _require_apart(items: Sequence[LinkItem]) -> None:
    """Refuse neighbouring waypoints that the resolution of the link makes one."""
    for index, (one, other) in enumerate(pairwise(items), start=1):
        if one.is_waypoint and other.is_waypoint and (one.x, one.y, one.z) == (other.x, other.y, other.z):
            raise InputError(
                f"waypoints {index - 1} and {index} are one place at the resolution of the link, 1e-7 deg or 11 mm; "
                "leave one of them out."
            )

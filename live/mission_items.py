"""Items of missions and fences as MAVLink carries them (mavlink.io, "Mission Protocol", MISSION_ITEM_INT).

`LinkItem` is one item with its place in units of 1e-7 degrees; `first_difference` compares what was sent with what was
read back. `AutopilotMission` holds the mission and the fence of one rover, from a route, from a ``.plan`` of
QGroundControl or from a file ``QGC WPL 110``. `require_storable` refuses what an autopilot cannot hold (`Limits`), before
anything is sent.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from live.link import ARDUPILOT, PX4
from survey import InputError, Route
from survey.interchange.fences import LIMITS, FencePart, Limits
from survey.interchange.mission_files import (
    GLOBAL_FRAMES,
    PLACES,
    read_mission_file,
    require_own_fence,
    stops_of,
)
from survey.interchange.missions import NAV_WAYPOINT, Mission, MissionItem, Surroundings, mission_of

MISSION, FENCE = 0, 1
"""Values of MAV_MISSION_TYPE."""
KIND_NAMES = {MISSION: "mission", FENCE: "fence"}
PER_DEGREE = 1e7
"""Steps of latitude and longitude per degree; one is 11 mm along a meridian."""
INCLUSION_POLYGON, EXCLUSION_POLYGON, INCLUSION_CIRCLE, EXCLUSION_CIRCLE = 5001, 5002, 5003, 5004
# Autopilots store heights to the centimetre.
_HEIGHT_STEP_M = 0.01


class LinkItem(NamedTuple):
    """One item on the link.

    `command`, `frame`: MAV_CMD and MAV_FRAME. `params`: parameters 1 to 4 in single precision; NaN leaves a
    value to the vehicle. `x`, `y`: latitude and longitude [1e-7 deg] in global frames, else parameters 5 and
    6. `z`: height in the frame [m], in single precision.
    """

    command: int
    frame: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float

    @classmethod
    def of(cls, item: MissionItem) -> "LinkItem":
        """Round an item of a mission to what the link carries.

        >>> LinkItem.of(MissionItem(16, 3, (0, 0, 0, None, 60.12345678, -139.5, 2.5)))[3:]
        (601234568, -1395000000, 2.5)
        """
        first = [float("nan") if value is None else _single(value) for value in item.params[:4]]
        scale = PER_DEGREE if item.frame in GLOBAL_FRAMES else 1.0
        # Nine decimals first, as in files of missions, so that both round alike.
        x, y = (round(round(value or 0.0, 9) * scale) for value in item.params[4:6])
        return cls(
            item.command,
            item.frame,
            (first[0], first[1], first[2], first[3]),
            x,
            y,
            _single(item.params[6] or 0.0),
        )

    @property
    def as_mission_item(self) -> MissionItem:
        """Item with its place in degrees."""
        place = self.degrees if self.frame in GLOBAL_FRAMES else (self.x, self.y)
        return MissionItem(self.command, self.frame, (*self.params, *place, self.z))

    @classmethod
    def received(cls, message: Any) -> "LinkItem":
        """Read an item from a message MISSION_ITEM_INT."""
        params = (message.param1, message.param2, message.param3, message.param4)
        return cls(message.command, message.frame, params, message.x, message.y, message.z)

    @property
    def is_waypoint(self) -> bool:
        """Whether it leads to a place."""
        return self.command in PLACES and self.frame in GLOBAL_FRAMES

    @property
    def degrees(self) -> tuple[float, float]:
        """Latitude and longitude [deg]."""
        return self.x / PER_DEGREE, self.y / PER_DEGREE

    def agrees_with(self, other: "LinkItem") -> bool:
        """Return whether a vehicle that reports the other item holds this one.

        Commands, frames and places have to be equal, heights to the centimetre. A parameter that is left to the
        vehicle may come back as 0.

        >>> item = LinkItem(16, 3, (0.0, 0.0, 0.0, float("nan")), 1, 2, 0.5)
        >>> item.agrees_with(item._replace(params=(0.0, 0.0, 0.0, 0.0))), item.agrees_with(item._replace(x=3))
        (True, False)
        """
        same_place = (self.command, self.frame, self.x, self.y) == (
            other.command,
            other.frame,
            other.x,
            other.y,
        )
        if not same_place or not abs(self.z - other.z) < _HEIGHT_STEP_M:
            return False
        return bool(np.array_equal(np.nan_to_num(self.params), np.nan_to_num(other.params)))


def first_difference(sent: Sequence[LinkItem], read: Sequence[LinkItem]) -> int | None:
    """Return the index of the first item that differs, or None."""
    for index, (one, other) in enumerate(zip(sent, read, strict=False)):
        if not one.agrees_with(other):
            return index
    return None if len(sent) == len(read) else min(len(sent), len(read))


def _single(value: float) -> float:
    return float(np.float32(value))


_MOST_ON_LINK = 65_535
_MOST_STEPS = 2**31 - 1
_FRAMES = (*GLOBAL_FRAMES, 2)
_FEWER = {
    MISSION: "plan fewer or straighter swaths or divide the route",
    FENCE: "give the outline of the area and its no-go zones fewer corners",
}
_LIMITS = {ARDUPILOT: LIMITS["ardupilot"], PX4: LIMITS["px4"]}


def limits_of(autopilot: int) -> Limits:
    """Return the limits of an autopilot by its value of MAV_AUTOPILOT; those of the protocol where it is not known.

    >>> limits_of(12).items
    2000
    """
    return _LIMITS.get(autopilot, Limits(_MOST_ON_LINK, _MOST_ON_LINK))


def n_home_items(autopilot: int) -> int:
    """Return how many items of a mission are the vehicle's home, which it replaces by its own: 1 of ArduPilot.

    >>> n_home_items(3), n_home_items(12)
    (1, 0)
    """
    return int(autopilot == ARDUPILOT)


def require_storable(items: Sequence[LinkItem], kind: int, most: int, n_home: int = 0) -> None:
    """Refuse items that an autopilot cannot hold."""
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
            f"item {index} of the {name} has the altitude frame {item.frame}; one of {', '.join(map(str, sorted(_FRAMES)))} was "
            "expected (above sea level, relative to home, above terrain)."
        )
    if max(abs(item.x), abs(item.y)) > _MOST_STEPS:
        raise InputError(
            f"item {index} of the {name} (command {item.command}) has the parameters {item.x}, {item.y} where the link holds "
            f"at most {_MOST_STEPS}; give it a place in degrees, or delete it."
        )
    latitude, longitude = item.degrees
    if item.is_waypoint and not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
        raise InputError(
            f"item {index} of the {name} lies at {latitude:g}, {longitude:g}; degrees within 90 and 180 were expected."
        )


def _require_apart(items: Sequence[LinkItem]) -> None:
    """Refuse neighbouring waypoints that the resolution of the link makes one."""
    for index, (one, other) in enumerate(pairwise(items), start=1):
        if one.is_waypoint and (one.command, one.x, one.y, one.z) == (
            other.command, other.x, other.y, other.z,
        ):  # fmt: skip
            raise InputError(
                f"waypoints {index - 1} and {index} are one place at the resolution of the link, 1e-7 deg or 11 mm; "
                "leave one of them out."
            )


_FRAME_GLOBAL = 0


@dataclass(frozen=True)
class AutopilotMission:
    """Items of a mission and of a fence, in degrees.

    `items`: without the home position. `fence`: corners of polygons and circles; empty where no area is
    known. `notes`: what a file holds beside them and what was done to the fence.
    """

    items: tuple[MissionItem, ...]
    fence: tuple[MissionItem, ...] = ()
    notes: tuple[str, ...] = ()

    @classmethod
    def of_route(cls, route: Route, around: Surroundings) -> Self:
        """Return the mission that ``firnline export ROUTE mission.plan`` writes."""
        around.check(route)
        return cls._of(mission_of(route, Path("the mission"), around))

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a ``.plan`` of QGroundControl or a mission ``QGC WPL 110`` as it is; it has to stay within its fence."""
        mission, where = read_mission_file(path), f"the mission {path}"
        if not stops_of(mission, where):
            raise InputError(
                f"{where} has {len(mission.items)} items and no waypoint; draw a route in it and save it again."
            )
        curves = require_own_fence(mission, where)
        found = cls._of(mission)
        return replace(found, notes=(*found.notes, *curves))

    @classmethod
    def _of(cls, mission: Mission) -> Self:
        fence = tuple(item for part in mission.fence for item in _fence_items(part))
        notes = [f"not sent: {', '.join(mission.left_out)}."] if mission.left_out else []
        return cls(mission.items, fence, (*notes, mission.note) if mission.note else tuple(notes))

    def link_items(self, autopilot: int) -> list[LinkItem]:
        """Return the items for a vehicle; those of ArduPilot begin with the home position, which is no waypoint."""
        items = [LinkItem.of(item) for item in self.items]
        first = next((item for item in items if item.is_waypoint), None)
        if autopilot != ARDUPILOT or first is None:
            return items
        return [LinkItem(NAV_WAYPOINT, _FRAME_GLOBAL, (0.0, 0.0, 0.0, 0.0), first.x, first.y, 0.0), *items]

    @property
    def fence_items(self) -> list[LinkItem]:
        """Items of the fence for the link."""
        return [LinkItem.of(item) for item in self.fence]


def _fence_items(part: FencePart) -> list[MissionItem]:
    """Return a circle, or the corners of a polygon, each with their number."""
    is_circle = part.radius_m > 0.0
    polygon, circle = (
        (INCLUSION_POLYGON, INCLUSION_CIRCLE) if part.is_inclusion else (EXCLUSION_POLYGON, EXCLUSION_CIRCLE)
    )
    command, value = (circle, part.radius_m) if is_circle else (polygon, len(part.corners))
    return [
        MissionItem(command, _FRAME_GLOBAL, (value, 0, 0, 0, latitude, longitude, 0))
        for latitude, longitude in part.corners
    ]

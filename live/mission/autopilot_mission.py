"""Mission and fence for one rover, from a route or from a file of a ground station."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from live.link.vehicle import ARDUPILOT
from live.mission.items import (
    EXCLUSION_CIRCLE,
    EXCLUSION_POLYGON,
    INCLUSION_CIRCLE,
    INCLUSION_POLYGON,
    LinkItem,
)
from survey.core.errors import InputError
from survey.data.route import Route
from survey.interchange.missions import NAV_WAYPOINT, MissionItem, Surroundings, fence_polygons, mission_items

_FRAME_GLOBAL = 0
_COLUMNS_OF_WPL = 12


@dataclass(frozen=True)
class AutopilotMission:
    """Items of a mission and of a fence, in degrees.

    Parameters
    ----------
    items : tuple of MissionItem
        Without the home position.
    fence : tuple of MissionItem
        Corners of polygons and circles; empty where no area is known.
    """

    items: tuple[MissionItem, ...]
    fence: tuple[MissionItem, ...] = ()

    @classmethod
    def of_route(cls, route: Route, around: Surroundings) -> "AutopilotMission":
        """Return the mission that ``firnline export ROUTE mission.plan`` writes.

        Parameters
        ----------
        route : Route
            Of one rover.
        around : Surroundings
            Area, terrain, speed and return.

        Returns
        -------
        AutopilotMission
            With heights relative to the start.

        Raises
        ------
        InputError
            Several rovers, or surroundings that do not belong to the route.
        """
        around.check(route)
        polygons = [_polygon(fence["polygon"], fence["inclusion"]) for fence in fence_polygons(route, around)]
        return cls(tuple(mission_items(route, around)), tuple(item for fence in polygons for item in fence))

    @classmethod
    def read(cls, path: Path) -> "AutopilotMission":
        """Read a ``.plan`` of QGroundControl or a mission ``QGC WPL 110`` as it is.

        Parameters
        ----------
        path : pathlib.Path
            Ends in ``.plan`` or ``.waypoints``.

        Returns
        -------
        AutopilotMission
            With every command of the file.

        Raises
        ------
        InputError
            A file that is missing or damaged.
        """
        reader = _read_wpl if path.suffix.lower() == ".waypoints" else _read_qgc_plan
        try:
            mission = reader(path.read_text(encoding="utf-8"))
        except (ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
            raise InputError(
                f"the mission {path} is damaged or not of the format of its ending ({error}); save it again."
            ) from error
        if not any(LinkItem.of(item).is_waypoint for item in mission.items):
            raise InputError(
                f"the mission {path} has {len(mission.items)} items and no waypoint; draw a route in it and save it again."
            )
        return mission

    def link_items(self, autopilot: int) -> list[LinkItem]:
        """Return the items for a vehicle; those of ArduPilot begin with the home position, which is no waypoint.

        Parameters
        ----------
        autopilot : int
            MAV_AUTOPILOT of its heartbeat.

        Returns
        -------
        list of LinkItem
            To be sent in this order.
        """
        items = [LinkItem.of(item) for item in self.items]
        first = next((item for item in items if item.is_waypoint), None)
        if autopilot != ARDUPILOT or first is None:
            return items
        return [LinkItem(NAV_WAYPOINT, _FRAME_GLOBAL, (0.0, 0.0, 0.0, 0.0), first.x, first.y, 0.0), *items]

    @property
    def fence_items(self) -> list[LinkItem]:
        """Items of the fence for the link."""
        return [LinkItem.of(item) for item in self.fence]


def _polygon(corners: list[list[float]], is_inclusion: bool) -> list[MissionItem]:
    """Return the corners (latitude, longitude) [deg] of one polygon as items, each with their number."""
    command = INCLUSION_POLYGON if is_inclusion else EXCLUSION_POLYGON
    return [
        MissionItem(command, _FRAME_GLOBAL, (len(corners), 0, 0, 0, latitude, longitude, 0))
        for latitude, longitude in corners
    ]


def _circle(circle: dict[str, Any]) -> MissionItem:
    """Return a circle of a plan file as an item."""
    command = INCLUSION_CIRCLE if circle["inclusion"] else EXCLUSION_CIRCLE
    latitude, longitude = circle["circle"]["center"]
    return MissionItem(command, _FRAME_GLOBAL, (circle["circle"]["radius"], 0, 0, 0, latitude, longitude, 0))


def _read_qgc_plan(text: str) -> AutopilotMission:
    plan = json.loads(text)
    fence = plan.get("geoFence", {})
    polygons = [_polygon(one["polygon"], one["inclusion"]) for one in fence.get("polygons", [])]
    circles = [_circle(one) for one in fence.get("circles", [])]
    items = _simple_items(plan["mission"]["items"])
    return AutopilotMission(tuple(items), tuple([item for one in polygons for item in one] + circles))


def _simple_items(items: list[dict[str, Any]]) -> list[MissionItem]:
    """Return the commands, those inside survey patterns included."""
    found: list[MissionItem] = []
    for item in items:
        if "TransectStyleComplexItem" in item:
            found += _simple_items(item["TransectStyleComplexItem"]["Items"])
        else:
            found.append(MissionItem(item["command"], item["frame"], tuple(item["params"])))
    return found


def _read_wpl(text: str) -> AutopilotMission:
    """Read the lines after the home position."""
    first, *rows = text.splitlines()
    if first.split() != ["QGC", "WPL", "110"]:
        raise ValueError(f"begins with {first[:40]!r}, not with QGC WPL 110")
    cells = np.array([row.split() for row in rows if row.strip()], dtype=np.float64)
    if cells.ndim != 2 or cells.shape[1] != _COLUMNS_OF_WPL:
        raise ValueError("rows of 12 numbers were expected")
    return AutopilotMission(
        tuple(MissionItem(int(row[3]), int(row[2]), tuple(row[4:11].tolist())) for row in cells[1:])
    )

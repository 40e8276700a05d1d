"""Autopilot missions: QGroundControl's plan file and the plain-text mission ``QGC WPL 110``.

`Surroundings` holds what an exported route takes along: area, terrain, autopilot, speed and the return to launch. The area
becomes the fence. `mission_of` makes the mission of a route for files and for the link, and compares its path with its own
fence. Formats: docs.qgroundcontrol.com, "Plan File Format"; mavlink.io, "File Formats". A mission holds one vehicle.
"""

import json
import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely import LineString

from survey.core import FloatArray, InputError, same_crs, write_text
from survey.core.crs import ELLIPSOIDAL
from survey.core.transformation import WGS84, transformed
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.interchange.fences import (
    FENCE_MARGIN_M,
    LIMITS,
    NAMES,
    Autopilot,
    FencePart,
    area_fence,
    fence_outline,
    no_go_ground,
    require_clear,
    require_inside,
)
from survey.io.vector import require_transformation

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Surroundings:
    """What is written beside the waypoints of a route.

    Parameters
    ----------
    area : SurveyArea, optional
        Becomes the fence of missions, and polygons of KML.
    terrain : Dem, optional
        Heights of waypoints and of the home position.
    autopilot : {"ardupilot", "px4"}
        For missions.
    speed_m_s : float, optional
        Speed that a mission sets [m/s]; by default none, and the plan states the mean one.
    returns : bool
        Whether a mission ends with a return to launch, straight to the start.
    most_corners : int, optional
        Corners of a fence that the board holds; by default those of the autopilot.

    Raises
    ------
    InputError
        A speed that is not greater than 0.
    """

    area: SurveyArea | None = None
    terrain: Dem | None = None
    autopilot: Autopilot = "px4"
    speed_m_s: float | None = None
    returns: bool = False
    most_corners: int | None = None

    def __post_init__(self) -> None:
        if self.speed_m_s is not None and not 0.0 < self.speed_m_s < 100.0:
            raise InputError(
                f"the speed is {self.speed_m_s:g} m/s; above 0 and below 100 was expected, correct --speed."
            )

    def check(self, route: Route) -> None:
        """Refuse an area or a terrain that does not belong to a route.

        Parameters
        ----------
        route : Route
            The route to be written.

        Raises
        ------
        InputError
            Another CRS; a route that leaves the area by more than the margin of its fence or crosses no-go ground;
            a return that leaves the area or crosses no-go ground.
        """
        if self.terrain is not None:
            same_crs(route.crs, self.terrain.crs, "the route and the terrain")
        if self.area is None:
            return
        self.area.require_crs(route.crs, "the route")
        fence, no_go = fence_outline(self.area), shapely.union_all(no_go_ground(self.area))
        for rover in range(route.n_rovers):
            path = route.path(rover)
            outside = LineString(path).difference(fence).length
            if outside > 0.0:
                raise InputError(
                    f"{outside:.0f} m of the route of rover {rover + 1} lie more than {FENCE_MARGIN_M:g} m outside the area; "
                    "name the area that it was planned for."
                )
            require_clear(path, no_go, route.crs, f"the route of rover {rover + 1} lie in no-go ground")
            if self.returns and not self.area.free.buffer(0.01).covers(LineString(path[[-1, 0]])):
                raise InputError(
                    f"the straight way back of rover {rover + 1} leaves the area or crosses no-go ground; plan it with "
                    "--set fleet.return_to_start=true instead."
                )

    def heights(self, xy: FloatArray) -> FloatArray | None:
        """Return the height of the ground at places (N, 2) [m]; None without terrain.

        Parameters
        ----------
        xy : (N, 2) ndarray
            Easting and northing [m].

        Returns
        -------
        (N,) ndarray or None
            Above the datum of the terrain.

        Raises
        ------
        InputError
            A place without a height.
        """
        if self.terrain is None:
            return None
        if self.terrain.vertical_datum == ELLIPSOIDAL:
            _logger.warning(
                "the heights of the mission count from the ellipsoid, and autopilots read them as heights above the geoid, "
                "tens of metres apart; take a raster above the geoid"
            )
        heights = self.terrain.at(xy)
        if not np.isfinite(heights).all():
            x, y = xy[np.flatnonzero(~np.isfinite(heights))[0]]
            raise InputError(
                f"the terrain has no height at the waypoint ({x:.1f}, {y:.1f}); name a raster that covers the route with --dem."
            )
        return heights


NAV_WAYPOINT = 16
_NAV_RETURN_TO_LAUNCH, _DO_CHANGE_SPEED = 20, 178
_FRAME_GLOBAL, _FRAME_MISSION, _FRAME_RELATIVE_ALTITUDE = 0, 2, 3
_GROUND_ROVER = 10
_FIRMWARE = {"ardupilot": 3, "px4": 12}
_GROUND_SPEED, _SAME_THROTTLE = 1, -1
# An item of ArduPilot is the home position.
_N_HOME = {"ardupilot": 1, "px4": 0}


class MissionItem(NamedTuple):
    """Command with its frame and seven parameters; those of a waypoint end with latitude, longitude and height."""

    command: int
    frame: int
    params: tuple[float | None, ...]


class Mission(NamedTuple):
    """Commands and fence of one vehicle.

    `first`: number of the first item where the mission is shown. `left_out`: what a file holds beside them. `note`: how
    far the fence was made simpler. `home`: latitude and longitude [deg] and height [m].
    """

    items: tuple[MissionItem, ...]
    fence: tuple[FencePart, ...] = ()
    first: int = 1
    left_out: tuple[str, ...] = ()
    note: str = ""
    home: tuple[float, float, float] = (0.0, 0.0, 0.0)


def mission_of(route: Route, path: Path, around: Surroundings) -> Mission:
    """Return the mission of a route; refuse one that does not stay within its own fence.

    `path`: where it is written, for messages.
    """
    waypoints = _waypoints(route, path)
    fence, note = fence_of(route, path, around)
    heights = around.heights(route.path())
    latitude, longitude = waypoints[0].tolist()
    home = latitude, longitude, 0.0 if heights is None else float(heights[0])
    return Mission(tuple(_commands(waypoints, heights, around)), fence, note=note, home=home)


def fence_of(route: Route, path: Path, around: Surroundings) -> tuple[tuple[FencePart, ...], str]:
    """Return the fence of a route, of no more corners than the autopilot holds, and how far it was made simpler.

    The path is compared with it as both are written, in degrees. `path`: where it is written, for messages.
    """
    if around.area is None:
        return (), ""
    most = around.most_corners or LIMITS[around.autopilot].fence_corners
    fence = area_fence(around.area, route.path(), most, NAMES[around.autopilot])
    parts = fence.parts(route.crs)
    xy = transformed(np.round(_waypoints(route, path), 9)[:, ::-1], WGS84, route.crs, "the route")
    require_inside(xy, parts, route.crs, f"the mission {path.name} lie")
    return parts, fence.note


def write_qgc_plan(route: Route, path: Path, around: Surroundings) -> None:
    """Write a plan file of version 1: mission, fence, speed, home position."""
    mission = mission_of(route, path, around)
    _warn_of_limits(mission, path, around.autopilot)
    speed_m_s = around.speed_m_s or _mean_speed(route)
    latitude, longitude, height = mission.home
    home = [round(latitude, 9), round(longitude, 9), round(height, 2) if height else 0]
    plan = {
        "fileType": "Plan",
        "geoFence": {
            "circles": [],
            "polygons": [_json_polygon(part) for part in mission.fence],
            "version": 2,
        },
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": round(speed_m_s, 3),
            "firmwareType": _FIRMWARE[around.autopilot],
            "globalPlanAltitudeMode": 1,
            "hoverSpeed": round(speed_m_s, 3),
            "items": [_json_item(i, item) for i, item in enumerate(mission.items, start=1)],
            "plannedHomePosition": home,
            "vehicleType": _GROUND_ROVER,
            "version": 2,
        },
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
    }
    write_text(path, json.dumps(plan, indent=2) + "\n")


def write_wpl(route: Route, path: Path, around: Surroundings) -> None:
    """Write home first, as ground stations expect it, then the commands; this format holds no fence."""
    if around.area is not None:
        _logger.warning("%s holds no fence; write .plan to take that of the area along.", path.name)
    mission = mission_of(route, path, replace(around, area=None))
    _warn_of_limits(mission, path, around.autopilot)
    items = [MissionItem(NAV_WAYPOINT, _FRAME_GLOBAL, (0.0, 0.0, 0.0, 0.0, *mission.home)), *mission.items]
    lines = [_line(index, item) for index, item in enumerate(items)]
    write_text(path, "QGC WPL 110\n" + "".join(lines))


def _warn_of_limits(mission: Mission, path: Path, autopilot: Autopilot) -> None:
    """Say how far the fence was made simpler, and that an autopilot as its makers ship it does not hold a mission."""
    if mission.note:
        _logger.warning("%s: %s", path.name, mission.note)
    n_items, most = len(mission.items) + _N_HOME[autopilot], LIMITS[autopilot].items
    if n_items > most:
        _logger.warning(
            "%s has %d items, and %s holds %d by default; plan fewer or straighter swaths, or divide the route.",
            path.name, n_items, NAMES[autopilot], most,
        )  # fmt: skip


def _commands(waypoints: FloatArray, heights: FloatArray | None, around: Surroundings) -> list[MissionItem]:
    """Return the commands: speed, waypoints with heights relative to home, return."""
    items = []
    if around.speed_m_s is not None:
        params = (_GROUND_SPEED, around.speed_m_s, _SAME_THROTTLE, 0, 0, 0, 0)
        items.append(MissionItem(_DO_CHANGE_SPEED, _FRAME_MISSION, params))
    above = np.zeros(len(waypoints)) if heights is None else np.round(heights - heights[0], 2)
    items += [
        # Hold, acceptance radius, pass radius 0; the yaw is left to the vehicle.
        MissionItem(NAV_WAYPOINT, _FRAME_RELATIVE_ALTITUDE, (0, 0, 0, None, latitude, longitude, height))
        for (latitude, longitude), height in zip(waypoints.tolist(), above.tolist(), strict=True)
    ]
    if around.returns:
        items.append(MissionItem(_NAV_RETURN_TO_LAUNCH, _FRAME_MISSION, (0,) * 7))
    return items


def _json_item(index: int, item: MissionItem) -> dict[str, Any]:
    params = [value if value is None else round(value, 9) for value in item.params]
    facts: dict[str, Any] = {
        "autoContinue": True,
        "command": item.command,
        "doJumpId": index,
        "frame": item.frame,
        "params": params,
        "type": "SimpleItem",
    }
    if item.command == NAV_WAYPOINT:
        height = params[-1] or 0
        params[-1] = height
        facts = {"AMSLAltAboveTerrain": None, "Altitude": height, "AltitudeMode": 1} | facts
    return facts


def _line(index: int, item: MissionItem) -> str:
    """Return a row of the plain-text mission."""
    first, place, height = item.params[:4], item.params[4:6], item.params[6] or 0
    cells = (
        [f"{value or 0:g}" for value in first] + [f"{value or 0:.9f}" for value in place] + [f"{height:g}"]
    )
    return (
        "\t".join([str(index), str(int(index == 0)), str(item.frame), str(item.command), *cells, "1"]) + "\n"
    )


def _waypoints(route: Route, path: Path) -> FloatArray:
    """Return latitude and longitude (N, 2) of the only rover's waypoints."""
    if route.n_rovers > 1:
        raise InputError(
            f"{path.name} holds the mission of one vehicle, but the route has {route.n_rovers}; write one file per rover (rover=0, 1, …)."
        )
    require_transformation(route.crs, path)
    return transformed(route.path(), route.crs, WGS84, "the route")[:, ::-1]


def _mean_speed(route: Route) -> float:
    """Return length over predicted time [m/s]; 1 where no time was predicted."""
    time_s = route.prediction.get("time_s", 0.0)
    return route.ground_length_m / time_s if time_s > 0.0 else 1.0


def _json_polygon(part: FencePart) -> dict[str, Any]:
    return {
        "inclusion": part.is_inclusion,
        "polygon": [list(corner) for corner in part.corners],
        "version": 1,
    }

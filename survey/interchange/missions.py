"""Autopilot missions: QGroundControl's plan file and the plain-text mission ``QGC WPL 110``.

`Surroundings` holds what an exported route takes along: area, terrain, autopilot, speed and the return to launch. The area
becomes the fence, a margin outside its outline. Formats: docs.qgroundcontrol.com, "Plan File Format"; mavlink.io,
"File Formats". A mission holds one vehicle.
"""

import json
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import shapely
from shapely import LineString, Polygon

from survey.core import FloatArray, InputError, same_crs, write_text
from survey.core.crs import ELLIPSOIDAL
from survey.core.transformation import WGS84, transformed
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.io.vector import require_transformation

FENCE_MARGIN_M = 10.0
"""Distance of the fence of an autopilot from the outline of the area, to its outside [m]."""
_SIMPLIFIED_M = 1.0
_logger = logging.getLogger(__name__)

Autopilot = Literal["ardupilot", "px4"]


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
            Another CRS; a route that leaves the fence; a return that leaves the area or crosses no-go ground.
        """
        if self.terrain is not None:
            same_crs(route.crs, self.terrain.crs, "the route and the terrain")
        if self.area is None:
            return
        self.area.require_crs(route.crs, "the route")
        fence = fence_outline(self.area)
        for rover in range(route.n_rovers):
            path = route.path(rover)
            outside = LineString(path).difference(fence).length
            if outside > 0.0:
                raise InputError(
                    f"{outside:.0f} m of the route of rover {rover + 1} lie more than {FENCE_MARGIN_M:g} m outside the area; "
                    "name the area that it was planned for."
                )
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


def fence_outline(area: SurveyArea) -> Polygon:
    """Return the outline within which a rover has to stay: that of the area, a margin outside, without holes.

    Returns: in the CRS of the area [m].

    >>> fence_outline(SurveyArea.rectangle((0.0, 0.0, 80.0, 40.0), "EPSG:32608")).bounds
    (-10.0, -10.0, 90.0, 50.0)
    """
    parts = shapely.get_parts(area.polygon)
    outline = parts[0] if len(parts) == 1 else area.polygon.convex_hull
    grown = Polygon(outline.exterior).buffer(FENCE_MARGIN_M, join_style="mitre")
    return Polygon(grown.simplify(_SIMPLIFIED_M).exterior)


def no_go_outlines(area: SurveyArea) -> list[Polygon]:
    """Return the no-go zones of an area and its holes, without holes of their own.

    Returns: in the CRS of the area [m].
    """
    holes = [ring for part in shapely.get_parts(area.polygon) for ring in part.interiors]
    return [Polygon(zone.exterior) for zone in area.no_go] + [Polygon(ring) for ring in holes]


NAV_WAYPOINT = 16
_NAV_RETURN_TO_LAUNCH, _DO_CHANGE_SPEED = 20, 178
_FRAME_GLOBAL, _FRAME_MISSION, _FRAME_RELATIVE_ALTITUDE = 0, 2, 3
_GROUND_ROVER = 10
_FIRMWARE = {"ardupilot": 3, "px4": 12}
_GROUND_SPEED, _SAME_THROTTLE = 1, -1


class MissionItem(NamedTuple):
    """Command with its frame and seven parameters; those of a waypoint end with latitude, longitude and height."""

    command: int
    frame: int
    params: tuple[float | None, ...]


def write_qgc_plan(route: Route, path: Path, around: Surroundings) -> None:
    """Write a plan file of version 1: mission, fence, speed, home position."""
    waypoints = _waypoints(route, path)
    heights = around.heights(route.path())
    speed_m_s = around.speed_m_s or _mean_speed(route)
    home = 0.0 if heights is None else float(heights[0])
    plan = {
        "fileType": "Plan",
        "geoFence": {"circles": [], "polygons": fence_polygons(route, around), "version": 2},
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": round(speed_m_s, 3),
            "firmwareType": _FIRMWARE[around.autopilot],
            "globalPlanAltitudeMode": 1,
            "hoverSpeed": round(speed_m_s, 3),
            "items": [
                _json_item(i, item) for i, item in enumerate(_commands(waypoints, heights, around), start=1)
            ],
            "plannedHomePosition": [*np.round(waypoints[0], 9).tolist(), round(home, 2) if home else 0],
            "vehicleType": _GROUND_ROVER,
            "version": 2,
        },
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
    }
    write_text(path, json.dumps(plan, indent=2) + "\n")


def write_wpl(route: Route, path: Path, around: Surroundings) -> None:
    """Write home first, as ground stations expect it, then the commands; this format holds no fence."""
    waypoints = _waypoints(route, path)
    heights = around.heights(route.path())
    home = (0.0, 0.0, 0.0, 0.0, *waypoints[0], 0.0 if heights is None else float(heights[0]))
    items = [MissionItem(NAV_WAYPOINT, _FRAME_GLOBAL, home), *_commands(waypoints, heights, around)]
    lines = [_line(index, item) for index, item in enumerate(items)]
    write_text(path, "QGC WPL 110\n" + "".join(lines))


def mission_items(route: Route, around: Surroundings) -> list[MissionItem]:
    """Return the commands that a mission file of a route holds."""
    waypoints = _waypoints(route, Path("the mission"))
    return _commands(waypoints, around.heights(route.path()), around)


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


def fence_polygons(route: Route, around: Surroundings) -> list[dict[str, Any]]:
    """Return the outline of the area as inclusion and its no-go zones as exclusions.

    Returns: polygons of a plan file: corners as latitude and longitude [deg].
    """
    if around.area is None:
        return []
    outlines = [(fence_outline(around.area), True)]
    outlines += [(zone, False) for zone in no_go_outlines(around.area)]
    fences = []
    for outline, inclusion in outlines:
        corners = transformed(shapely.get_coordinates(outline)[:-1], route.crs, WGS84, "the area")
        polygon = np.round(corners[:, ::-1], 9).tolist()
        fences.append({"inclusion": inclusion, "polygon": polygon, "version": 1})
    return fences

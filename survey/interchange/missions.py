"""Missions of autopilots: QGroundControl's plan file, and the plain-text mission ``QGC WPL 110``."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely

from survey.core.arrays import FloatArray
from survey.core.crs.transformation import transformed
from survey.core.errors import InputError
from survey.core.files.writing import replacing
from survey.data.route import Route
from survey.interchange.surroundings import Surroundings, fence_outline, no_go_outlines
from survey.io.degrees import WGS84, require_transformation

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
    _write_text(path, json.dumps(plan, indent=2) + "\n")


def write_wpl(route: Route, path: Path, around: Surroundings) -> None:
    """Write home first, as ground stations expect it, then the commands; this format holds no fence."""
    waypoints = _waypoints(route, path)
    heights = around.heights(route.path())
    home = (0.0, 0.0, 0.0, 0.0, *waypoints[0], 0.0 if heights is None else float(heights[0]))
    items = [
        MissionItem(NAV_WAYPOINT, _FRAME_GLOBAL, home),
        *_commands(waypoints, heights, around),
    ]
    lines = [_line(index, item) for index, item in enumerate(items)]
    _write_text(path, "QGC WPL 110\n" + "".join(lines))


def mission_items(route: Route, around: Surroundings) -> list[MissionItem]:
    """Return the commands that a mission file of a route holds.

    Parameters
    ----------
    route : Route
        Of one rover.
    around : Surroundings
        Terrain, speed and return.

    Returns
    -------
    list of MissionItem
        Speed, waypoints with heights relative to the start, return; without the home position.

    Raises
    ------
    InputError
        Several rovers, or a CRS that no transformation ties to the Earth.
    """
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

    Parameters
    ----------
    route : Route
        Its CRS is that of the area.
    around : Surroundings
        Area, or none.

    Returns
    -------
    list of dict
        Polygons of a plan file: corners as latitude and longitude [deg].
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


def _write_text(path: Path, text: str) -> None:
    with replacing(path) as draft:
        draft.write_text(text, encoding="utf-8", newline="\n")

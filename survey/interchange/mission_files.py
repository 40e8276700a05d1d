"""Read missions of ground stations: QGroundControl's plan file and the plain-text mission ``QGC WPL 110``.

`read_mission_file` returns the commands and the fence of a file as they are. `stops_of` finds the commands that lead a vehicle to
a place, and refuses those whose place is none. `driven_places` makes a route of them: each command is a place of the route,
is named as left out, or is refused. Numbers of items are those that ground stations show. Commands: mavlink.io, "MAV_CMD".
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from survey.core import FloatArray, InputError, existing_file, refusing_damage
from survey.core.documents import read_json
from survey.core.transformation import WGS84, chosen_crs, transformed
from survey.interchange.fences import FencePart, require_inside
from survey.interchange.missions import NAV_WAYPOINT, Mission, MissionItem

GLOBAL_FRAMES = (0, 3, 5, 6, 10, 11)
"""Values of MAV_FRAME whose places are latitude and longitude: heights above sea level, above home, above terrain."""
_NAMES = {
    16: "NAV_WAYPOINT", 17: "NAV_LOITER_UNLIM", 18: "NAV_LOITER_TURNS", 19: "NAV_LOITER_TIME", 21: "NAV_LAND",
    22: "NAV_TAKEOFF", 31: "NAV_LOITER_TO_ALT", 82: "NAV_SPLINE_WAYPOINT", 84: "NAV_VTOL_TAKEOFF",
    85: "NAV_VTOL_LAND", 94: "NAV_PAYLOAD_PLACE",
}  # fmt: skip
PLACES = frozenset(_NAMES)
"""Values of MAV_CMD that lead a vehicle to a place."""
_CURVED = frozenset({17, 18, 19, 31, 82})
_DO_JUMP = 177
# These change the order of the places, or move the vehicle elsewhere.
_STEERING = {_DO_JUMP: "DO_JUMP", 192: "DO_REPOSITION", 224: "DO_SET_MISSION_CURRENT", 601: "DO_JUMP_TAG"}
_NAMES |= _STEERING | {
    20: "NAV_RETURN_TO_LAUNCH", 80: "NAV_ROI", 92: "NAV_GUIDED_ENABLE", 93: "NAV_DELAY", 112: "CONDITION_DELAY",
    113: "CONDITION_CHANGE_ALT", 114: "CONDITION_DISTANCE", 115: "CONDITION_YAW", 176: "DO_SET_MODE",
    178: "DO_CHANGE_SPEED", 179: "DO_SET_HOME", 181: "DO_SET_RELAY", 183: "DO_SET_SERVO", 189: "DO_LAND_START",
    195: "DO_SET_ROI_LOCATION", 197: "DO_SET_ROI_NONE", 201: "DO_SET_ROI", 203: "DO_DIGICAM_CONTROL",
    205: "DO_MOUNT_CONTROL", 206: "DO_SET_CAM_TRIGG_DIST", 530: "SET_CAMERA_MODE", 2000: "IMAGE_START_CAPTURE",
    2001: "IMAGE_STOP_CAPTURE", 3000: "DO_VTOL_TRANSITION",
}  # fmt: skip
# Conditions and actions (112 to 252): parameters 5 and 6 are no place, or one that is looked at.
_ASIDE = frozenset({20, 80, *range(112, 253)})
_MOST_NAMED = 5


class Stop(NamedTuple):
    """Item of a mission that leads the vehicle to a place, with its number."""

    number: int
    item: MissionItem

    @property
    def lonlat(self) -> tuple[float, float]:
        """Longitude and latitude [deg]."""
        latitude, longitude = self.item.params[4:6]
        return float(longitude or 0.0), float(latitude or 0.0)


class DrivenPlaces(NamedTuple):
    """Places (N, 2) of a route as longitude and latitude [deg], and what the mission holds beside them."""

    lonlat: FloatArray
    left_out: tuple[str, ...]


def stops_of(mission: Mission, where: str) -> list[Stop]:
    """Return the items that lead to a place; refuse one whose place is none."""
    stops = [Stop(number, item) for number, item in _numbered(mission) if item.command in PLACES]
    for stop in stops:
        _require_place(stop, where)
    return stops


def _numbered(mission: Mission) -> list[tuple[int, MissionItem]]:
    return list(enumerate(mission.items, mission.first))


def _require_place(stop: Stop, where: str) -> None:
    """Refuse a place that is not known before the drive, and one that lies nowhere on the Earth."""
    name, frame, (longitude, latitude) = _name(stop.number, stop.item), stop.item.frame, stop.lonlat
    if frame not in GLOBAL_FRAMES:
        raise InputError(
            f"{name} of {where} is in the altitude frame {frame} (MAV_FRAME); one of {', '.join(map(str, GLOBAL_FRAMES))} was "
            "expected, which hold latitude and longitude."
        )
    if not _has_place(stop.item):
        raise InputError(
            f"{name} of {where} lies at 0, 0, which stands for the place where the vehicle is; give it a place, or delete it."
        )
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
        raise InputError(
            f"{name} of {where} lies at {latitude:g}, {longitude:g}; degrees within 90 and 180 were expected."
        )


def driven_places(mission: Mission, where: str) -> DrivenPlaces:
    """Return the places of a mission in driving order; refuse commands that a route cannot hold."""
    stops = stops_of(mission, where)
    others = [(number, item) for number, item in _numbered(mission) if item.command not in PLACES]
    for number, item in others:
        _require_no_place(number, item, where)
    read_as = _listed([(number, item) for number, item in stops if item.command != NAV_WAYPOINT])
    beside = [*mission.left_out, *_listed(others)]
    beside += [f"its fence of {len(mission.fence)} parts"] if mission.fence else []
    notes = [f"read as plain places, joined by straight lines: {'; '.join(read_as)}"] if read_as else []
    if beside:
        notes.append(f"left out, because a route holds places to drive to alone: {'; '.join(beside)}")
    return DrivenPlaces(np.array([stop.lonlat for stop in stops]).reshape(-1, 2), tuple(notes))


def _require_no_place(number: int, item: MissionItem, where: str) -> None:
    """Refuse a command that changes the order of the places, or an unknown one that has a place."""
    if item.command in _STEERING:
        raise InputError(
            f"{_name(number, item)} of {where} changes the order of the places, which a route cannot hold; write the places "
            "out in the order in which they are driven."
        )
    if _has_place(item) and item.command not in _ASIDE:
        raise InputError(
            f"{_name(number, item)} of {where} has a place, and whether it is driven to is not known; replace it by a waypoint "
            f"({NAV_WAYPOINT}), or delete it."
        )


def _has_place(item: MissionItem) -> bool:
    return any(item.params[4:6]) and None not in item.params[4:6]


def _name(number: int, item: MissionItem) -> str:
    return f"item {number} ({_command(item)})"


def _command(item: MissionItem) -> str:
    name = _NAMES.get(item.command)
    return f"command {item.command}" if name is None else f"{name}, command {item.command}"


def _listed(items: Sequence[tuple[int, MissionItem]]) -> list[str]:
    """Name items, command by command."""
    numbers: dict[str, list[int]] = {}
    for number, item in items:
        numbers.setdefault(_command(item), []).append(number)
    named = []
    for command, found in numbers.items():
        more = f" and {len(found) - _MOST_NAMED} more" if len(found) > _MOST_NAMED else ""
        words = "item" if len(found) == 1 else "items"
        named.append(f"{words} {', '.join(map(str, found[:_MOST_NAMED]))}{more} ({command})")
    return named


def require_own_fence(mission: Mission, where: str) -> tuple[str, ...]:
    """Refuse a mission that leaves the fence that it carries by its straight ways, also of jumps; name the curves."""
    stops = stops_of(mission, where)
    if not mission.fence or not stops:
        return ()
    lonlat = np.array([stop.lonlat for stop in stops])
    crs = chosen_crs(lonlat[:, 0], lonlat[:, 1])
    xy = transformed(lonlat, WGS84, crs, where)
    require_inside(xy, mission.fence, crs, f"{where} lie")
    for number, item in _numbered(mission):
        before = [k for k, stop in enumerate(stops) if stop.number < number]
        after = [k for k, stop in enumerate(stops) if stop.number >= (item.params[0] or 0)]
        if item.command == _DO_JUMP and before and after:
            require_inside(xy[[before[-1], after[0]]], mission.fence, crs, f"{where} lie")
    curved = "; ".join(_listed([(number, item) for number, item in stops if item.command in _CURVED]))
    return (
        (f"the fence was checked along straight lines, which the vehicle leaves at {curved}.",)
        if curved
        else ()
    )


def read_mission_file(path: str | Path) -> Mission:
    """Read a ``.plan`` of QGroundControl or a mission ``QGC WPL 110`` as it is.

    Raises `InputError` for a file that is damaged, that holds patterns without their places, or whose commands have
    no place.
    """
    file = existing_file(path, "the mission")
    where = f"the mission {file}"
    reader = _read_wpl if file.suffix.lower() == ".waypoints" else _read_qgc_plan
    with refusing_damage(where, "mission of the format of its suffix", "save it again"):
        return reader(file, where)


def _read_qgc_plan(file: Path, where: str) -> Mission:
    plan = read_json(file, "the mission")
    fence = plan.get("geoFence", {})
    # The first version of fences had one polygon, to stay in.
    rings = [{"polygon": fence["polygon"], "inclusion": True}] if fence.get("polygon") else []
    polygons = [_polygon(one) for one in [*rings, *fence.get("polygons", [])]]
    parts = (*polygons, *(_circle(one) for one in fence.get("circles", [])))
    items: list[MissionItem] = []
    _take_items(plan["mission"]["items"], items, where)
    n_rally = len(plan.get("rallyPoints", {}).get("points", []))
    left_out = [f"{n_rally} rally points"] if n_rally else []
    left_out += ["the point of return of the fence"] if fence.get("breachReturn") else []
    return Mission(tuple(items), parts, left_out=tuple(left_out))


def _polygon(entry: dict[str, Any]) -> FencePart:
    return FencePart(
        bool(entry["inclusion"]),
        tuple((float(latitude), float(longitude)) for latitude, longitude, *_ in entry["polygon"]),
    )


def _circle(entry: dict[str, Any]) -> FencePart:
    latitude, longitude, *_ = entry["circle"]["center"]
    return FencePart(
        bool(entry["inclusion"]), ((float(latitude), float(longitude)),), float(entry["circle"]["radius"])
    )


def _take_items(entries: list[dict[str, Any]], found: list[MissionItem], where: str) -> None:
    """Add the commands, those inside survey patterns included; refuse patterns that are stored without them."""
    for entry in entries:
        pattern = entry.get("TransectStyleComplexItem", {}).get("Items")
        if pattern:
            _take_items(pattern, found, where)
        elif "command" in entry:
            found.append(_simple_item(entry))
        else:
            kind = entry.get("complexItemType") or entry.get("type") or "item without a command"
            raise InputError(
                f"item {len(found) + 1} of {where} is a pattern ({kind}) whose places the file does not hold, because "
                "QGroundControl computes them; replace it by waypoints and save it again."
            )


def _simple_item(entry: dict[str, Any]) -> MissionItem:
    """Return a command; older files hold its place as a coordinate, and its parameters one by one."""
    params = entry["params"] if "params" in entry else [entry[f"param{k}"] for k in range(1, 5)]
    values = [*params[:4], *entry["coordinate"]] if len(params) == 4 else params
    if len(values) != 7:
        raise ValueError(f"a command has {len(values)} parameters, 7 were expected")
    return _item(entry["command"], entry["frame"], values)


def _item(command: float, frame: float, params: Sequence[float | None]) -> MissionItem:
    """Return an item; parameters that are no number are left to the vehicle, as None."""
    values = tuple(None if value is None or math.isnan(value) else float(value) for value in params)
    if any(value is not None and math.isinf(value) for value in values):
        raise ValueError("a command has an infinite parameter")
    return MissionItem(_whole(command), _whole(frame), values)


def _whole(value: float) -> int:
    if int(value) != value:
        raise ValueError(f"the number {value} of a command or frame is not whole")
    return int(value)


_COLUMNS_OF_WPL = 12
_HOME = (NAV_WAYPOINT, 0)


def _read_wpl(file: Path, where: str) -> Mission:
    """Read the rows; the first is the home position if it is a waypoint above sea level, as ground stations write it."""
    first, *lines = file.read_text(encoding="utf-8-sig").splitlines()
    if first.split() != ["QGC", "WPL", "110"]:
        raise InputError(f"{where} begins with {first[:40]!r}; QGC WPL 110 was expected, save it again.")
    rows = np.array([line.split() for line in lines if line.strip()], dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != _COLUMNS_OF_WPL:
        raise ValueError("rows of 12 numbers were expected")
    if not (np.diff(rows[:, 0]) > 0.0).all():
        raise ValueError("its rows are not in the order of their numbers")
    items = tuple(_item(row[3], row[2], row[4:11].tolist()) for row in rows)
    if (items[0].command, items[0].frame) == _HOME:
        return Mission(items[1:], left_out=("item 0 (the home position)",))
    return Mission(items, first=0)

"""Missions of ground stations with items that are no plain waypoint, and fences that missions have to lie within."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from pyproj import Transformer

from benchmarks.bad_input.case import Case, Prepare, Right, both, text
from benchmarks.bad_input.good import UTM
from benchmarks.bad_input.outlines import EAST, NORTH, SITE, degrees, features, read_shapes, square

_TO_METRES = Transformer.from_crs("EPSG:4326", UTM, always_xy=True)
_NEAR_M = 1.0
_NAV = 16
# Latitude and longitude of the home position, and of the places of a mission.
_HOME = (60.430, -135.100)
PLACES = ((60.431, -135.100), (60.431, -135.090), (60.433, -135.090), (60.433, -135.100))
# Items with a place, by number and name.
PLACED = {
    17: "NAV_LOITER_UNLIM", 18: "NAV_LOITER_TURNS", 19: "NAV_LOITER_TIME", 21: "NAV_LAND", 22: "NAV_TAKEOFF",
    31: "NAV_LOITER_TO_ALT", 82: "NAV_SPLINE_WAYPOINT", 84: "NAV_VTOL_TAKEOFF", 85: "NAV_VTOL_LAND",
    94: "NAV_PAYLOAD_PLACE", 36: "NAV_ARC_WAYPOINT", 5100: "NAV_RALLY_POINT",
}  # fmt: skip
_OTHER_WAYS = {177: "DO_JUMP", 20: "NAV_RETURN_TO_LAUNCH", 112: "CONDITION_DELAY", 178: "DO_CHANGE_SPEED"}
FENCE_LIMITS = {"ardupilot": 70, "px4": 64}


def waypoints(commands: dict[int, int], places: dict[int, tuple[float, float]] | None = None) -> str:
    """Return a file of QGroundControl with other commands, or other places, at some of its items (counted from 1)."""
    rows = [(0, _NAV, _HOME)]
    rows += [
        (k, commands.get(k, _NAV), (places or {}).get(k, place)) for k, place in enumerate(PLACES, start=1)
    ]
    lines = [
        f"{k}\t{int(k == 0)}\t{0 if k == 0 else 3}\t{command}\t0\t0\t0\t0\t{lat:.8f}\t{lon:.8f}\t5\t1"
        for k, command, (lat, lon) in rows
    ]
    return "\n".join(["QGC WPL 110", *lines, ""])


def _item(
    command: int, place: tuple[float, float], params: tuple[Any, ...] = (0, 0, 0, None)
) -> dict[str, Any]:
    return {
        "type": "SimpleItem",
        "command": command,
        "frame": 3,
        "params": [*params, *place, 5],
        "autoContinue": True,
    }


def plan_file(items: list[dict[str, Any]]) -> str:
    """Return a plan of QGroundControl with these items."""
    mission = {"version": 2, "firmwareType": 3, "vehicleType": 10, "cruiseSpeed": 1, "hoverSpeed": 1,
               "plannedHomePosition": [*_HOME, 700], "items": items}  # fmt: skip
    fence = {"version": 2, "polygons": [], "circles": []}
    rally = {"version": 2, "points": []}
    return json.dumps({"fileType": "Plan", "version": 1, "groundStation": "QGroundControl", "mission": mission,
                       "geoFence": fence, "rallyPoints": rally})  # fmt: skip


def _complex_items() -> dict[str, dict[str, Any]]:
    ring = [list(place) for place in PLACES]
    here = {"coordinate": [*PLACES[1], 5], "altitude": 5, "altitudeRelative": True}
    return {
        "StructureScan": {"type": "ComplexItem", "complexItemType": "StructureScan", "version": 3, "polygon": ring, "Altitude": 30, "Layers": 2},
        "CorridorScan": {"type": "ComplexItem", "complexItemType": "CorridorScan", "version": 2, "polyline": ring[:2], "CorridorWidth": 30},
        "fwLandingPattern": {"type": "ComplexItem", "complexItemType": "fwLandingPattern", "version": 2, "landCoordinate": [*PLACES[1], 0], "landingApproachCoordinate": [*PLACES[2], 30], **here},
        "vtolLandingPattern": {"type": "ComplexItem", "complexItemType": "vtolLandingPattern", "version": 1, "landCoordinate": [*PLACES[1], 0], "landingApproachCoordinate": [*PLACES[2], 30]},
        "survey without its items": {"type": "ComplexItem", "complexItemType": "survey", "version": 5, "polygon": ring},
        "a kind of the future": {"type": "ComplexItem", "complexItemType": "spiral", "version": 1, "centre": ring[0]},
    }  # fmt: skip


def _line(path: Path) -> np.ndarray:
    """Return the corners (N, 2) [m] of all lines of a route, in their order."""
    return np.concatenate(
        [shapely.get_coordinates(s) for s in read_shapes(path) if s is not None and s.length > 0.0]
    )


def visits(places: tuple[tuple[float, float], ...], *named: str) -> Right:
    """Return a check that a route visits places in their order; words of what it does not hold are printed."""
    wanted = np.column_stack(_TO_METRES.transform(*np.array(places).T[::-1]))

    def right(folder: Path, printed: str) -> str:
        corners, begin = _line(folder / "out.geojson"), 0
        for k, place in enumerate(wanted):
            near = np.flatnonzero(np.linalg.norm(corners[begin:] - place, axis=1) < _NEAR_M)
            if not len(near):
                return f"place {k + 1} of the mission is not in the route"
            begin += int(near[0])
        if np.linalg.norm(corners - wanted.mean(axis=0), axis=1).max() > 5_000.0:
            return "the route leaves the site"
        lost = named and not any(word in printed for word in named)
        return f"nothing says that {named[0]} is left out" if lost else ""

    return right


def mission_cases() -> list[Case]:
    """Return missions with items that readers lose, places that mean none, and fences against their own missions."""
    return [*_item_cases(), *_complex_cases(), *_zero_cases(), *_fence_cases(), *_corner_cases()]


def _item_cases() -> list[Case]:
    export, cases = ["export", "in.waypoints", "out.geojson"], []
    for command, name in PLACED.items():
        words = (str(command), name)
        for at in (2, 3):
            content = waypoints({at: command})
            cases.append(
                Case(
                    f"missions: {name} at item {at} · export",
                    text("in.waypoints", content),
                    export,
                    True,
                    visits(PLACES),
                    words,
                )
            )
        plan = plan_file([_item(command if k == 1 else _NAV, place) for k, place in enumerate(PLACES)])
        cases.append(
            Case(
                f"missions: {name} in a plan · export",
                text("in.plan", plan),
                ["export", "in.plan", "out.geojson"],
                True,
                visits(PLACES),
                words,
            )
        )
    for command, name in _OTHER_WAYS.items():
        rows = waypoints({}).splitlines()
        rows.insert(4, f"3\t0\t3\t{command}\t1\t2\t0\t0\t0\t0\t0\t1")
        rows = rows[:1] + ["\t".join([str(k), *row.split("\t")[1:]]) for k, row in enumerate(rows[1:])]
        named = (str(command), name, name.removeprefix("NAV_")) if command in (177, 20) else ()
        cases.append(
            Case(
                f"missions: {name} between places · export",
                text("in.waypoints", "\n".join([*rows, ""])),
                export, True, visits(PLACES, *named), named,
            )
        )  # fmt: skip
    return cases


def _complex_cases() -> list[Case]:
    cases = []
    for name, item in _complex_items().items():
        words = (str(item["complexItemType"]),)
        for where, items in {
            "among waypoints": [_item(_NAV, PLACES[0]), item, _item(_NAV, PLACES[3])],
            "at the end": [_item(_NAV, PLACES[0]), _item(_NAV, PLACES[3]), item],
        }.items():
            export = ["export", "in.plan", "out.geojson"]
            cases.append(
                Case(
                    f"missions: {name} {where} · export",
                    text("in.plan", plan_file(items)),
                    export,
                    False,
                    None,
                    words,
                )
            )
    return cases


def _zero_cases() -> list[Case]:
    cases, none = [], (0.0, 0.0)
    for at in (1, 2, 4):
        content = waypoints({}, {at: none})
        for out in ("out.geojson", "out.gpx"):
            cases.append(
                Case(
                    f"missions: 0, 0 at item {at} · export to {out}",
                    text("in.waypoints", content),
                    ["export", "in.waypoints", out],
                )
            )
        plan = plan_file([_item(_NAV, none if k == at - 1 else place) for k, place in enumerate(PLACES)])
        cases.append(
            Case(
                f"missions: 0, 0 at item {at} of a plan · export",
                text("in.plan", plan),
                ["export", "in.plan", "out.geojson"],
            )
        )
    return cases


def _fences(plan: dict[str, Any]) -> tuple[list[shapely.Polygon], list[shapely.Polygon]]:
    """Return inclusions and exclusions of a plan in metres of the site."""
    kinds: tuple[list[shapely.Polygon], list[shapely.Polygon]] = ([], [])
    for fence in plan["geoFence"]["polygons"]:
        lat_lon = np.array(fence["polygon"])
        kinds[0 if fence["inclusion"] else 1].append(
            shapely.Polygon(np.column_stack(_TO_METRES.transform(*lat_lon.T[::-1])))
        )
    return kinds


def _holds(forbidden: shapely.Geometry, limit: int) -> Right:
    """Return a check of a plan: its mission within its fence, no-go zones outside, corners counted."""

    def right(folder: Path, _: str) -> str:
        plan = json.loads((folder / "out.plan").read_text())
        inside, outside = _fences(plan)
        places = [
            i["params"][4:6]
            for i in plan["mission"]["items"]
            if i["type"] == "SimpleItem" and i["command"] == _NAV
        ]
        way = shapely.LineString(np.column_stack(_TO_METRES.transform(*np.array(places).T[::-1])))
        free = shapely.union_all(inside).difference(shapely.union_all(outside)) if inside else None
        n_corners = sum(shapely.get_num_coordinates(shape) - 1 for shape in [*inside, *outside])
        findings = {
            "there is no fence": free is None,
            f"the fence has {n_corners} corners": n_corners > limit,
            "the mission leaves its fence": free is not None
            and way.difference(free.buffer(0.5)).length > 1.0,
            "the fence includes a no-go zone": free is not None
            and forbidden.buffer(-3.0).intersection(free).area > 1.0,
        }
        return next((words for words, is_so in findings.items() if is_so), "")

    return right


def _route(*corners: tuple[float, float]) -> Prepare:
    xy = [(EAST + x, NORTH + y) for x, y in corners]
    return text(
        "route.geojson", features([shapely.LineString(xy)], [{"order": 0, "kind": "swath", "rover": 0}])
    )


def _area(
    ground: list[shapely.Geometry], no_go: list[shapely.Geometry], *, in_degrees: bool = False
) -> Prepare:
    shapes = [degrees(s) if in_degrees else s for s in [*ground, *no_go]]
    roles: list[dict[str, object]] = [{"role": "area"}] * len(ground) + [{"role": "no-go"}] * len(no_go)
    return text("area.geojson", features(shapes, roles, None if in_degrees else UTM))


Scene = tuple[list[shapely.Geometry], list[shapely.Geometry], Prepare]


def _scenes() -> dict[str, Scene]:
    hole, island = square(150.0, 150.0, 300.0), square(250.0, 250.0, 100.0)
    ring_zone = square(100.0, 100.0, 300.0).difference(square(200.0, 200.0, 100.0))
    about = _route((20.0, 75.0), (480.0, 75.0), (480.0, 480.0), (20.0, 480.0), (20.0, 120.0))
    within = _route((260.0, 300.0), (340.0, 300.0))
    in_ring = _route((215.0, 250.0), (285.0, 250.0))
    holed = SITE.difference(hole)
    return {
        "a hole, driven about": ([holed], [], about),
        "a part in a hole, driven about": ([shapely.MultiPolygon([holed, island])], [], about),
        "a part in a hole, driven within": ([shapely.MultiPolygon([holed, island])], [], within),
        "a no-go zone with a hole, driven about": ([SITE], [ring_zone], about),
        "a no-go zone with a hole, driven within": ([SITE], [ring_zone], in_ring),
        "a no-go zone in a part in a hole": ([shapely.MultiPolygon([holed, island])], [square(260.0, 260.0, 20.0)], within),
        "two no-go zones that overlap": ([SITE], [square(150.0, 150.0, 100.0), square(200.0, 200.0, 100.0)], about),
        "two parts apart": ([shapely.MultiPolygon([SITE, square(700.0, 0.0, 200.0)])], [], about),
        "a no-go zone over the edge": ([SITE], [square(400.0, 200.0, 200.0)], _route((20.0, 75.0), (380.0, 75.0), (380.0, 480.0))),
    }  # fmt: skip


def _export(autopilot: str) -> list[str]:
    """Return the command that exports a route with the fence of its area."""
    return ["export", "route.geojson", "out.plan", "--area", "area.geojson", "--autopilot", autopilot]


def _fence_cases() -> list[Case]:
    cases = []
    for name, (ground, no_go, route) in _scenes().items():
        forbidden = shapely.union_all(no_go)
        for autopilot in FENCE_LIMITS:
            for in_degrees in (False, True):
                unit = " in degrees" if in_degrees else ""
                cases.append(
                    Case(
                        f"fences: {name}{unit} · export for {autopilot}",
                        both(route, _area(ground, no_go, in_degrees=in_degrees)),
                        _export(autopilot), True, _holds(forbidden, 1_000),
                    )
                )  # fmt: skip
    return cases


def _corner_cases() -> list[Case]:
    """Return fences of more corners than an autopilot holds: simplified outward until they fit, or refused."""

    def star(n: int, inner_m: float, outer_m: float, centre: tuple[float, float]) -> shapely.Polygon:
        turn = np.linspace(0.0, 2.0 * np.pi, 2 * n, endpoint=False)
        radius = np.where(np.arange(2 * n) % 2, inner_m, outer_m)
        return shapely.Polygon(
            np.column_stack(
                [EAST + centre[0] + radius * np.cos(turn), NORTH + centre[1] + radius * np.sin(turn)]
            )
        )

    made: dict[str, Callable[[int], tuple[list[shapely.Geometry], list[shapely.Geometry]]]] = {
        "an outline": lambda n: ([star(n, 200.0, 245.0, (250.0, 250.0))], []),
        "a no-go zone": lambda n: ([SITE], [star(n, 40.0, 60.0, (250.0, 250.0))]),
        "nine no-go zones": lambda n: (
            [SITE], [star(max(n // 9, 3), 15.0, 20.0, (100.0 + 50.0 * (k % 3), 150.0 + 60.0 * (k // 3))) for k in range(9)],
        ),
    }  # fmt: skip
    cases = []
    for what, shapes in made.items():
        for n in (36, 60, 400):
            ground, no_go = shapes(n)
            forbidden = shapely.union_all(no_go)
            way = _route((230.0, 80.0), (270.0, 80.0), (330.0, 120.0))
            for autopilot, limit in FENCE_LIMITS.items():
                cases.append(
                    Case(
                        f"fences: {what} of {2 * n} corners · export for {autopilot}",
                        both(way, _area(ground, no_go)),
                        _export(autopilot),
                        True,
                        _holds(forbidden, limit),
                    )
                )
    return cases

"""Fences: holes and islands, the corners that autopilots hold, and missions against the fence that they carry."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely import LineString, Polygon, box

from live.link import ARDUPILOT, PX4
from live.mission_items import AutopilotMission, first_difference, limits_of
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.route import Leg, Route
from survey.interchange.fences import LIMITS, FencePart, area_fence, fence_outline, require_inside
from survey.interchange.missions import Surroundings
from survey.interchange.route_formats import write_plan

CRS = "EPSG:32608"
X, Y = 500_000.0, 6_470_000.0


def square(low: float, high: float) -> Polygon:
    return box(X + low, Y + low, X + high, Y + high)


def route(*places: tuple[float, float]) -> Route:
    return Route((Leg("swath", np.array(places) + [X, Y]),), CRS, "line")


def star(n: int, inner: float, outer: float) -> Polygon:
    angle = np.linspace(0.0, 2.0 * np.pi, 2 * n, endpoint=False)
    radius = np.where(np.arange(2 * n) % 2, inner, outer)
    return Polygon(np.column_stack([X + 300.0 + radius * np.cos(angle), Y + 300.0 + radius * np.sin(angle)]))


def written_fence(file: Path) -> tuple[list[FencePart], Polygon, shapely.Geometry]:
    """Return the parts of a plan file, the ground that they include, and the ground that they exclude."""
    polygons = json.loads(file.read_text())["geoFence"]["polygons"]
    parts = [FencePart(one["inclusion"], tuple(map(tuple, one["polygon"]))) for one in polygons]
    shapes = [part.shape(SurveyArea(square(0, 1), CRS).crs) for part in parts]
    inside = [shape for shape, part in zip(shapes, parts, strict=True) if part.is_inclusion]
    outside = [shape for shape, part in zip(shapes, parts, strict=True) if not part.is_inclusion]
    return parts, shapely.union_all(inside), shapely.union_all(outside)


HOLED = Polygon(square(100, 500).exterior.coords, [square(200, 400).exterior.coords])
ISLAND = shapely.MultiPolygon(
    [Polygon(square(0, 600).exterior.coords, [square(100, 500).exterior.coords]), square(200, 400)]
)


@pytest.mark.parametrize(
    "area",
    [
        SurveyArea(square(0, 600), CRS, (HOLED,)),
        SurveyArea(ISLAND, CRS),
        SurveyArea(
            Polygon(square(0, 600).exterior.coords, [square(100, 190).exterior.coords]), CRS, (HOLED,)
        ),
    ],
    ids=["no-go zone with a hole", "part inside a hole", "both"],
)
def test_ground_inside_no_go_ground_is_not_excluded(tmp_path, area):
    inside = route((250, 250), (350, 250), (350, 350), (250, 350))
    write_plan(inside, tmp_path / "a.plan", around=Surroundings(area))
    _, fence, excluded = written_fence(tmp_path / "a.plan")
    path = LineString(inside.path())
    assert fence.covers(path)
    assert not excluded.intersects(path)
    no_go = square(0, 600).difference(area.free)
    assert excluded.symmetric_difference(no_go).area < 1.0
    read, made = (
        AutopilotMission.read(tmp_path / "a.plan"),
        AutopilotMission.of_route(inside, Surroundings(area)),
    )
    assert first_difference(read.link_items(0), made.link_items(0)) is None
    assert first_difference(read.fence_items, made.fence_items) is None


def test_export_and_upload_have_one_table_of_limits():
    assert {limits_of(ARDUPILOT), limits_of(PX4)} == set(LIMITS.values())


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize(
    "outline", [star(90, 290, 297), star(60, 200, 290)], ids=["small teeth", "long teeth"]
)
def test_an_outline_of_many_corners_is_made_simpler_to_the_inside(tmp_path, caplog, autopilot, outline):
    area, inner = SurveyArea(outline, CRS), route((180, 250), (420, 250), (420, 350), (180, 350))
    write_plan(inner, tmp_path / "a.plan", around=Surroundings(area, autopilot=autopilot))
    parts, fence, _ = written_fence(tmp_path / "a.plan")
    assert sum(len(part.corners) for part in parts) <= LIMITS[autopilot].fence_corners
    assert fence_outline(area).buffer(0.01).covers(fence)
    assert fence.covers(LineString(inner.path()).buffer(4.9))
    assert "the fence is made simpler, from" in caplog.text
    assert ("surrounds the route, not the whole area" in caplog.text) == (
        not fence.buffer(0.01).covers(outline)
    )


def test_teeth_within_the_margin_leave_the_area_inside_the_fence():
    area = SurveyArea(star(90, 290, 297), CRS)
    fence = area_fence(area, route((180, 250), (420, 250)).path(), 64, "PX4")
    assert fence.outline.covers(area.polygon)


def test_no_go_zones_of_many_corners_grow_and_stay_off_the_route(tmp_path, caplog):
    pond = shapely.Point(X + 300, Y + 300).buffer(80.0, quad_segs=40)
    area = SurveyArea(square(0, 600), CRS, (pond, star(60, 60, 63).difference(square(0, 300))))
    passing = route((50, 383), (550, 383))
    write_plan(passing, tmp_path / "a.plan", around=Surroundings(area))
    parts, _, excluded = written_fence(tmp_path / "a.plan")
    assert sum(len(part.corners) for part in parts) <= 64
    assert excluded.buffer(0.001).covers(shapely.union_all(area.no_go))
    assert not excluded.intersects(LineString(passing.path()))
    assert "no-go zones reach up to" in caplog.text


def test_more_zones_than_an_autopilot_holds_corners_are_refused(tmp_path):
    zones = tuple(square(k, k + 5) for k in range(20, 580, 20))
    area = SurveyArea(box(X - 500, Y, X + 600, Y + 600), CRS, zones)
    # A route between the zones keeps them from growing together.
    between = route(*((k + dx, k + dy) for k in range(20, 560, 20) for dx, dy in ((10, -5), (10, 12))))
    with pytest.raises(InputError, match=r"the fence has 116 corners, and PX4 holds 64; give the outline"):
        write_plan(between, tmp_path / "a.plan", around=Surroundings(area))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", [".plan", ".waypoints", ".kml", ".gpx"])
def test_a_route_through_no_go_ground_is_refused_in_every_format(tmp_path, ending):
    area = SurveyArea(square(0, 600), CRS, (square(200, 400),))
    with pytest.raises(InputError, match=r"200 m of the route of rover 1 lie in no-go ground, the first at"):
        write_plan(route((50, 300), (550, 300)), tmp_path / f"a{ending}", around=Surroundings(area))
    along_its_edge = route((50, 200), (550, 200))
    write_plan(along_its_edge, tmp_path / f"a{ending}", around=Surroundings(area))


def test_a_mission_without_a_fence_says_so(tmp_path, caplog):
    write_plan(
        route((1, 1), (9, 9)), tmp_path / "a.waypoints", around=Surroundings(SurveyArea(square(0, 10), CRS))
    )
    assert "a.waypoints holds no fence; write .plan" in caplog.text


def test_a_long_mission_says_what_the_autopilot_holds(tmp_path, caplog):
    long = route(*((k, k % 2) for k in range(800)))
    write_plan(long, tmp_path / "a.plan", around=Surroundings(autopilot="ardupilot"))
    assert "a.plan has 801 items, and ArduPilot holds 724 by default" in caplog.text


HOME = (60.43, -135.10)


def plan_with(fence: dict, *commands: dict) -> str:
    places = [(60.431, -135.10), (60.431, -135.09), (60.433, -135.09)]
    items = [{"command": 16, "frame": 3, "params": [0, 0, 0, None, *place, 5]} for place in places]
    return json.dumps({"mission": {"items": [*items, *commands]}, "geoFence": fence})


def polygon(inclusion: bool, *corners: tuple[float, float]) -> dict:
    return {"polygons": [{"inclusion": inclusion, "polygon": [list(corner) for corner in corners]}]}


def circle(inclusion: bool, radius: float, place=(60.431, -135.09)) -> dict:
    return {"circles": [{"inclusion": inclusion, "circle": {"center": list(place), "radius": radius}}]}


AROUND = ((60.42, -135.2), (60.42, -135.0), (60.44, -135.0), (60.44, -135.2))
PART = ((60.43, -135.095), (60.43, -135.0), (60.44, -135.0), (60.44, -135.095))


@pytest.mark.parametrize(
    ("fence", "words"),
    [
        (polygon(True, *AROUND), None),
        (polygon(False, *AROUND), "within the exclusions of its own fence"),
        (polygon(True, *PART), "outside the inclusions of its own fence"),
        (circle(True, 2000.0), None),
        (circle(True, 100.0), "outside the inclusions"),
        (circle(False, 100.0), "within the exclusions"),
        (circle(False, 100.0, (60.4321, -135.12)), None),
        (polygon(True, *AROUND[:2]), "part 1 of the fence .* has 2 corners"),
        ({"polygon": [list(corner) for corner in PART]}, "outside the inclusions"),
    ],
)
def test_a_mission_of_a_ground_station_stays_within_its_own_fence(tmp_path, fence, words):
    file = tmp_path / "a.plan"
    file.write_text(plan_with(fence))
    if words is None:
        AutopilotMission.read(file)
    else:
        with pytest.raises(InputError, match=words):
            AutopilotMission.read(file)


def test_the_way_of_a_jump_stays_within_the_fence_too(tmp_path):
    jump = {"command": 177, "frame": 2, "params": [1, 3, 0, 0, 0, 0, 0]}
    # From the last place back to the first one, across the middle of the triangle.
    fence = circle(False, 30.0, (60.432, -135.095))
    (tmp_path / "a.plan").write_text(plan_with(fence))
    AutopilotMission.read(tmp_path / "a.plan")
    (tmp_path / "b.plan").write_text(plan_with(fence, jump))
    with pytest.raises(InputError, match="within the exclusions"):
        AutopilotMission.read(tmp_path / "b.plan")


@pytest.mark.parametrize(("command", "name"), [(82, "NAV_SPLINE_WAYPOINT"), (18, "NAV_LOITER_TURNS")])
def test_curves_that_are_not_compared_with_the_fence_are_named(tmp_path, command, name):
    bent = {"command": command, "frame": 3, "params": [3, 0, 50, 0, 60.4312, -135.095, 0]}
    (tmp_path / "a.plan").write_text(plan_with(polygon(True, *AROUND), bent))
    assert any(
        "checked along straight lines" in note and name in note
        for note in AutopilotMission.read(tmp_path / "a.plan").notes
    )
    (tmp_path / "b.plan").write_text(plan_with({}, bent))
    assert not any("straight" in note for note in AutopilotMission.read(tmp_path / "b.plan").notes)


def test_a_single_place_is_compared_too():
    part = FencePart(False, AROUND)
    crs = SurveyArea(square(0, 1), CRS).crs
    xy = np.array([part.shape(crs).centroid.coords[0]])
    with pytest.raises(InputError, match="within the exclusions"):
        require_inside(xy, [part], crs, "it lie")

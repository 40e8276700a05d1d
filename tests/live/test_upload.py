"""Upload to the simulated rover behind MAVSDK's servers: equal items, losses, refusals."""

import json
import math
import subprocess
import sys
import time

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from firnline.cli.main import app
from live.link import LinkAddress, Vehicle
from live.mission_items import FENCE, MISSION, AutopilotMission, first_difference, require_storable
from live.mission_transfer import fetch_items, upload
from survey import Route, SurveyArea
from survey.core.errors import InputError
from survey.data.route import Leg
from survey.interchange.missions import MissionItem, Surroundings
from survey.interchange.route_formats import read_plan, write_plan

CRS = "EPSG:32608"
ORIGIN = np.array([526_000.0, 6_478_000.0])


def site() -> SurveyArea:
    west, south = ORIGIN.tolist()
    return SurveyArea(
        shapely.box(west - 5, south - 5, west + 205, south + 105),
        CRS,
        (shapely.box(west + 80, south + 40, west + 120, south + 60),),
    )


def route(n: int = 40) -> Route:
    angle = np.linspace(0.0, 2.0 * np.pi, n)
    xy = ORIGIN + [100.0, 50.0] + np.column_stack([90.0 * np.cos(angle), 45.0 * np.sin(angle)])
    return Route((Leg("swath", xy),), CRS, "loop")


def held(url: str, kind: int):
    with Vehicle.connected(LinkAddress.parsed(url)) as vehicle:
        return fetch_items(vehicle, kind)


def run(*args: str, code: int = 0):
    result = CliRunner().invoke(app, [*args])
    assert result.exit_code == code, result.output
    return result


def test_the_rover_holds_the_items_of_the_exported_plan_and_the_fence(start_rover, tmp_path):
    rover = start_rover()
    route().write(tmp_path / "route.geojson")
    site().write(tmp_path / "site.gpkg")
    named = [str(tmp_path / "route.geojson"), "--area", str(tmp_path / "site.gpkg"), "--speed", "1.5"]
    facts = json.loads(run("upload", named[0], rover.url, *named[1:], "--json").stdout)
    assert (facts["items"], facts["fence_corners"], facts["transfers"]) == (41, 8, 2)
    write_plan(route(), tmp_path / "same.plan", around=Surroundings(site(), speed_m_s=1.5))
    exported = AutopilotMission.read(tmp_path / "same.plan")
    for kind, expected in ((MISSION, exported.link_items(0)), (FENCE, exported.fence_items)):
        found = held(rover.url, kind)
        assert first_difference(expected, found) is None, (expected, found)
    back = tmp_path / "back.geojson"
    run("download", rover.url, "-o", str(back), "--crs", CRS)
    np.testing.assert_allclose(read_plan(back, CRS).path(), route().path(), atol=0.012)


@pytest.mark.long
def test_a_link_that_loses_a_third_of_its_packets_ends_equal(start_rover):
    rover = start_rover("--loss", "0.3", "--seed", "4")
    mission = AutopilotMission.of_route(route(5), Surroundings(site()))
    report = upload(mission, LinkAddress.parsed(rover.url), patience_s=20.0)
    assert (report.items, report.fence_corners) == (5, 8)


def test_nobody_at_the_address_is_said_in_one_sentence():
    result = run("upload", "route.gpx", "udp://127.0.0.1:9", code=3)
    assert "route.gpx" in result.stderr
    with pytest.raises(InputError, match=r"no vehicle answered at udp://127.0.0.1:9 for 0.5 s"):
        upload(
            AutopilotMission.of_route(route(), Surroundings()),
            LinkAddress.parsed("udp://127.0.0.1:9"),
            patience_s=0.5,
        )


@pytest.mark.parametrize(
    "text", ["127.0.0.1:14550", "udp://host", "http://host:1", "udp://host:99999", "udp://h:x"]
)
def test_other_addresses_are_refused(text):
    with pytest.raises(InputError, match="is no MAVLink connection"):
        LinkAddress.parsed(text)


def waypoint(latitude: float, longitude: float, frame: int = 3) -> MissionItem:
    return MissionItem(16, frame, (0, 0, 0, None, latitude, longitude, 1.0))


@pytest.mark.parametrize(
    ("items", "most", "sentence"),
    [
        ([waypoint(60.0 + 1e-4 * k, 7.0) for k in range(5)], 4, "has 5 items, and this autopilot holds 4"),
        ([waypoint(60.0, 7.0, frame=9)], 9, "altitude frame 9"),
        ([waypoint(95.0, 7.0)], 9, "lies at 95, 7"),
        ([waypoint(60.0, 7.0), waypoint(60.0 + 2e-8, 7.0)], 9, "11 mm"),
    ],
)
def test_what_an_autopilot_cannot_hold_is_refused_with_numbers(items, most, sentence):
    mission = AutopilotMission(tuple(items))
    with pytest.raises(InputError, match=sentence):
        require_storable(mission.link_items(0), MISSION, most)


def test_missions_of_ardupilot_begin_with_the_home_position():
    items = AutopilotMission((waypoint(60.0, 7.0),)).link_items(3)
    assert [(item.frame, item.degrees) for item in items] == [(0, (60.0, 7.0)), (3, (60.0, 7.0))]
    assert math.isnan(items[1].params[3])


def test_a_plan_of_a_ground_station_is_sent_with_all_its_commands(tmp_path):
    write_plan(route(6), tmp_path / "a.waypoints", around=Surroundings(speed_m_s=2.0, returns=True))
    write_plan(route(6), tmp_path / "a.plan", around=Surroundings(speed_m_s=2.0, returns=True))
    text, plan = AutopilotMission.read(tmp_path / "a.waypoints"), AutopilotMission.read(tmp_path / "a.plan")
    assert (
        [item.command for item in text.items] == [178, *[16] * 6, 20] == [item.command for item in plan.items]
    )
    (tmp_path / "bad.plan").write_text('{"mission": 3}')
    with pytest.raises(InputError, match="is damaged"):
        AutopilotMission.read(tmp_path / "bad.plan")


def test_a_dry_run_sends_nothing(tmp_path):
    write_plan(route(), tmp_path / "route.gpx")
    said = run("upload", str(tmp_path / "route.gpx"), "udp://127.0.0.1:9", "--dry-run").stdout
    assert "nothing was written" in said
    assert "udp://127.0.0.1:9" in said


@pytest.mark.long
@pytest.mark.reliability
def test_a_killed_upload_leaves_the_former_mission_and_the_next_one_goes_on(start_rover, tmp_path):
    rover = start_rover()
    address = LinkAddress.parsed(rover.url)
    small, large = route(30), route(600)
    upload(AutopilotMission.of_route(small, Surroundings()), address)
    write_plan(large, tmp_path / "large.plan")
    command = [sys.executable, "-m", "firnline", "upload", str(tmp_path / "large.plan"), rover.url]
    child = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    time.sleep(1.6)
    child.kill()
    child.wait()
    assert len(held(rover.url, MISSION)) in (30, 600)
    assert upload(AutopilotMission.of_route(large, Surroundings()), address).items == 600


@pytest.mark.reliability
def test_a_killed_rover_ends_the_upload_with_one_sentence(start_rover):
    rover = start_rover()
    mission = AutopilotMission.of_route(route(600), Surroundings())

    def kill_half_way(_: str, done: int, __: int) -> None:
        if done == 300 and rover.process.poll() is None:
            rover.kill()

    with pytest.raises(InputError, match=r"run the command again|answered at"):
        upload(mission, LinkAddress.parsed(rover.url), patience_s=1.0, progress=kill_half_way)

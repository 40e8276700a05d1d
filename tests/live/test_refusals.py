"""What goes wrong first in the field: each is said in one sentence, with an exit code."""

import json

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from firnline.cli.main import app
from live.mission_items import FENCE, AutopilotMission, require_storable
from live.mission_transfer import downloaded_route, upload
from survey import Route, SurveyArea
from survey.core.errors import InputError
from survey.data.route import Leg
from survey.interchange.missions import Surroundings
from tests.live.scripted_vehicle import ScriptedVehicle

CRS = "EPSG:32608"
CORNER = np.array([526_000.0, 6_478_000.0])
ROUTE = Route((Leg("swath", CORNER + [[0.0, 0.0], [40.0, 0.0], [40.0, 30.0]]),), CRS, "three")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ROUTE.write("route.geojson")
    return tmp_path


def refusal(*args: str, code: int = 3) -> str:
    result = CliRunner().invoke(app, [*args])
    assert result.exit_code == code, result.output
    assert "Traceback" not in result.output
    return " ".join(result.output.split())


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("upload", "route.geojson", "route.geojson"), "is no MAVLink connection"),
        (("upload", "none.geojson", "udp://127.0.0.1:9"), "none.geojson"),
        (("download", "udp://127.0.0.1:9", "--patience", "0.5"), "no vehicle answered"),
        (("download", "tcp://127.0.0.1:9", "--patience", "0.5"), "cannot be opened"),
        (("download", "serial:///dev/none:57600", "--patience", "0.5"), "serial:///dev/none:57600"),
        (("download", "udp://no-such-host.invalid:9", "--patience", "0.5"), "udp://no-such-host.invalid:9"),
    ],
)
def test_a_wrong_address_or_a_silent_one_is_refused(folder, args, words):
    assert words in refusal(*args)


def test_an_area_of_too_many_corners_is_refused_as_a_fence():
    area = SurveyArea(shapely.Point(*CORNER).buffer(100.0, quad_segs=40), CRS)
    mission = AutopilotMission.of_route(
        Route((Leg("swath", CORNER + [[0.0, 0.0], [40.0, 0.0]]),), CRS, "one"), Surroundings(area)
    )
    with pytest.raises(
        InputError, match=r"fence has \d+ items, and this autopilot holds 10; give the outline"
    ):
        require_storable(mission.fence_items, FENCE, 10)


def test_items_of_an_older_plan_have_their_place_apart(tmp_path):
    item = {"command": 16, "frame": 3, "params": [0, 0, 0, None], "coordinate": [60.1, -139.5, 2.5]}
    (tmp_path / "older.plan").write_text(json.dumps({"mission": {"items": [item]}}))
    assert AutopilotMission.read(tmp_path / "older.plan").items[0].params == (
        0,
        0,
        0,
        None,
        60.1,
        -139.5,
        2.5,
    )


@pytest.mark.parametrize("params", [[], [0, 0, 0, 0, 60.1], [0] * 8, [0, 0, 0, 0, "x", 1, 2]])
def test_a_plan_with_an_item_of_other_numbers_is_refused(tmp_path, params):
    plan = {"mission": {"items": [{"command": 16, "frame": 3, "params": params}]}}
    (tmp_path / "odd.plan").write_text(json.dumps(plan))
    with pytest.raises(InputError, match=r"odd\.plan is damaged or no mission"):
        AutopilotMission.read(tmp_path / "odd.plan")


def test_a_plan_without_waypoints_is_refused(folder):
    plan = {"mission": {"items": [{"command": 178, "frame": 2, "params": [1, 2, -1, 0, 0, 0, 0]}]}}
    (folder / "empty.plan").write_text(json.dumps(plan))
    assert "has 1 items and no waypoint" in refusal("upload", "empty.plan", "udp://127.0.0.1:9", "--dry-run")


def test_a_dry_run_names_the_autopilots_that_hold_the_mission(folder):
    long = Route((Leg("swath", CORNER + np.column_stack([np.arange(800.0), np.zeros(800)])),), CRS, "long")
    long.write("long.geojson")
    said = refusal("upload", "long.geojson", "udp://127.0.0.1:9", "--dry-run", code=0)
    assert "does not hold it: at most 724 items" in said
    assert "has 800 items, and this autopilot holds 100" in refusal(
        "upload", "long.geojson", "udp://127.0.0.1:9", "--dry-run", "--most-items", "100"
    )


def test_a_rover_without_a_mission_has_none_to_download(start_rover, folder):
    said = refusal("download", start_rover().url, "--patience", "30")
    assert "holds 0 items with 0 waypoints" in said
    assert not (folder / "downloaded.geojson").exists()


class ArduPilotLike(ScriptedVehicle):
    """A vehicle that says it is ArduPilot: it stores a mission, and has a home of its own."""

    def __init__(self, result: int = 0) -> None:
        super().__init__(self._answers, autopilot=3)
        self.result, self.items, self.n_items = result, [], 0

    def _answers(self, message) -> list[tuple]:
        kind = "" if message is None else message.get_type()
        if kind == "MISSION_COUNT":
            self.items, self.n_items = [], message.count
            if self.result:
                return [("mission_ack", 255, 190, self.result, 0)]
            return [("mission_request_int", 255, 190, 0, 0)]
        if kind == "MISSION_ITEM_INT" and message.seq == len(self.items):
            self.items.append(message)
            n = len(self.items)
            return [
                ("mission_request_int", 255, 190, n, 0)
                if n < self.n_items
                else ("mission_ack", 255, 190, 0, 0)
            ]
        if kind == "MISSION_REQUEST_LIST":
            return [("mission_count", 255, 190, len(self.items), 0)]
        if kind == "MISSION_REQUEST_INT":
            one = self.items[message.seq]
            place = (585000000, -1340000000, 12.0) if message.seq == 0 else (one.x, one.y, one.z)
            params = one.param1, one.param2, one.param3, 0.0
            head = (255, 190, one.seq, one.frame, one.command, 0, 1)
            return [("mission_item_int", *head, *params, *place, 0)]
        return []


def test_ardupilot_has_a_home_of_its_own_and_the_mission_is_equal():
    with ArduPilotLike() as vehicle:
        report = upload(AutopilotMission.of_route(ROUTE, Surroundings()), vehicle.address, patience_s=10.0)
        assert (report.items, report.transfers) == (4, 1)
        route = downloaded_route(vehicle.address, CRS, patience_s=10.0)
    np.testing.assert_allclose(route.path(), ROUTE.path(), atol=0.02)


@pytest.mark.parametrize(
    ("result", "words"), [(4, "no space for so many items"), (14, "no permission now"), (9, "result 9")]
)
def test_a_vehicle_that_refuses_is_quoted(result, words):
    mission = AutopilotMission.of_route(ROUTE, Surroundings())
    with ArduPilotLike(result) as vehicle, pytest.raises(InputError, match=words):
        upload(mission, vehicle.address, patience_s=10.0)


def test_an_upload_that_takes_too_long_is_given_up(monkeypatch):
    monkeypatch.setattr("live.mission_transfer.MOST_UPLOAD_S", -1.0)
    with ArduPilotLike() as vehicle, pytest.raises(InputError, match=r"took longer than .* come nearer"):
        upload(AutopilotMission.of_route(ROUTE, Surroundings()), vehicle.address, patience_s=10.0)


@pytest.mark.parametrize("source", [".", "none.csv", "udp://127.0.0.1:9"])
def test_a_source_that_is_none_is_refused_by_watch(folder, source):
    SurveyArea.rectangle((*CORNER, *(CORNER + 50.0)), CRS).write("site.gpkg")
    said = refusal(
        "watch", source, "--area", "site.gpkg", "--route", "route.geojson", "--patience", "0.5", "--once"
    )
    assert any(words in said for words in ("is no recording", "none.csv", "no vehicle answered"))

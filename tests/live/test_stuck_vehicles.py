"""Vehicles that talk and do not go on: each transfer ends with one sentence. And missions of other ground stations, read back."""

from collections.abc import Callable

import numpy as np
import pytest

from live.link import Vehicle
from live.mission_items import MISSION, AutopilotMission
from live.mission_transfer import downloaded_route, fetch_items, upload
from survey.core.errors import InputError
from survey.interchange.missions import MissionItem
from tests.live.scripted_vehicle import ScriptedVehicle

PLACES = [(60.431, -135.10), (60.431, -135.09), (60.433, -135.09), (60.433, -135.10)]


def item(command: int, place: tuple[float, float] = (0.0, 0.0), frame: int = 3) -> MissionItem:
    return MissionItem(command, frame, (0, 0, 0, None, *place, 1.0))


MISSION_OF_FOUR = AutopilotMission(tuple(item(16, place) for place in PLACES))


def scripted(script: Callable[[str, int], list[tuple]]) -> ScriptedVehicle:
    """Return a vehicle of PX4 whose script gets the kind of a message and its number; no kind at every turn."""
    return ScriptedVehicle(
        lambda message: (
            script("", -1) if message is None else script(message.get_type(), getattr(message, "seq", -1))
        )
    )


def ask(seq: int) -> tuple:
    return ("mission_request_int", 255, 190, seq, MISSION)


ACCEPTED = ("mission_ack", 255, 190, 0, MISSION)
OUT_OF_ORDER = ("mission_ack", 255, 190, 13, MISSION)


def asks_for_the_first(kind: str, _: int) -> list[tuple]:
    return [ask(0)] if kind in ("MISSION_COUNT", "MISSION_ITEM_INT") else []


def asks_for_the_first_all_the_time(kind: str, _: int) -> list[tuple]:
    return [ask(0)]


def asks_in_a_circle(kind: str, seq: int) -> list[tuple]:
    return [ask((seq + 1) % 3)] if kind in ("MISSION_COUNT", "MISSION_ITEM_INT") else []


def asks_beyond_the_list(kind: str, seq: int) -> list[tuple]:
    return [ask(7)]


def acknowledges_at_once(kind: str, _: int) -> list[tuple]:
    return [ACCEPTED] if kind in ("MISSION_COUNT", "MISSION_ITEM_INT") else []


def acknowledges_all_the_time(kind: str, _: int) -> list[tuple]:
    return [ACCEPTED]


def finds_all_out_of_order(kind: str, _: int) -> list[tuple]:
    return [OUT_OF_ORDER]


class AsksEverHigher:
    """Asks for items beyond the list, each once."""

    def __init__(self) -> None:
        self.seq = 10

    def __call__(self, kind: str, _: int) -> list[tuple]:
        self.seq = min(self.seq + 1, 60_000)
        return [ask(self.seq)]


@pytest.mark.parametrize(
    ("script", "words"),
    [
        (asks_for_the_first, "asked for item 0 100 times while 4 items of the mission were sent"),
        (asks_for_the_first_all_the_time, "asked for item 0 100 times"),
        (asks_in_a_circle, r"asked for item \d 100 times"),
        (asks_beyond_the_list, "talks, but did not go on|asked for item 7 100 times"),
        (acknowledges_at_once, "talks, but did not go on|acknowledged it 100 times|silent"),
        (acknowledges_all_the_time, "talks, but did not go on|acknowledged it 100 times"),
        (finds_all_out_of_order, "talks, but did not go on|acknowledged it 100 times"),
        (AsksEverHigher(), "talks, but did not go on for 1.5 s after item 0 of 4 of the mission"),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_an_upload_to_a_vehicle_that_does_not_go_on_ends(script, words):
    with scripted(script) as vehicle, pytest.raises(InputError, match=words):
        upload(MISSION_OF_FOUR, vehicle.address, patience_s=1.5)


def count(n: int) -> tuple:
    return ("mission_count", 255, 190, n, MISSION)


def answer(seq: int, command: int, place: tuple[float, float], frame: int = 3, x: int | None = None) -> tuple:
    latitude, longitude = (round(1e7 * value) for value in place)
    x = latitude if x is None else x
    return ("mission_item_int", 255, 190, seq, frame, command, 0, 1, 0, 0, 0, 0, x, longitude, 5, MISSION)


def counts_and_gives_nothing(kind: str, _: int) -> list[tuple]:
    return [count(4)]


def gives_the_first_only(kind: str, _: int) -> list[tuple]:
    return {"MISSION_REQUEST_LIST": [count(4)], "MISSION_REQUEST_INT": [answer(0, 16, PLACES[0])]}.get(
        kind, []
    )


def gives_others_than_asked_for(kind: str, seq: int) -> list[tuple]:
    given = [answer(seq + 4, 16, PLACES[0])]
    return {"MISSION_REQUEST_LIST": [count(4)], "MISSION_REQUEST_INT": given}.get(kind, [])


@pytest.mark.parametrize(
    "script", [counts_and_gives_nothing, gives_the_first_only, gives_others_than_asked_for]
)
def test_a_download_from_a_vehicle_that_does_not_go_on_ends(script):
    with (
        scripted(script) as vehicle,
        pytest.raises(InputError, match=r"did not go on|was silent|could be read in"),
    ):
        downloaded_route(vehicle.address, "EPSG:32608", patience_s=1.5)


def holds(*items: tuple) -> Callable[[str, int], list[tuple]]:
    def script(kind: str, seq: int) -> list[tuple]:
        if kind == "MISSION_REQUEST_LIST":
            return [count(len(items))]
        return [answer(seq, *items[seq])] if kind == "MISSION_REQUEST_INT" else []

    return script


def test_a_download_keeps_the_places_of_all_commands_in_order(caplog):
    held = holds(
        (178, (0.0, 0.0), 2),
        (22, PLACES[0], 10),
        (82, PLACES[1], 3),
        (19, PLACES[2], 6),
        (201, (60.5, -135.5), 3),
        (21, PLACES[3], 0),
        (20, (0.0, 0.0), 2),
    )
    with scripted(held) as vehicle:
        route = downloaded_route(vehicle.address, "EPSG:32608", patience_s=5.0)
    assert len(route.path()) == 4
    assert np.all(np.hypot(*np.diff(route.path(), axis=0).T) > 200.0)
    for words in (
        "item 2 (NAV_SPLINE_WAYPOINT",
        "item 4 (DO_SET_ROI",
        "item 0 (DO_CHANGE_SPEED",
        "item 6 (NAV_RETURN",
    ):
        assert words in caplog.text


@pytest.mark.parametrize(
    ("held", "words"),
    [
        (holds((16, PLACES[0]), (16, (0.0, 0.0))), r"item 1 \(NAV_WAYPOINT, command 16\) .* lies at 0, 0"),
        (holds((16, PLACES[0]), (177, (0.0, 0.0), 2), (16, PLACES[1])), r"item 1 \(DO_JUMP, command 177\)"),
        (holds((16, PLACES[0]), (16, PLACES[1], 1)), r"item 1 .* altitude frame 1"),
        (holds((16, PLACES[0]), (36, PLACES[1])), r"item 1 \(command 36\) .* has a place"),
    ],
)
def test_a_download_that_a_route_cannot_hold_is_refused_with_its_item(held, words):
    with scripted(held) as vehicle, pytest.raises(InputError, match=words):
        downloaded_route(vehicle.address, "EPSG:32608", patience_s=5.0)


def test_items_that_no_mission_has_are_none_of_it():
    def script(kind: str, seq: int) -> list[tuple]:
        first = holds((16, PLACES[0]), (16, PLACES[1]))(kind, seq)
        return [answer(900, 16, PLACES[2]), *first] if kind == "MISSION_REQUEST_INT" else first

    with scripted(script) as vehicle, Vehicle.connected(vehicle.address, 5.0) as link:
        assert [one.degrees for one in fetch_items(link, MISSION)] == PLACES[:2]

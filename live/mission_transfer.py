"""Mission of a vehicle: upload with its fence, comparison item by item, download as a route, and start.

`send_items` and `fetch_items` are the mission protocol of MAVLink from the side of the ground station. Every message may
be lost. A vehicle asks for the items one by one and takes the one that it waits for. While it is silent, the last item
and those after it are sent unasked, since its request may be what was lost. A transfer ends with the vehicle's
acknowledgement, with its refusal, with `LinkLostError` when nothing came for as long as the patience or the vehicle talked
for as long without going on, or with `InputError` when it asks for one item again and again. `start_mission`
commands the vehicle to begin the mission that it holds.

`upload` sends mission and fence, reads them back and compares them; `downloaded_route` reads a mission as a route.
"""

import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from time import monotonic
from typing import Any, NamedTuple

from live.link import LinkAddress, LinkLostError, Vehicle
from live.mission_items import (
    FENCE,
    KIND_NAMES,
    MISSION,
    AutopilotMission,
    LinkItem,
    first_difference,
    limits_of,
    n_home_items,
    require_storable,
)
from survey import InputError, Leg, Route
from survey.core import FloatArray, Progress, projected_crs
from survey.core.transformation import WGS84, chosen_crs, transformed
from survey.interchange.mission_files import driven_places
from survey.interchange.missions import Mission

_logger = logging.getLogger(__name__)
_MISSION_RESEND_S = 0.3
_FIRST_WAIT_S, _LEAST_WAIT_S, _MOST_WAIT_S = 0.3, 0.1, 1.5
# Items that are sent without being asked for while a vehicle is silent; its requests may have been lost.
_MOST_AHEAD = 8
_COPIES, _MOST_ASKED, _MOST_PASSES = 3, 3, 8
# At 50 % loss a vehicle has to ask for an item more often than this once in 10^12 items.
_MOST_REPEATS = 100
_COUNT_WAIT_S = 0.7
# Near the last item a vehicle that has all of them may be silent: its acknowledgement was lost.
_LAST_S = 3.0
_FROM_VEHICLE = ("MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK")
_MISSION_ACCEPTED = 0
_RESULTS = {
    1: "an unspecified error", 2: "an unsupported frame", 3: "an unsupported command",
    4: "no space for so many items", 13: "items out of order", 14: "no permission now",
    15: "a cancelled transfer",
}  # fmt: skip
_CANCELLED, _OUT_OF_ORDER, _ERROR = 15, 13, 1
# These end a transfer that lost too many messages; the next one may succeed.
_PASSING = (_CANCELLED, _ERROR)


class TransferBrokenError(LinkLostError):
    """The vehicle gave a transfer up; what it held before still holds."""


class TransferStalledError(LinkLostError):
    """The vehicle talks and does not go on; over a poor link its next transfer may succeed."""


def send_items(
    vehicle: Vehicle, items: Sequence[LinkItem], kind: int, progress: Progress | None = None
) -> None:
    """Send items to a vehicle until it acknowledges them, or is silent after the last one."""
    if items:
        _Sending(vehicle, items, kind, progress).run()
    else:
        _clear(vehicle, kind)


@dataclass
class _Pace:
    """Time after which an answer counts as lost: four times the answers' mean delay, longer while nothing comes."""

    wait_s: float = _FIRST_WAIT_S
    mean_s: float | None = None
    n_silent: int = 0

    def answered(self, delay_s: float) -> None:
        """Take the delay of an answer into account."""
        self.mean_s = delay_s if self.mean_s is None else 0.9 * self.mean_s + 0.1 * delay_s
        self.wait_s, self.n_silent = min(max(4.0 * self.mean_s, _LEAST_WAIT_S), _MOST_WAIT_S), 0

    def silent(self) -> None:
        """Wait longer for the next answer."""
        self.n_silent += 1
        self.wait_s = min(1.2 * self.wait_s, _MOST_WAIT_S)


@dataclass
class _Sending:
    """One transfer to a vehicle: the highest item that it asked for, when it was heard last, and when it went on last.

    `said`: how often it said the same since then.
    """

    vehicle: Vehicle
    items: Sequence[LinkItem]
    kind: int
    progress: Progress | None
    highest: int = -1
    heard: float = field(default_factory=monotonic)
    went_on: float = field(default_factory=monotonic)
    said: Counter[str] = field(default_factory=Counter)
    pace: _Pace = field(default_factory=_Pace)
    _announced: float = -_MOST_WAIT_S

    def run(self) -> None:
        """Send until the vehicle has all items."""
        self._announce()
        asked = monotonic()
        while not self._is_silent_at_the_end():
            message = self.vehicle.receive(_FROM_VEHICLE, self.pace.wait_s)
            if message is None:
                self.pace.silent()
                self._send_ahead()
            elif message.mission_type == self.kind:
                self.pace.answered(monotonic() - asked)
                if self._taken(message):
                    return
            asked = monotonic()

    def _announce(self) -> None:
        """Send the number of items, which begins a transfer."""
        self._announced = monotonic()
        self.vehicle.mav.mission_count_send(
            self.vehicle.system, self.vehicle.component, len(self.items), self.kind
        )

    def _send_ahead(self) -> None:
        """Send what the vehicle may be waiting for: the last item again, and those after it, which it may have asked for.

        A vehicle takes the item that it waits for and ignores others. The longer it is silent, the more are sent.
        """
        if self.highest < 0 and monotonic() - self._announced > _MOST_WAIT_S:
            self._announce()
        first = max(self.highest, 0)
        for index in range(first, min(first + 1 + min(self.pace.n_silent, _MOST_AHEAD), len(self.items))):
            _send_item(self.vehicle, self.items, index, self.kind)

    def _is_silent_at_the_end(self) -> bool:
        """Return whether the vehicle is silent after one of the last items; refuse to wait longer than the patience."""
        silent_s = monotonic() - self.heard
        if self.highest >= len(self.items) - 2 - _MOST_AHEAD and silent_s > _LAST_S and self.highest >= 0:
            return True
        when = f"after item {self.highest + 1} of {len(self.items)} of the {KIND_NAMES[self.kind]}"
        _require_progress(self.vehicle, self.heard, self.went_on, when)
        return False

    def _taken(self, message: Any) -> bool:
        """Answer the vehicle; return whether it has all items."""
        self.heard = monotonic()
        is_end = message.get_type() == "MISSION_ACK"
        self._count("acknowledged it" if is_end else f"asked for item {message.seq}")
        if is_end:
            return _ends(message, self.vehicle, len(self.items), self.kind, is_begun=self.highest >= 0)
        if message.seq < len(self.items):
            _send_item(self.vehicle, self.items, message.seq, self.kind)
            if message.seq > self.highest:
                self.highest, self.went_on = message.seq, self.heard
                self.said.clear()
                if self.progress is not None:
                    self.progress(f"sending the {KIND_NAMES[self.kind]}", message.seq + 1, len(self.items))
        return False

    def _count(self, words: str) -> None:
        """Refuse a vehicle that says the same again and again."""
        self.said[words] += 1
        if self.said[words] > _MOST_REPEATS:
            raise InputError(
                f"{self.vehicle.name} {words} {_MOST_REPEATS} times while {len(self.items)} items of the "
                f"{KIND_NAMES[self.kind]} were sent, and did not go on; restart the autopilot and run the command again."
            )


def fetch_items(vehicle: Vehicle, kind: int, progress: Progress | None = None) -> list[LinkItem]:
    """Read the items that a vehicle holds."""
    reading = _Reading(vehicle, kind, progress)
    for _ in range(_MOST_PASSES):
        n_items = reading.count()
        reading.walk(n_items)
        if reading.found.keys() >= set(range(n_items)):
            reading.end()
            return [reading.found[index] for index in range(n_items)]
    raise LinkLostError(
        f"{vehicle.address.text} lost so many packets that {len(reading.found)} of {n_items} items of the {KIND_NAMES[kind]} "
        f"could be read in {_MOST_PASSES} transfers; come nearer and run the command again."
    )


@dataclass
class _Reading:
    """Transfers from a vehicle until every item was found.

    A vehicle answers requests in order and ends a transfer when one item is asked for too often. After some requests
    without an answer the next item is asked for: the vehicle answers if only its answer was lost, and the item that is
    missing is found in the next transfer.
    """

    vehicle: Vehicle
    kind: int
    progress: Progress | None
    found: dict[int, LinkItem] = field(default_factory=dict)
    heard: float = field(default_factory=monotonic)
    went_on: float = field(default_factory=monotonic)
    pace: _Pace = field(default_factory=_Pace)

    def count(self) -> int:
        """Ask how many items there are, which begins a transfer."""
        while True:
            self.vehicle.mav.mission_request_list_send(self.vehicle.system, self.vehicle.component, self.kind)
            message = self._received(("MISSION_COUNT",), max(self.pace.wait_s, _COUNT_WAIT_S))
            if message is not None:
                return int(message.count)
            self._require_progress()  # the count itself is none: it begins a transfer, of which there are a few

    def walk(self, n_items: int) -> None:
        """Ask for all items in order, until the last one or until the vehicle answers no more."""
        index, n_silent = 0, 0
        while index < n_items and n_silent < _MOST_ASKED:
            asked = [index] * _MOST_ASKED + [index + 1] * (index + 1 < n_items)
            answered = next((k for k in asked if self._item(k)), None)
            n_silent = n_silent + 1 if answered is None else 0
            index = index if answered is None else answered + 1
            self._require_progress()
            if self.progress is not None:
                self.progress(f"reading the {KIND_NAMES[self.kind]} back", len(self.found), n_items)

    def end(self) -> None:
        """Acknowledge, in several copies: one that is lost would block the vehicle's next transfer."""
        for _ in range(_COPIES):
            self.vehicle.mav.mission_ack_send(
                self.vehicle.system, self.vehicle.component, _MISSION_ACCEPTED, self.kind
            )

    def _item(self, index: int) -> bool:
        """Ask for one item; return whether it came."""
        self.vehicle.mav.mission_request_int_send(
            self.vehicle.system, self.vehicle.component, index, self.kind
        )
        message = self._received(("MISSION_ITEM_INT",), self.pace.wait_s)
        if message is None:
            return False
        self.found[message.seq] = LinkItem.received(message)
        if message.seq == index:  # also one that an earlier transfer found: their number is limited
            self.went_on = self.heard
        return bool(message.seq == index)

    def _require_progress(self) -> None:
        when = f"after {len(self.found)} items of the {KIND_NAMES[self.kind]} were read"
        _require_progress(self.vehicle, self.heard, self.went_on, when)

    def _received(self, types: tuple[str, ...], wait_s: float) -> Any | None:
        """Return an answer about this kind of items, or None after a time."""
        asked = monotonic()
        message = self.vehicle.receive(types, wait_s)
        if message is None:
            self.pace.silent()
            return None
        self.heard = monotonic()
        self.pace.answered(self.heard - asked)
        return message if message.mission_type == self.kind else None


def _clear(vehicle: Vehicle, kind: int) -> None:
    """Remove what the vehicle holds."""
    asked = monotonic()
    while True:
        vehicle.mav.mission_clear_all_send(vehicle.system, vehicle.component, kind)
        message = vehicle.receive(("MISSION_ACK",), _MISSION_RESEND_S)
        if message is not None and message.mission_type == kind and message.type == _MISSION_ACCEPTED:
            return
        heard = asked if message is None else monotonic()
        _require_progress(vehicle, heard, asked, f"while the {KIND_NAMES[kind]} was cleared")


def _ends(message: Any, vehicle: Vehicle, n_items: int, kind: int, *, is_begun: bool) -> bool:
    """Return whether an acknowledgement ends the transfer; raise where it refuses."""
    if message.type == _MISSION_ACCEPTED:
        return is_begun  # otherwise it belongs to an earlier transfer
    if message.type == _OUT_OF_ORDER or (message.type in _PASSING and not is_begun):
        return False  # the answer to an item that was sent ahead
    reason = _RESULTS.get(message.type, f"result {message.type} of MAV_MISSION_RESULT")
    sentence = f"{vehicle.name} refused the {KIND_NAMES[kind]} of {n_items} items for {reason}; it holds what it held before"
    if message.type in _PASSING:
        raise TransferBrokenError(f"{sentence}, run the command again.")
    raise InputError(f"{sentence}, change the route.")


def _send_item(vehicle: Vehicle, items: Sequence[LinkItem], index: int, kind: int) -> None:
    item = items[index]
    vehicle.mav.mission_item_int_send(
        vehicle.system,
        vehicle.component,
        index,
        item.frame,
        item.command,
        0,
        1,
        *item.params,
        item.x,
        item.y,
        item.z,
        kind,
    )


def _require_progress(vehicle: Vehicle, heard: float, went_on: float, when: str) -> None:
    """Refuse to wait longer than the patience for a vehicle that is silent, or that talks and does not go on."""
    now = monotonic()
    if now - heard > vehicle.patience_s:
        raise LinkLostError(
            f"{vehicle.address.text} was silent for {vehicle.patience_s:g} s {when}; the vehicle holds what it held "
            "before, restore the link and run the command again."
        )
    # A vehicle that went silent a while ago may have lost its link.
    if now - went_on > vehicle.patience_s and now - heard < 0.5 * vehicle.patience_s:
        raise TransferStalledError(
            f"{vehicle.name} talks, but did not go on for {vehicle.patience_s:g} s {when}; restart the autopilot and run the "
            "command again, with more --patience over a poor link."
        )


_ARM, _START = 400, 300
_COMMAND_ACCEPTED, _IN_PROGRESS = 0, 5
_COMMAND_RESEND_S = 1.0


def start_mission(vehicle: Vehicle) -> None:
    """Arm a vehicle and start its mission: it drives off."""
    _command(vehicle, _ARM, 1.0, "be armed")
    _command(vehicle, _START, 0.0, "start its mission")


def _command(vehicle: Vehicle, command: int, first: float, words: str) -> None:
    """Send a command until it is accepted."""
    began, confirmation = monotonic(), 0
    while monotonic() - began < vehicle.patience_s:
        others = (0.0,) * 6
        vehicle.mav.command_long_send(
            vehicle.system, vehicle.component, command, min(confirmation, 255), first, *others
        )
        confirmation += 1
        answer = vehicle.receive(("COMMAND_ACK",), _COMMAND_RESEND_S)
        if answer is None or answer.command != command or answer.result == _IN_PROGRESS:
            continue
        if answer.result == _COMMAND_ACCEPTED:
            return
        raise InputError(
            f"{vehicle.name} refused to {words} (MAV_RESULT {answer.result}); look at it in your ground station."
        )
    raise LinkLostError(
        f"{vehicle.address.text} did not answer the order to {words} for {vehicle.patience_s:g} s; restore the link."
    )


_MOST_TRANSFERS, _MOST_STALLED = 6, 3
MOST_UPLOAD_S = 600.0
"""Time after which an upload over a poor link is given up [s]."""


class UploadReport(NamedTuple):
    """What a vehicle holds after an upload, read back and equal to what was sent.

    `vehicle`: autopilot and system id. `items`, `fence_corners`: numbers of items; 0 corners where the fence
    was left as it was. `transfers`: how often items were sent: 1 for each of mission and fence, more after
    losses.
    """

    vehicle: str
    items: int
    fence_corners: int
    transfers: int


def upload(
    mission: AutopilotMission,
    address: LinkAddress,
    *,
    patience_s: float = 15.0,
    system: int | None = None,
    most_items: int | None = None,
    starts: bool = False,
    progress: Progress | None = None,
) -> UploadReport:
    """Upload a fence and a mission, and compare them with what the vehicle reports; give up after `MOST_UPLOAD_S`.

    The fence goes first, so that the vehicle never has the mission without it. A vehicle exchanges its mission when
    the last item has come; until then, and after any loss of the link, it holds the former one.

    `patience_s`: how long to wait for a silent vehicle [s].
    """
    with Vehicle.connected(address, patience_s, system) as vehicle:
        limits, n_home = limits_of(vehicle.autopilot), n_home_items(vehicle.autopilot)
        items, fence = mission.link_items(vehicle.autopilot), mission.fence_items
        require_storable(items, MISSION, most_items or limits.items, n_home)
        require_storable(fence, FENCE, most_items or limits.fence_corners)
        progress = _in_time(progress, vehicle)
        transfers = _until_equal(vehicle, fence, FENCE, 0, progress) if fence else 0
        transfers += _until_equal(vehicle, items, MISSION, n_home, progress)
        if starts:
            start_mission(vehicle)
        return UploadReport(vehicle.name, len(items), len(fence), transfers)


def _in_time(progress: Progress | None, vehicle: Vehicle) -> Progress:
    """Return the callback of progress, which ends an upload that takes too long."""
    until = monotonic() + MOST_UPLOAD_S

    def checked(what: str, done: int, total: int) -> None:
        if monotonic() > until:
            raise InputError(
                f"the upload to {vehicle.address.text} took longer than {MOST_UPLOAD_S:g} s ({what}, {done} of {total} items); "
                "the link loses too many packets, come nearer and run the command again."
            )
        if progress is not None:
            progress(what, done, total)

    return checked


def _until_equal(
    vehicle: Vehicle, items: Sequence[LinkItem], kind: int, n_home: int, progress: Progress | None
) -> int:
    """Send items until the vehicle reports them equal; return the number of transfers.

    The first `n_home` items are not compared: the vehicle has a home position of its own.
    """
    index: int | None = None
    n_stalled = 0
    for transfer in range(1, _MOST_TRANSFERS + 1):
        try:
            send_items(vehicle, items, kind, progress)
            found = fetch_items(vehicle, kind, progress)
        except LinkLostError as error:
            n_stalled += isinstance(error, TransferStalledError)
            if transfer == _MOST_TRANSFERS or n_stalled == _MOST_STALLED:
                raise
            vehicle.wait_for_heartbeat()
            continue
        index = first_difference(items[n_home:], found[n_home:])
        if index is None:
            return transfer
        index += n_home
    assert index is not None
    raise InputError(_difference(items, found, index, kind, vehicle))


def _difference(
    items: Sequence[LinkItem], found: Sequence[LinkItem], index: int, kind: int, vehicle: Vehicle
) -> str:
    """Return a sentence for items that came back different."""
    sent = items[index] if index < len(items) else "nothing"
    read = found[index] if index < len(found) else "nothing"
    return (
        f"{vehicle.name} reports {read} for item {index} of the {KIND_NAMES[kind]} where {sent} was sent; do not drive it, "
        "clear the mission and upload it again."
    )


def downloaded_route(
    address: LinkAddress,
    crs: Any = None,
    *,
    patience_s: float = 15.0,
    system: int | None = None,
    progress: Progress | None = None,
) -> Route:
    """Read the places of the mission that a vehicle holds; the log names commands that are left out.

    `patience_s`: how long to wait for a silent vehicle [s].
    """
    with Vehicle.connected(address, patience_s, system) as vehicle:
        items, n_home = fetch_items(vehicle, MISSION, progress), n_home_items(vehicle.autopilot)
        mission = Mission(tuple(item.as_mission_item for item in items[n_home:]), first=n_home)
        lonlat, notes = driven_places(mission, f"the mission of {vehicle.name}")
        if len(lonlat) < 2:
            raise InputError(
                f"{vehicle.name} holds {len(items)} items with {len(lonlat)} waypoints, and a route needs at least two; "
                "upload a mission to it first."
            )
    for note in notes:
        _logger.warning("the mission of %s: %s.", vehicle.name, note)
    return _route(lonlat, crs)


def _route(lonlat: FloatArray, crs: Any) -> Route:
    """Return the route through places (N, 2) [deg]; repeated places are one waypoint."""
    if crs is None:
        target = chosen_crs(lonlat[:, 0], lonlat[:, 1])
        _logger.warning("the mission is projected to %s.", target.name)
    else:
        target = projected_crs(crs, "the wanted CRS")
    return Route((Leg("swath", transformed(lonlat, WGS84, target, "the mission")),), target, "downloaded")

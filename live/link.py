"""MAVLink connection to one vehicle: its address, its heartbeat, and messages to and from it.

`LinkAddress` reads ``udp://HOST:PORT``, ``udpin://HOST:PORT``, ``tcp://HOST:PORT`` and ``serial:///dev/DEVICE:BAUD``. `Vehicle.connected`
opens the connection, waits for the heartbeat of an autopilot, and sends the heartbeat of a ground station. A vehicle
that sends nothing for as long as the patience raises `LinkLostError`. pymavlink is imported when a connection is opened.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import monotonic
from typing import Any
from urllib.parse import urlsplit

from survey.core import InputError

_EXPECTED = (
    "udp://HOST:PORT (sends to a vehicle), udpin://HOST:PORT (waits for one that sends to this port), "
    "tcp://HOST:PORT or serial:///dev/DEVICE:BAUD"
)
_OPENERS = {"udp": "udpout", "udpout": "udpout", "udpin": "udpin", "tcp": "tcp"}
_MOST_PORT = 65535


@dataclass(frozen=True)
class LinkAddress:
    """Address of a MAVLink connection.

    `text`: as the user wrote it. `device`: device in the notation of pymavlink. `baud`: bits per second of a
    serial line.
    """

    text: str
    device: str
    baud: int = 57600

    @classmethod
    def parsed(cls, text: str) -> "LinkAddress":
        """Read an address.

        >>> LinkAddress.parsed("udp://127.0.0.1:14550").device
        'udpout:127.0.0.1:14550'
        >>> LinkAddress.parsed("serial:///dev/ttyUSB0:115200").baud
        115200
        """
        scheme, _, rest = text.partition("://")
        if scheme == "serial" and rest:
            device, _, baud = rest.rpartition(":")
            if not baud.isdigit():
                device, baud = rest, "57600"
            return cls(text, device, int(baud))
        host, port = _host_and_port(text)
        if scheme not in _OPENERS or port is None:
            raise InputError(f"the address {text} is no MAVLink connection; {_EXPECTED} was expected.")
        return cls(text, f"{_OPENERS[scheme]}:{host}:{port}")


def _host_and_port(text: str) -> tuple[str, int | None]:
    """Return host and port; no port where the address is not valid."""
    try:
        parts = urlsplit(text)
        port = parts.port
    except ValueError:
        return "", None
    if port is None or not 0 < port <= _MOST_PORT or parts.path not in ("", "/"):
        return "", None
    return parts.hostname or "0.0.0.0", port  # as in udpin://:14550


GROUND_STATION, GROUND_STATION_COMPONENT = 255, 190
AUTOPILOT_COMPONENT = 1
ARDUPILOT, PX4 = 3, 12
"""Values of MAV_AUTOPILOT in the heartbeat."""
_TYPE_GCS, _AUTOPILOT_INVALID, _STATE_ACTIVE = 6, 8, 4
_HEARTBEAT_S = 1.0
_WAIT_S = 0.05
NAMES = {ARDUPILOT: "ArduPilot", PX4: "PX4"}
"""Autopilots by that value."""


class LinkLostError(InputError):
    """Nothing was received from a vehicle for as long as was waited."""


class Vehicle:
    """A vehicle whose heartbeat was received.

    `connection`: of pymavlink's ``mavutil.mavlink_connection``. `address`: where it was opened, for messages.
    `patience_s`: time without any message after which the link counts as lost [s]. `system`: system id to
    speak to; by default the first whose autopilot is heard.
    """

    def __init__(
        self, connection: Any, address: LinkAddress, patience_s: float, system: int | None = None
    ) -> None:
        self.connection, self.address, self.patience_s = connection, address, patience_s
        self.system, self.component, self.autopilot = system, AUTOPILOT_COMPONENT, 0
        self._heartbeat_due = 0.0

    @classmethod
    @contextmanager
    def connected(
        cls, address: LinkAddress, patience_s: float = 15.0, system: int | None = None
    ) -> "Iterator[Vehicle]":
        """Open a connection, wait for the vehicle's heartbeat, and close the connection at the end.

        `patience_s`: how long to wait for a message [s].
        """
        connection = opened(address)
        try:
            vehicle = cls(connection, address, patience_s, system)
            vehicle.wait_for_heartbeat()
            yield vehicle
        finally:
            connection.close()

    @property
    def mav(self) -> Any:
        """Messages to be sent, as methods of pymavlink."""
        return self.connection.mav

    @property
    def name(self) -> str:
        """Autopilot and system id in words."""
        return f"{NAMES.get(self.autopilot, 'the autopilot')} of system {self.system}"

    def wait_for_heartbeat(self) -> None:
        """Wait for the heartbeat of an autopilot."""
        until = monotonic() + self.patience_s
        while monotonic() < until:
            message = self._next(("HEARTBEAT",), _WAIT_S)
            if message is None or message.get_srcComponent() != AUTOPILOT_COMPONENT:
                continue
            if message.type == _TYPE_GCS or self.system not in (None, message.get_srcSystem()):
                continue
            self.system, self.autopilot = message.get_srcSystem(), message.autopilot
            return
        who = "no vehicle" if self.system is None else f"no vehicle of system {self.system}"
        raise LinkLostError(
            f"{who} answered at {self.address.text} for {self.patience_s:g} s; check address, radio and power."
        )

    def receive(self, types: tuple[str, ...], timeout_s: float) -> Any | None:
        """Return the next message of some types from this vehicle, or None after a time.

        `timeout_s`: how long to wait [s].
        """
        until = monotonic() + timeout_s
        while (left_s := until - monotonic()) > 0.0:
            message = self._next(types, min(left_s, _WAIT_S))
            if message is not None and message.get_srcSystem() == self.system:
                return message
        return None

    def _next(self, types: tuple[str, ...], timeout_s: float) -> Any | None:
        """Return the next message of some types from anybody; say once a second that a ground station is here."""
        if monotonic() >= self._heartbeat_due:
            self.mav.heartbeat_send(_TYPE_GCS, _AUTOPILOT_INVALID, 0, 0, _STATE_ACTIVE)
            self._heartbeat_due = monotonic() + _HEARTBEAT_S
        try:
            return self.connection.recv_match(type=list(types), blocking=True, timeout=timeout_s)
        except ConnectionError:
            return None


def opened(address: LinkAddress) -> Any:
    """Open a connection of MAVLink 2."""
    os.environ.setdefault("MAVLINK20", "1")
    from pymavlink import mavutil

    try:
        return mavutil.mavlink_connection(
            address.device,
            baud=address.baud,
            source_system=GROUND_STATION,
            source_component=GROUND_STATION_COMPONENT,
            retries=1,
        )
    except ModuleNotFoundError as error:  # pymavlink loads its serial driver when a serial line is opened
        raise InputError(
            f"{address.text} needs the package pyserial, which is not installed; run `pip install pyserial`."
        ) from error
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(
            f"{address.text} cannot be opened ({reason}); check the address and that no other program uses it."
        ) from error

"""Simulated rover behind MAVSDK's servers, in a process of its own.

`WaypointDrive` is its drawn motion and sensors: it follows its waypoints at constant speed, and fixes err. `Radio` is its
UDP socket, with a radio link that loses packets. `serve_rover` is the process: MAVSDK holds mission and fence and runs
the protocols with the ground station; the rover takes what was received, drives, and publishes where it is. Starting a
mission (MAV_CMD_MISSION_START) is no action of MAVSDK and is answered here.
"""

import json
import queue
import socket
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from time import monotonic
from typing import Any, NamedTuple

import numpy as np
import shapely
from mavsdk import logging as mavsdk_logging
from mavsdk.component_type import ComponentType
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.action_server.action_server import ActionServer, AllowableFlightModes
from mavsdk.plugins.mavlink_direct_server.mavlink_direct_server import MavlinkDirectServer, MavlinkMessage
from mavsdk.plugins.mission_raw_server.mission_raw_server import MissionRawServer, MissionRawServerResult
from mavsdk.plugins.param_server.param_server import ParamServer
from mavsdk.plugins.telemetry_server.telemetry_server import AngularVelocityBody as AngularVelocity
from mavsdk.plugins.telemetry_server.telemetry_server import (
    Battery,
    EulerAngle,
    FixType,
    GpsInfo,
    Heading,
    Position,
    RawGps,
    TelemetryServer,
    VelocityNed,
)
from pyproj import CRS

from live.mission_items import EXCLUSION_POLYGON, FENCE, INCLUSION_POLYGON, MISSION, LinkItem
from survey import Dem, InputError
from survey.core import FloatArray, stream
from survey.core.transformation import WGS84, chosen_crs, transformed

_STEP_M = 0.5


@dataclass(frozen=True)
class RoverSettings:
    """What the simulated rover is like.

    `speed_m_s`: speed along the path. `range_m`: distance that one charge of the battery lasts [m].
    `sigma_horizontal_m`, `sigma_vertical_m`: standard deviation of a fix east and north, and up [m].
    `correlation_time_s`: time constant of the fixes' Gauss-Markov errors [s]. `seed`: of the drawn errors.
    """

    speed_m_s: float = 1.0
    range_m: float = 12_000.0
    sigma_horizontal_m: float = 0.02
    sigma_vertical_m: float = 0.03
    correlation_time_s: float = 2.0
    seed: int = 0


class RoverReport(NamedTuple):
    """State that telemetry reports.

    `time_s`: since the start [s]. `xy` (2,): real place in `WaypointDrive.crs` [m]. `lonlat` (2,): measured
    place [deg]. `height_m`: measured height [m]. `heading_deg`: clockwise from north. `speed_m_s`: over
    ground; 0 at rest. `battery`: share of the charge that is left. `waypoint`: waypoints that were reached.
    `is_held`: whether it stopped at the fence.
    """

    time_s: float
    xy: FloatArray
    lonlat: FloatArray
    height_m: float
    heading_deg: float
    speed_m_s: float
    battery: float
    waypoint: int
    is_held: bool


@dataclass
class WaypointDrive:
    """Motion of the rover in a projected CRS.

    `settings`: speed, battery, errors. `crs`: in metres. `terrain`: heights; 0 without it.
    """

    settings: RoverSettings
    crs: CRS
    terrain: Dem | None = None
    path: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    fence: shapely.Geometry | None = None
    is_driving: bool = False
    is_held: bool = False
    time_s: float = 0.0
    driven_m: float = 0.0
    _along_m: float = 0.0

    def __post_init__(self) -> None:
        self._rng = stream(self.settings.seed, "live.rover.fixes")
        self._error = self._rng.normal(size=3)
        self.xy = np.zeros(2)

    @classmethod
    def over(cls, settings: RoverSettings, terrain: Dem | None, first: LinkItem) -> "WaypointDrive":
        """Return a rover at rest at the first waypoint, in the CRS of the terrain or the waypoint's UTM zone."""
        latitude, longitude = first.degrees
        crs = terrain.crs if terrain is not None else chosen_crs(np.array([longitude]), np.array([latitude]))
        drive = cls(settings, crs, terrain)
        drive.xy = drive.places([first])[0]
        return drive

    def places(self, items: list[LinkItem]) -> FloatArray:
        """Return the places (N, 2) of items in the CRS of the drive [m]."""
        degrees = np.array([item.degrees[::-1] for item in items])
        return transformed(degrees, WGS84, self.crs, "the mission")

    def set_mission(self, items: list[LinkItem]) -> None:
        """Exchange the waypoints; the rover stops and waits to be started."""
        waypoints = [item for item in items if item.is_waypoint]
        self.path = self.places(waypoints) if waypoints else np.zeros((0, 2))
        self.is_driving, self.is_held, self._along_m = False, False, 0.0

    def set_fence(self, items: list[LinkItem]) -> None:
        """Exchange the fence: polygons of inclusion and exclusion."""
        self.fence = _fence_of(items, self)

    def start(self) -> None:
        """Begin to drive, from where the rover is to the first waypoint."""
        if len(self.path) and not self.is_driving:
            self.path = np.vstack([self.xy, self.path])
            self._along_m, self.is_driving = 0.0, True

    def advance(self, seconds: float) -> RoverReport:
        """Drive for some time, and return what telemetry reports."""
        self.time_s += seconds
        self._draw_error(seconds)
        heading, moves, waypoint = 0.0, False, 0
        if self.is_driving and not self.is_held:
            heading, moves, waypoint = self._follow(self.settings.speed_m_s * seconds)
        return self._state(heading, self.settings.speed_m_s if moves else 0.0, waypoint)

    def _follow(self, distance_m: float) -> tuple[float, bool, int]:
        """Go on along the path; return heading [deg], whether it moves, and the waypoints reached."""
        ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self.path, axis=0).T))])
        before = self._along_m
        self._along_m = min(before + distance_m, float(ends[-1]))
        ahead = min(self._along_m + _STEP_M, float(ends[-1]))
        xy, beyond = (
            np.array([np.interp(s, ends, axis) for axis in self.path.T]) for s in (self._along_m, ahead)
        )
        if self.fence is not None and not self.fence.covers(shapely.Point(xy)):
            self.is_held = True
            return 0.0, False, 0
        east, north = beyond - xy if ahead > self._along_m else self.path[-1] - self.path[-2]
        self.xy = xy
        self.driven_m += self._along_m - before
        self.is_driving = self._along_m < float(ends[-1])
        reached = int(np.searchsorted(ends, self._along_m + 1e-9, side="right")) - 1
        return float(np.degrees(np.arctan2(east, north)) % 360.0), self._along_m > before, reached

    def _draw_error(self, seconds: float) -> None:
        """Advance the Gauss-Markov errors of the fixes, in standard deviations."""
        share = float(np.exp(-seconds / self.settings.correlation_time_s))
        self._error = share * self._error + np.sqrt(1.0 - share**2) * self._rng.normal(size=3)

    def _state(self, heading_deg: float, speed_m_s: float, waypoint: int) -> RoverReport:
        sigma = self.settings.sigma_horizontal_m
        measured = transformed((self.xy + sigma * self._error[:2])[None], self.crs, WGS84, "the rover")[0]
        ground = 0.0 if self.terrain is None else float(np.nan_to_num(self.terrain.at(self.xy[None])[0]))
        height = ground + self.settings.sigma_vertical_m * float(self._error[2])
        battery = max(0.0, 1.0 - self.driven_m / self.settings.range_m)
        return RoverReport(
            self.time_s, self.xy, measured, height, heading_deg, speed_m_s, battery, waypoint, self.is_held
        )


def _fence_of(items: list[LinkItem], drive: WaypointDrive) -> shapely.Geometry | None:
    """Return the ground within all inclusions and outside all exclusions; None without polygons."""
    inside: shapely.Geometry | None = None
    outside: list[shapely.Geometry] = []
    index = 0
    while index < len(items):
        item, n = items[index], max(int(items[index].params[0]), 1)
        if item.command in (INCLUSION_POLYGON, EXCLUSION_POLYGON):
            polygon = shapely.Polygon(drive.places(items[index : index + n]))
            if item.command == INCLUSION_POLYGON:
                inside = polygon if inside is None else inside.union(polygon)
            else:
                outside.append(polygon)
            index += n
        else:
            index += 1
    return None if inside is None else inside.difference(shapely.union_all(outside))


_LARGEST = 65_535


class Radio:
    """Datagrams to and from the ground station that was heard last.

    `host`: address to listen at. `port`: UDP port; 0 for a free one. `loss`: share of packets that are lost,
    in either direction. `seed`: of the losses.
    """

    def __init__(self, host: str, port: int, loss: float = 0.0, seed: int = 0) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 21)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise InputError(
                f"the rover cannot listen at {host}:{port} ({error.strerror}); choose another port."
            ) from error
        self._loss = loss
        self._up, self._down = stream(seed, "live.radio.up"), stream(seed, "live.radio.down")
        self._peer: tuple[str, int] | None = None

    @property
    def port(self) -> int:
        """Port that it listens at."""
        return int(self._socket.getsockname()[1])

    def receive(self, timeout_s: float) -> bytes | None:
        """Return the next datagram that arrives, or None after a time.

        `timeout_s`: how long to wait [s]. Returns: a datagram; None also for one that was lost.
        """
        self._socket.settimeout(timeout_s)
        try:
            data, self._peer = self._socket.recvfrom(_LARGEST)
        except (TimeoutError, ConnectionError):
            return None
        return None if self._up.random() < self._loss else data

    def send(self, data: bytes) -> None:
        """Send a datagram to the ground station, unless it is lost or nobody was heard yet."""
        if self._peer is None or self._down.random() < self._loss:
            return
        with suppress(OSError):
            self._socket.sendto(data, self._peer)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


START_MISSION = 300
_HDOP, _SATELLITES, _VOLTS = 0.6, 20, 24.0


class Received(NamedTuple):
    """What the ground station sent: kind 0 a mission, 1 a fence, None the order to start."""

    kind: int | None
    items: list[LinkItem]


class RoverServers:
    """Servers of MAVSDK whose packets go through a radio.

    `radio`: where packets come from and go to. `settings`: their values are parameters of the rover.
    """

    def __init__(self, radio: Radio, settings: RoverSettings) -> None:
        self.received: queue.SimpleQueue[Received] = queue.SimpleQueue()
        mavsdk_logging.log_subscribe(lambda *_: True)  # stdout is the command's
        self._mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.AUTOPILOT))
        self._mavsdk.add_any_connection("raw://")
        self._mavsdk.subscribe_raw_bytes_to_be_sent(radio.send)
        component = self._mavsdk.server_component()
        self._parameters = ParamServer(component)
        self._parameters.provide_param_float("WP_SPEED", settings.speed_m_s)
        self._actions = _armable(ActionServer(component))
        self._missions = MissionRawServer(component)
        self._missions.subscribe_incoming_mission(self._take_items)
        self._missions.subscribe_clear_all(lambda *_: self.received.put(Received(0, [])))
        self._direct = MavlinkDirectServer(component)
        self._direct.subscribe_command(START_MISSION, self._take_start)
        self._telemetry = TelemetryServer(component)
        self._waypoint = 0

    def receive(self, packet: bytes) -> None:
        """Hand a packet from the radio to the servers."""
        self._mavsdk.pass_received_raw_bytes(packet)

    def publish(self, state: RoverReport, settings: RoverSettings) -> None:
        """Publish position, fix, attitude and battery, and the waypoints that were reached."""
        longitude, latitude = state.lonlat.tolist()
        place = latitude, longitude, state.height_m
        self._telemetry.publish_position(
            Position(*place, 0.0), VelocityNed(0.0, 0.0, 0.0), Heading(state.heading_deg)
        )
        accuracy = settings.sigma_horizontal_m, settings.sigma_vertical_m, 0.05, 1.0
        microseconds = round(1e6 * state.time_s)
        fix = RawGps(
            microseconds, *place, _HDOP, _HDOP, state.speed_m_s, state.heading_deg, place[2], *accuracy
        )
        self._telemetry.publish_raw_gps(fix, GpsInfo(_SATELLITES, FixType.RTK_FIXED))
        self._telemetry.publish_attitude(
            EulerAngle(0.0, 0.0, state.heading_deg, microseconds), AngularVelocity(0.0, 0.0, 0.0)
        )
        battery = Battery(voltage_v=_VOLTS, remaining_percent=100.0 * state.battery)
        self._telemetry.publish_sys_status(battery, True, True, True, True, True)
        while self._waypoint < state.waypoint:
            self._missions.set_current_item_complete()
            self._waypoint += 1

    def close(self) -> None:
        """End the servers."""
        self._mavsdk.destroy()

    def _take_items(self, result: MissionRawServerResult, plan: Any, _: Any) -> None:
        """Queue a complete mission or fence; MAVSDK hands over nothing else."""
        if result is not MissionRawServerResult.SUCCESS or not plan.mission_items:
            return
        items = [
            LinkItem(
                one.command, one.frame, (one.param1, one.param2, one.param3, one.param4), one.x, one.y, one.z
            )
            for one in plan.mission_items
        ]
        self._waypoint = 0
        self.received.put(Received(plan.mission_items[0].mission_type, items))

    def _take_start(self, command: Any, _: Any) -> None:
        """Queue the order to start, and acknowledge it."""
        self.received.put(Received(None, []))
        fields = {"command": START_MISSION, "result": 0, "progress": 0, "result_param2": 0}
        fields |= {"target_system": command.system_id, "target_component": command.component_id}
        answer = MavlinkMessage(
            "COMMAND_ACK", 1, 1, command.system_id, command.component_id, json.dumps(fields)
        )
        self._direct.send_message(answer)


def _armable(actions: ActionServer) -> ActionServer:
    """Allow arming and the mode of missions."""
    actions.set_armable(True, True)
    actions.set_disarmable(True, True)
    actions.set_allowable_flight_modes(AllowableFlightModes(True, True, False))
    return actions


_TELEMETRY_S = 0.2
_WAIT_S = 0.005
# Telemetry comes no more often than this, however fast the rover drives; a busy machine slows the rover instead of making
# it jump farther than this.
_LEAST_TELEMETRY_S, _MOST_STEP_S = 0.02, 4.0


def serve_rover(
    radio: Radio,
    settings: RoverSettings,
    terrain: Dem | None = None,
    *,
    hasten: float = 1.0,
    until: Callable[[], bool] = lambda: False,
) -> None:
    """Serve a simulated rover until it is ended."""
    servers = RoverServers(radio, settings)
    rover = _Rover(settings, terrain)
    last, every_s = monotonic(), max(_TELEMETRY_S / max(hasten, 1.0), _LEAST_TELEMETRY_S)
    try:
        while not until():
            packet = radio.receive(_WAIT_S)
            if packet is not None:
                servers.receive(packet)
            while not servers.received.empty():
                rover.receive(servers.received.get())
            now = monotonic()
            if now - last < every_s:
                continue
            if rover.drive is not None:
                servers.publish(rover.drive.advance(min(hasten * (now - last), _MOST_STEP_S)), settings)
            last = now
    finally:
        servers.close()
        radio.close()


class _Rover:
    """The rover, without a position before its first mission."""

    def __init__(self, settings: RoverSettings, terrain: Dem | None) -> None:
        self.settings, self.terrain = settings, terrain
        self.drive: WaypointDrive | None = None
        self._fence: Received | None = None

    def receive(self, received: Received) -> None:
        """Take a mission, a fence or the order to start."""
        if received.kind == FENCE:
            self._fence = received
        elif received.kind == MISSION:
            first = next((item for item in received.items if item.is_waypoint), None)
            if self.drive is None and first is not None:
                self.drive = WaypointDrive.over(self.settings, self.terrain, first)
            if self.drive is not None:
                self.drive.set_mission(received.items)
        elif self.drive is not None:
            self.drive.start()
        if self.drive is not None and self._fence is not None:
            self.drive.set_fence(self._fence.items)

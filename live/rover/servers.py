"""Process of the simulated rover behind MAVSDK's servers: mission, telemetry, parameters, actions.

MAVSDK holds mission and fence, runs the protocols with the ground station. The rover behind it takes what was
received, drives, and publishes where it is (`serve_rover`). Starting a mission (MAV_CMD_MISSION_START) is no action of
MAVSDK and is answered here.
"""

import json
import queue
from collections.abc import Callable
from time import monotonic
from typing import Any, NamedTuple

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

from live.mission.items import FENCE, MISSION, LinkItem
from live.rover.drive import RoverReport, RoverSettings, WaypointDrive
from live.rover.radio import Radio
from survey.data.dem import Dem

START_MISSION = 300
_HDOP, _SATELLITES, _VOLTS = 0.6, 20, 24.0


class Received(NamedTuple):
    """What the ground station sent: kind 0 a mission, 1 a fence, None the order to start."""

    kind: int | None
    items: list[LinkItem]


class RoverServers:
    """Servers of MAVSDK whose packets go through a radio.

    Parameters
    ----------
    radio : Radio
        Where packets come from and go to.
    settings : RoverSettings
        Their values are parameters of the rover.
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

    def take(self, packet: bytes) -> None:
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
    """Serve a simulated rover until it is ended.

    Parameters
    ----------
    radio : Radio
        Link to the ground station.
    settings : RoverSettings
        Speed, battery, errors of fixes.
    terrain : Dem, optional
        Heights that the rover measures.
    hasten : float
        How many seconds it drives in a second.
    until : callable
        Ends the rover when it returns True.
    """
    servers = RoverServers(radio, settings)
    rover = _Rover(settings, terrain)
    last, every_s = monotonic(), max(_TELEMETRY_S / max(hasten, 1.0), _LEAST_TELEMETRY_S)
    try:
        while not until():
            packet = radio.receive(_WAIT_S)
            if packet is not None:
                servers.take(packet)
            while not servers.received.empty():
                rover.take(servers.received.get())
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
    """The rover, which is nowhere before its first mission."""

    def __init__(self, settings: RoverSettings, terrain: Dem | None) -> None:
        self.settings, self.terrain = settings, terrain
        self.drive: WaypointDrive | None = None
        self._fence: Received | None = None

    def take(self, received: Received) -> None:
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

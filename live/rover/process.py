"""Process of the simulated rover: take packets, drive, publish telemetry."""

from collections.abc import Callable
from time import monotonic

from live.mission.items import FENCE, MISSION
from live.rover.drive import RoverSettings, WaypointDrive
from live.rover.radio import Radio
from live.rover.servers import Received, RoverServers
from survey.data.dem import Dem

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

"""Drive of the simulated rover that other programs see and command, in real time.

`ServedDrive` is the operator of a drive (`sim.simulate.vision.drive_by_commands`): it holds the drive back to the wall clock,
publishes what the rover senses, and takes velocities from clients (`Commands`). The transport is `live.foxglove_server`.
"""

import threading
import time
from dataclasses import dataclass, field
from typing import Any, Self

from pyproj import CRS

from live.foxglove import CHANNELS, TRUTH_TOPIC, DriveMessages
from live.foxglove_server import FoxgloveServer
from sim.config.mission import MissionConfig
from sim.simulate.navigator import Start
from sim.simulate.vision import Velocity
from sim.vehicle.motion import RoverState
from survey.data.recording import Readings

COMMAND_TOPIC, IMAGE_TOPIC = "/cmd_vel", "/camera/image"
SILENCE_S = 0.5
"""Time without a command after which the rover stops [s]."""
_STILL = Velocity(0.0, 0.0)
_POLL_S = 0.1
_TWIST = (
    '{"linear": {"x": speed in m/s}, "angular": {"z": rate of turn in rad/s}} was expected, as of '
    "geometry_msgs/Twist, with all other parts 0 or left out."
)


class Commands:
    """Velocities that clients command; the latest counts, and the rover stops when none arrive.

    `max_speed_m_s`, `max_turn_rate_rad_s`: what is refused beyond [m/s, rad/s].

    >>> commands = Commands(1.0, 0.8)
    >>> commands.receive("/cmd_vel", {"linear": {"x": 0.5}})
    ''
    >>> commands.at(3.0).speed_m_s, commands.at(3.5).speed_m_s, commands.at(3.6).speed_m_s
    (0.5, 0.5, 0.0)
    """

    def __init__(self, max_speed_m_s: float, max_turn_rate_rad_s: float) -> None:
        self._limits = Velocity(max_speed_m_s, max_turn_rate_rad_s)
        self._latest, self._used = (_STILL, 0), 0
        self._heard_s, self._is_silent = 0.0, True
        self.n_refused, self.n_silences = 0, 0

    @property
    def n_received(self) -> int:
        """Number of commands that were accepted."""
        return self._latest[1]

    def receive(self, topic: str, content: Any) -> str:
        """Take a message of a client; return why it is refused, or nothing. Called in the thread of the server."""
        refusal = self._refusal(topic, content)
        if refusal:
            self.n_refused += 1
        else:
            speed, turn_rate = _parts(content)[0]
            self._latest = Velocity(float(speed), float(turn_rate)), self._latest[1] + 1
        return refusal

    def _refusal(self, topic: str, content: Any) -> str:
        if topic != COMMAND_TOPIC:
            return f"nothing is done with messages of that topic; publish commands to {COMMAND_TOPIC}."
        try:
            wanted, others = _parts(content)
        except (AttributeError, TypeError):
            return f"the command is malformed; {_TWIST}"
        if any(others):
            return f"the command has parts that a tracked rover cannot follow; {_TWIST}"
        if not all(abs(part) <= limit for part, limit in zip(wanted, self._limits, strict=True)):
            speed, turn_rate = self._limits
            return f"the command is too fast; at most {speed:g} m/s and {turn_rate:g} rad/s are driven."
        return ""

    def at(self, time_s: float) -> Velocity:
        """Return the velocity to drive at a time of the drive; 0 after half a second without a command."""
        velocity, number = self._latest
        if number != self._used:
            self._used, self._heard_s, self._is_silent = number, time_s, False
        elif not self._is_silent and time_s - self._heard_s > SILENCE_S:
            self._is_silent = True
            self.n_silences += 1
        return _STILL if self._is_silent else velocity


def _parts(content: Any) -> tuple[tuple[Any, Any], list[Any]]:
    """Return speed ahead and rate of turn of a twist, and its other parts; each is a number."""
    parts = {
        (vector, axis): content.get(vector, {}).get(axis, 0.0)
        for vector in ("linear", "angular")
        for axis in "xyz"
    }
    if not all(isinstance(value, int | float) for value in parts.values()):
        raise TypeError
    wanted = parts.pop(("linear", "x")), parts.pop(("angular", "z"))
    return wanted, list(parts.values())


class RealTime:
    """Wall clock in the time of the drive.

    `hasten`: seconds of the drive in a second.
    """

    def __init__(self, hasten: float = 1.0) -> None:
        self._hasten, self._zero_s = hasten, float("nan")

    def begin(self, time_s: float) -> None:
        """Let it be a time of the drive now."""
        self._zero_s = time.monotonic() - time_s / self._hasten

    def now_s(self) -> float:
        """Return the time of the drive by the wall clock."""
        return (time.monotonic() - self._zero_s) * self._hasten

    def wait_until(self, time_s: float) -> None:
        """Wait until a time of the drive; a drive that is late goes on at once."""
        time.sleep(max(time_s - self.now_s(), 0.0) / self._hasten)


@dataclass
class ServeReport:
    """What was sent and received on a drive.

    `images`: images that were taken; `late_images` of them were published more than the time between two images after
    they were taken, `most_delay_s` at most [s]. `sent`, `dropped`: messages by topic, over all clients; those were dropped
    that a client read too slowly for. `commands`, `refused_commands`: of all clients. `stops`: times that the rover stopped
    because no command arrived.
    """

    images: int = 0
    late_images: int = 0
    most_delay_s: float = 0.0
    sent: dict[str, int] = field(default_factory=dict)
    dropped: dict[str, int] = field(default_factory=dict)
    commands: int = 0
    refused_commands: int = 0
    stops: int = 0

    def lines(self) -> list[tuple[str, str]]:
        """Return names and sentences."""
        late = f"{self.late_images} late (at most {self.most_delay_s:.2f} s)"
        sent, dropped = self.sent.get(IMAGE_TOPIC, 0), self.dropped.get(IMAGE_TOPIC, 0)
        others = sum(self.dropped.values()) - dropped
        return [
            ("images", f"{self.images} taken, {sent} sent, {dropped} dropped, {late}"),
            ("other messages", f"{sum(self.sent.values()) - sent} sent, {others} dropped"),
            ("commands", f"{self.commands} received, {self.refused_commands} refused, {self.stops} times silent"),
        ]  # fmt: skip


class ServedDrive:
    """Operator of a drive whose clients command it.

    `mission`: limits of speed and turn, rate of images, mountings. `address`: HOST:PORT. `truth`: whether real poses are
    published too. `clock`: what holds the drive back.
    """

    def __init__(
        self, mission: MissionConfig, address: str, *, truth: bool = False, clock: RealTime | None = None
    ) -> None:
        self._mission, self._truth, self._clock = mission, truth, clock or RealTime()
        speed_m_s, turn_rate_rad_s = mission.rover.speed_m_s, mission.physics.max_turn_rate_rad_s
        self._commands = Commands(speed_m_s, turn_rate_rad_s)
        channels = CHANNELS | ({TRUTH_TOPIC: "foxglove.PoseInFrame"} if truth else {})
        limits = {"max_speed_m_s": f"{speed_m_s:g}", "max_turn_rate_rad_s": f"{turn_rate_rad_s:g}"}
        self._server = FoxgloveServer(address, channels, self._commands.receive, limits)
        self._stopped, self._began, self._report = threading.Event(), False, ServeReport()

    def __enter__(self) -> Self:
        self._server.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.__exit__()

    @property
    def url(self) -> str:
        """Address for clients."""
        return self._server.url

    def stop(self) -> None:
        """End the drive at the next step."""
        self._stopped.set()

    def begin(self, start: Start, crs: CRS) -> None:
        """Publish the mountings, and wait for the first client."""
        rover, physics = self._mission.rover, self._mission.physics
        self._messages = DriveMessages(start, crs, rover.antenna_height_m, physics.track_gauge_m)
        self._server.publish("/tf_static", 0.0, self._messages.transforms())
        while not (self._server.connected.wait(_POLL_S) or self._stopped.is_set()):
            pass

    def step(self, readings: Readings, state: RoverState) -> Velocity | None:
        """Publish readings when it is their time; return the velocity to drive next, or None after `stop`."""
        if not self._began:
            self._began = True
            self._clock.begin(state.time_s)  # after the first image, which takes longer than the others
        self._clock.wait_until(state.time_s)
        self._server.publish_time(state.time_s)
        for message in self._messages.of(readings):
            self._server.publish(*message)
        if self._truth:
            self._server.publish(*self._messages.truth(state))
        if readings.frame is not None:
            self._count_image(readings.frame[0])
        return None if self._stopped.is_set() else self._commands.at(state.time_s)

    def _count_image(self, time_s: float) -> None:
        delay_s = self._clock.now_s() - time_s
        self._report.images += 1
        self._report.late_images += delay_s * self._mission.instruments.frame_rate_hz > 1.0
        self._report.most_delay_s = max(self._report.most_delay_s, delay_s)

    def finish(self) -> ServeReport:
        """Close all connections, and return what was sent and received."""
        self._server.__exit__()
        report, commands = self._report, self._commands
        report.sent = {topic: n for topic, n in self._server.sent.items() if topic}
        report.dropped = {topic: n for topic, n in self._server.dropped.items() if n}
        report.commands, report.refused_commands = commands.n_received, commands.n_refused
        report.stops = commands.n_silences
        return report

"""The simulated rover driven by another program in real time: 10 minutes at 4 images of 640 × 480 a second.

The server is a process of its own. This one is the client: it drives around a rectangle by wheels, gyro and fixes. Real poses
are used to score it and for nothing else. Other programs on the machine make images late.
"""

import cmath
import json
import math
import resource
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

from benchmarks.report import Row, main
from live.foxglove import CHANNELS, TRUTH_TOPIC
from live.foxglove_server import PROTOCOLS
from live.served_drive import COMMAND_TOPIC, IMAGE_TOPIC

EXAMPLE = Path(__file__).parents[1] / "examples" / "short_drive.toml"
GOALS = (14 + 0j, 14 + 8j, 0 + 8j, 0j)
"""Corners that are driven to, east and north of the start [m]."""
_REACHED_M, _SPEED_M_S, _DEGREE_M, _INERTIAL_HZ = 0.5, 0.7, 111_200.0, 80.0
_DRIVE_S, _SHORT_S = 600.0, 60.0


@dataclass
class Driver:
    """Reckoning of the place as a complex number, east and north of the start, and what it received."""

    place: complex = 0j
    heading_rad: float = 0.0
    rolled_m: float = 0.0
    first_fix: complex | None = None
    real: complex = 0j
    goals: int = 0
    misses_m: list[float] = field(default_factory=list)
    images: int = 0
    time_s: float = 0.0

    def take(self, topic: str, message: dict[str, Any]) -> dict[str, Any] | None:
        """Take a message; return the command that an image is answered with."""
        if topic == "/tf_static":
            turn = next(one["rotation"] for one in message["transforms"] if one["child_frame_id"] == "odom")
            self.heading_rad = 2.0 * math.atan2(turn["z"], turn["w"])
        elif topic == "/imu/data":
            self.heading_rad += message["angular_velocity"]["z"] / _INERTIAL_HZ
        elif topic == "/wheel/odometry":
            before_m, self.rolled_m = self.rolled_m, 0.5 * (message["left_m"] + message["right_m"])
            self.place += cmath.rect(self.rolled_m - before_m, self.heading_rad)
        elif topic == "/gps/fix":
            self._correct(message["longitude"], message["latitude"])
        elif topic == TRUTH_TOPIC:
            position = message["pose"]["position"]
            self.real = complex(position["x"], position["y"])
        elif topic == IMAGE_TOPIC:
            self.images += 1
            self.time_s = message["timestamp"]["sec"] + 1e-9 * message["timestamp"]["nsec"]
            return self._command()
        return None

    def _correct(self, longitude: float, latitude: float) -> None:
        self.first_fix = self.first_fix or complex(longitude, latitude)
        away = complex(longitude, latitude) - self.first_fix
        east_north_m = complex(away.real * math.cos(math.radians(latitude)), away.imag) * _DEGREE_M
        self.place += 0.02 * (east_north_m - self.place)

    def _command(self) -> dict[str, Any]:
        goal = GOALS[self.goals % len(GOALS)]
        if abs(goal - self.place) < _REACHED_M:
            self.goals += 1
            self.misses_m.append(abs(goal - self.real))
        angle = cmath.phase((goal - self.place) * cmath.rect(1.0, -self.heading_rad))
        speed_m_s = _SPEED_M_S * max(math.cos(angle), 0.0)
        return {"linear": {"x": speed_m_s}, "angular": {"z": max(-0.6, min(0.6, angle))}}


def drive(address: str, lasts_s: float) -> tuple[Driver, float]:
    """Drive for a time of the drive; return the driver, and the time by the wall clock between first and last image [s]."""
    driver, began_s, ended_s = Driver(), math.nan, math.nan
    with connect(address, subprotocols=PROTOCOLS, max_size=None) as link:
        topics = _joined(link)
        while driver.time_s < lasts_s:
            data = link.recv()
            if isinstance(data, str):
                raise RuntimeError(data)
            if data[0] != 1:
                continue
            command = driver.take(topics[struct.unpack_from("<BI", data)[1]], json.loads(data[13:]))
            if command is not None:
                link.send(struct.pack("<BI", 1, 1) + json.dumps(command).encode())
                ended_s = time.monotonic()
                began_s = ended_s if math.isnan(began_s) else began_s
    return driver, ended_s - began_s


def _joined(link: ClientConnection) -> dict[int, str]:
    """Subscribe to all channels and advertise commands; return the topics of the channels."""
    _, advertised = link.recv(), json.loads(link.recv())
    topics: dict[int, str] = {one["id"]: one["topic"] for one in advertised["channels"]}
    link.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": k, "channelId": k} for k in topics]}))
    command = {"id": 1, "topic": COMMAND_TOPIC, "encoding": "json", "schemaName": "geometry_msgs/Twist"}
    link.send(json.dumps({"op": "advertise", "channels": [command]}))
    return topics


def served(folder: Path, lasts_s: float) -> tuple[Driver, float, dict[str, Any], float]:
    """Serve and drive; return the driver, the time between images [s], the server's account, and its CPU time [s]."""
    serve = [sys.executable, "-m", "firnline", "simulate", str(EXAMPLE), "--serve", "--truth"]
    serve += ["--listen", "127.0.0.1:0", "--runs", str(folder)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with subprocess.Popen(serve, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as server:
        assert server.stderr is not None
        try:
            driver, wall_s = drive(server.stderr.readline().split(": ")[0], lasts_s)
        finally:
            server.send_signal(signal.SIGINT)
            server.communicate()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    account = next(folder.glob("*/*/2-simulate/served.json"))
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return driver, wall_s, json.loads(account.read_text(encoding="utf-8")), cpu_s


def rows(quick: bool) -> Iterator[Row]:
    """Yield one row per claim."""
    lasts_s = _SHORT_S if quick else _DRIVE_S
    with tempfile.TemporaryDirectory() as folder:
        driver, wall_s, account, cpu_s = served(Path(folder), lasts_s)
    yield Row("time of the drive", driver.time_s, "s")
    yield Row.of("time of the drive over that of the wall clock", driver.time_s / wall_s, "1", ">=", 0.999)
    yield Row("images of 640 × 480 taken", account["images"], "1")
    yield Row.of("images that the client did not receive", account["images"] - driver.images, "1", "<=", 2)
    yield Row.of("messages dropped, of all topics", sum(account["dropped"].values()), "1", "<=", 0)
    yield Row.of("images later than the time between two", account["late_images"], "1", "<=", 0)
    yield Row("longest delay of an image", account["most_delay_s"], "s")
    yield Row.of("times that the rover stopped for want of a command", account["stops"], "1", "<=", 0)
    yield Row("commands taken", account["commands"], "1")
    yield Row("topics streamed", len(set(account["sent"]) & {*CHANNELS}), "1")
    yield Row("corners reached", driver.goals, "1")
    yield Row("largest real distance from a corner when it counted as reached", max(driver.misses_m), "m")
    yield Row(
        "CPU time of the server, with its start and the files, over that of the drive", cpu_s / wall_s, "1"
    )


if __name__ == "__main__":
    main("Closed loop", rows, ("numpy", "numba", "websockets", "pybullet", "mujoco"))

"""A vehicle at a free port that answers messages as a script says."""

import os
import threading
from collections.abc import Callable
from typing import Any, Self

from live.link import LinkAddress
from live.rover import Radio


class ScriptedVehicle:
    """Answers each message, and None at every turn, with the messages that a script returns: name and values."""

    def __init__(self, script: Callable[[Any], list[tuple]], autopilot: int = 12) -> None:
        os.environ.setdefault("MAVLINK20", "1")
        from pymavlink.dialects.v20 import common

        self._script, self._autopilot, self._common = script, autopilot, common
        self._radio, self._over = Radio("127.0.0.1", 0), threading.Event()
        self._station = common.MAVLink(None, 1, 1)
        self.address = LinkAddress.parsed(f"udp://127.0.0.1:{self._radio.port}")
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._radio.close()

    def _serve(self) -> None:
        while not self._over.is_set():
            data = self._radio.receive(0.05)
            for message in [*((self._station.parse_buffer(data) or []) if data else []), None]:
                for name, *values in self._script(message):
                    self._send(name, *values)
            self._send("heartbeat", 10, self._autopilot, 0, 0, 3, 3)

    def _send(self, name: str, *values: float) -> None:
        message = getattr(self._common, f"MAVLink_{name}_message")(*values)
        self._radio.send(message.pack(self._station))

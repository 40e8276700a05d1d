"""A simulated rover in a process of its own, behind its radio link."""

import multiprocessing
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from live.link import LinkAddress
from live.rover.drive import RoverSettings
from live.rover.radio import Radio
from live.rover.servers import serve_rover
from survey.data.dem import Dem

_SPAWN = multiprocessing.get_context("spawn")


@dataclass(frozen=True)
class RoverKind:
    """What a rover is like, over which ground and how fast it drives, and the share of packets that its link loses."""

    loss: float = 0.0
    seed: int = 0
    settings: RoverSettings = field(default_factory=RoverSettings)
    terrain: Dem | None = None
    hasten: float = 1.0

    def serve(self, port: int) -> None:
        """Serve the rover until it is killed."""
        radio = Radio("127.0.0.1", port, self.loss, self.seed)
        serve_rover(radio, self.settings, self.terrain, hasten=self.hasten)


class RoverProcess:
    """A rover in a process of its own, at a free port."""

    def __init__(self, kind: RoverKind) -> None:
        radio = Radio("127.0.0.1", 0)
        port = radio.port
        radio.close()
        self.address = LinkAddress.parsed(f"udp://127.0.0.1:{port}")
        self.process = _SPAWN.Process(target=kind.serve, args=(port,), daemon=True)
        self.process.start()

    def kill(self) -> None:
        """End it at once."""
        self.process.kill()
        self.process.join()


@contextmanager
def rover(kind: RoverKind | None = None) -> Iterator[RoverProcess]:
    """Yield a rover, and kill it at the end."""
    one = RoverProcess(kind or RoverKind())
    try:
        yield one
    finally:
        one.kill()

"""A simulated rover in a process of its own."""

import re
import subprocess
import sys
from collections.abc import Callable, Iterator

import pytest


class Rover:
    """Process of ``firnline rover``."""

    def __init__(self, *options: str) -> None:
        command = [sys.executable, "-u", "-m", "firnline", "rover", "--port", "0", *options]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        said = ""
        while (found := re.search(r"udp://127.0.0.1:\d+", said)) is None:
            line = self.process.stdout.readline()
            assert line, said
            said += line
        self.url = found.group()

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()


@pytest.fixture
def start_rover() -> Iterator[Callable[..., Rover]]:
    rovers: list[Rover] = []

    def start(*options: str) -> Rover:
        rovers.append(Rover(*options))
        return rovers[-1]

    yield start
    for rover in rovers:
        if rover.process.poll() is None:
            rover.kill()

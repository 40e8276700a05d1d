"""The same mission gives the same bytes: run twice, and killed twenty times at random moments."""

import os
import random
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from survey.core.runs.store import STAGES

MISSION = """
schema_version = 1
name = "small"
seed = 11
[terrain]
source = "random"
size_m = 150.0
relief_m = 6.0
length_scale_m = 60.0
micro_relief_sd_m = 0.1
step_m = 3.0
[planner]
pattern = "lawnmower"
swaths = 2
[sensors]
landmarks_per_m = 0.5
[reconstruction]
grid_step_m = 5.0
[reconstruction.gp]
fit = false
variance_m2 = 4.0
length_scale_m = 40.0
nugget_m = 0.1
"""

# Imports everything once; then every line that it reads is a command for a process of its own.
NURSERY = """
import os, sys
import sim.cli.mission_file
from sim.cli.main import app
for line in sys.stdin:
    child = os.fork()
    if child == 0:
        app(args=line.rstrip("\\n").split("\\t"))
    print(child, flush=True)
    print(os.waitpid(child, 0)[1], flush=True)
"""


class Nursery:
    """Starts runs of a mission as processes that can be killed."""

    def __init__(self, mission: Path) -> None:
        self.mission = mission
        self.process = subprocess.Popen(
            [sys.executable, "-c", NURSERY], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def start(self, runs: Path) -> int:
        """Start a run and return its process id."""
        self._pipe(self.process.stdin).write(f"run\t{self.mission}\t--runs\t{runs}\t-q\n")
        self._pipe(self.process.stdin).flush()
        return self._number()

    def ended(self, within_s: float) -> int | None:
        """Return the run's exit status, or None when it is still at work after so many seconds."""
        ready, _, _ = select.select([self.process.stdout], [], [], within_s)
        return self._number() if ready else None

    def _number(self) -> int:
        while True:  # the run prints its summary to the same pipe
            line = self._pipe(self.process.stdout).readline()
            if line.strip().isdigit():
                return int(line)

    @staticmethod
    def _pipe(pipe):
        assert pipe is not None
        return pipe


@pytest.fixture
def nursery(tmp_path) -> Iterator[Nursery]:
    (tmp_path / "m.toml").write_text(MISSION)
    nursery = Nursery(tmp_path / "m.toml")
    yield nursery
    nursery.process.stdin.close()
    nursery.process.wait()
    nursery.process.stdout.close()


def products(runs: Path) -> dict[str, bytes]:
    """Every product of the latest run; times stand in the manifest and the log alone."""
    run = runs / "small" / "latest"
    apart = {"manifest.json", "log.jsonl"}
    return {
        str(p.relative_to(run)): p.read_bytes()
        for p in sorted(run.rglob("*"))
        if p.is_file() and p.name not in apart
    }


def whole_run(nursery: Nursery, runs: Path) -> dict[str, bytes]:
    nursery.start(runs)
    assert nursery.ended(within_s=120.0) == 0
    return products(runs)


@pytest.mark.reliability
@pytest.mark.timeout(280)
def test_two_runs_and_one_killed_twenty_times_agree_to_the_byte(tmp_path, nursery):
    whole_run(nursery, tmp_path / "warm")
    began = time.monotonic()
    expected = whole_run(nursery, tmp_path / "first")
    whole_s = time.monotonic() - began
    assert {name.split("/")[0] for name in expected} >= {f"{n}-{s}" for n, s in enumerate(STAGES, start=1)}

    moments = random.Random(20261121)
    kills, done = 0, 0
    while kills < 20:
        child = nursery.start(tmp_path / "killed")
        if nursery.ended(within_s=moments.uniform(0.0, 0.9) * whole_s) is not None:
            # It came to its end first: the next kills hit a new run of the same mission.
            assert products(tmp_path / "killed") == expected
            (tmp_path / "killed").rename(tmp_path / f"done-{done}")
            done += 1
            continue
        os.kill(child, signal.SIGKILL)
        nursery.ended(within_s=60.0)
        kills += 1
    assert whole_run(nursery, tmp_path / "killed") == expected
    assert not [p for p in (tmp_path / "killed").rglob("*") if p.name.endswith(".partial")]

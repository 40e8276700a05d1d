"""The same mission gives the same bytes: run twice, and killed at random moments."""

import random
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.fork_server import ForkServer
from benchmarks.small_inputs import MISSION
from survey.core.run_folder import STAGES


@pytest.fixture
def server(tmp_path) -> Iterator[ForkServer]:
    (tmp_path / "m.toml").write_text(MISSION)
    with ForkServer(tmp_path) as server:
        yield server


def products(runs: Path) -> dict[str, bytes]:
    """Every product of the latest run; times stand in the manifest and the log alone."""
    run = runs / "small" / "latest"
    apart = {"manifest.json", "log.jsonl"}
    return {
        str(p.relative_to(run)): p.read_bytes()
        for p in sorted(run.rglob("*"))
        if p.is_file() and p.name not in apart
    }


def whole_run(server: ForkServer, runs: Path, within_s: float = 120.0) -> dict[str, bytes]:
    """Run the mission ``m.toml`` to its end and return its products."""
    assert server.run(f"run m.toml --runs {runs} -q", within_s) == 0
    return products(runs)


@pytest.mark.long
@pytest.mark.reliability
@pytest.mark.timeout(280)
@pytest.mark.parametrize("n_kills", [1, pytest.param(20, marks=pytest.mark.exhaustive)])
def test_two_runs_and_one_killed_again_and_again_agree_to_the_byte(tmp_path, server, n_kills):
    whole_run(server, tmp_path / "warm")
    began = time.monotonic()
    expected = whole_run(server, tmp_path / "first")
    whole_s = time.monotonic() - began
    assert {name.split("/")[0] for name in expected} >= {f"{n}-{s}" for n, s in enumerate(STAGES, start=1)}

    moments = random.Random(20261121)
    kills, done = 0, 0
    while kills < n_kills:
        child = server.start(f"run m.toml --runs {tmp_path / 'killed'} -q")
        if server.ended(within_s=moments.uniform(0.0, 0.9) * whole_s) is not None:
            # It came to its end first: the next kills hit a new run of the same mission.
            assert products(tmp_path / "killed") == expected
            (tmp_path / "killed").rename(tmp_path / f"done-{done}")
            done += 1
            continue
        server.killed(child)
        kills += 1
    assert whole_run(server, tmp_path / "killed") == expected
    assert not [p for p in (tmp_path / "killed").rglob("*") if p.name.endswith(".partial")]

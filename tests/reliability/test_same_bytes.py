"""The same mission gives the same bytes: run twice, and killed twenty times at random moments."""

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

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
[satellite]
cell_m = 75.0
[planner]
pattern = "lawnmower"
swaths = 2
[reconstruction]
grid_step_m = 5.0
"""


def command(folder: Path, runs: str) -> list[str]:
    return [
        sys.executable,
        "-m",
        "sim.cli.main",
        "run",
        str(folder / "m.toml"),
        "--runs",
        str(folder / runs),
        "-q",
    ]


def products(folder: Path) -> dict[str, bytes]:
    """Every product of the latest run; times stand in the manifest and the log alone."""
    run = folder / "small" / "latest"
    apart = {"manifest.json", "log.jsonl"}
    return {
        str(p.relative_to(run)): p.read_bytes()
        for p in sorted(run.rglob("*"))
        if p.is_file() and p.name not in apart
    }


@pytest.mark.reliability
@pytest.mark.timeout(240)
def test_two_runs_and_one_killed_twenty_times_agree_to_the_byte(tmp_path):
    (tmp_path / "m.toml").write_text(MISSION)
    began = time.monotonic()
    subprocess.run(command(tmp_path, "first"), check=True)
    whole_s = time.monotonic() - began
    expected = products(tmp_path / "first")
    assert {name.split("/")[0] for name in expected} >= {
        f"{n}-{s}"
        for n, s in enumerate(("plan", "simulate", "localize", "reconstruct", "score", "report"), start=1)
    }

    moments = random.Random(20261121)
    kills = 0
    while kills < 20:
        process = subprocess.Popen(command(tmp_path, "killed"))
        try:
            process.wait(timeout=moments.uniform(0.3, 1.0) * whole_s)
            # It came to its end first: the next kills hit a new run of the same mission.
            assert products(tmp_path / "killed") == expected
            (tmp_path / "killed").rename(tmp_path / f"done-{kills}")
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
            kills += 1
    subprocess.run(command(tmp_path, "killed"), check=True)
    assert products(tmp_path / "killed") == expected
    leftovers = [p for p in (tmp_path / "killed").rglob("*") if p.name.endswith(".partial")]
    assert not leftovers

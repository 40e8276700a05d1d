"""How long a mission takes: the demo stage by stage, the start of the command, the smoother's cost by length.

Run with ``python -m benchmarks.mission``. Wall times are of processes of their own on an idle machine.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.report import Row, fastest, main
from planners import LawnmowerConfig
from sim.config.mission import MissionConfig
from sim.config.world import RandomTerrain
from sim.simulate.simulation import simulate_statistical
from survey import Dem, Grid, Leg, Route
from vision_slam import localize

EXAMPLE = Path(__file__).parents[1] / "examples" / "srtm_ridge.toml"
CRS = "EPSG:32608"


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    yield Row.of("firnline --help: CPU time", _help_cpu_s(), "s", "<=", 0.4)
    yield from _demo()
    yield from _smoother(swaths=(2, 8) if quick else (2, 8, 32))


def _help_cpu_s() -> float:
    """CPU time of the command's help, the least of five [s]."""
    spent = []
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-m", "firnline.cli.main", "--help"], check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(spent)


def _demo() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as runs:
        command = [
            sys.executable,
            "-m",
            "firnline.cli.main",
            "run",
            str(EXAMPLE),
            "--runs",
            runs,
            "-q",
            "--json",
        ]
        began = time.perf_counter()
        content = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        whole_s = time.perf_counter() - began
    for stage, seconds in content["stage_wall_s"].items():
        yield Row(f"demo: {stage}, wall time", seconds, "s")
    yield Row.of("demo: whole run, wall time", whole_s, "s", "<=", 60.0)
    elevation, calibration = content["score"]["elevation"], content["score"]["calibration"]
    yield Row("demo: RMSE", elevation["rmse_m"], "m")
    yield Row("demo: RMSE over the limit of Class 3", elevation["rmse_m"] / 0.4572, "1")
    yield Row("demo: share within the claimed 95 % interval", calibration["coverage_95"], "1")


def _smoother(swaths: tuple[int, ...]) -> Iterator[Row]:
    seconds = {n: _localizing_s(n) for n in swaths}
    for n, spent in seconds.items():
        yield Row(f"localizing {n * 0.55:.1f} km: CPU time", spent, "s")
    few, many = min(swaths), max(swaths)
    growth = (seconds[many] / seconds[few]) / (many / few)
    yield Row.of("localizing: growth of the time over growth of the length", growth, "1", "<=", 1.5)


def _localizing_s(n_swaths: int) -> float:
    grid = Grid((0.0, 0.0, 600.0, 600.0), 5.0, CRS)
    x, y = np.meshgrid(grid.x, grid.y)
    terrain = Dem.on(grid, 4.0 * np.sin(x / 60.0) * np.cos(y / 45.0))
    rows = np.linspace(30.0, 570.0, n_swaths)
    legs: list[Leg] = []
    for index, row in enumerate(rows):
        ends = (30.0, 570.0) if index % 2 == 0 else (570.0, 30.0)
        if legs:
            legs.append(Leg("transit", [[ends[0], rows[index - 1]], [ends[0], row]]))
        legs.append(Leg("swath", [[ends[0], row], [ends[1], row]]))
    mission = MissionConfig(
        schema_version=1,
        name="m",
        terrain=RandomTerrain(source="random"),
        planner=LawnmowerConfig(swaths=n_swaths),
    )
    recording, _ = simulate_statistical(terrain, Route(tuple(legs), CRS, "lawnmower"), mission)
    return fastest(lambda: localize(recording, mission.assumed), 3)[1]


if __name__ == "__main__":
    main("Mission", measure, ("numpy", "scipy", "finufft"))

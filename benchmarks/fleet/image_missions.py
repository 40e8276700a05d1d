"""Three rovers that drive eight swaths of 600 m in images, from the plan to the report."""

import resource
import tempfile
import time
from pathlib import Path
from typing import Any

from sim.config.mission import MissionConfig
from sim.mission.fleet import accounts
from sim.mission.runs import open_run
from sim.mission.stages import run_mission
from survey.core.config import validated
from survey.core.documents import read_json

N_ROVERS, N_SWATHS, SIDE_M = 3, 8, 600.0
_WORKERS = 2
_EAST_M, _NORTH_M = 526_000.0, 6_478_000.0


def mission_of(seed: int) -> MissionConfig:
    """Return the mission, on ground without crevasses."""
    content = {
        "schema_version": 1,
        "name": "fleet-in-images",
        "seed": seed,
        "fidelity": "vision",
        "terrain": {"source": "random", "size_m": SIDE_M + 40.0, "relief_m": 15.0, "length_scale_m": 120.0,
                    "origin_m": (_EAST_M, _NORTH_M)},
        "area": {"bounds_m": (_EAST_M + 20.0, _NORTH_M + 20.0, _EAST_M + 20.0 + SIDE_M, _NORTH_M + 20.0 + SIDE_M)},
        "planner": {"pattern": "lawnmower", "swaths": N_SWATHS},
        "fleet": {"rovers": N_ROVERS},
        "scenery": {"crevasses_per_ha": 0.0},
    }  # fmt: skip
    return validated(MissionConfig, content, "the benchmark")


def outcome(seed: int) -> dict[str, Any]:
    """Run the mission with two processes; return times [s], memory [GB] and the share of rovers that arrived."""
    mission = mission_of(seed)
    with tempfile.TemporaryDirectory() as folder:
        run = open_run(mission, Path(folder))
        start = time.perf_counter()
        run_mission(mission, run, workers=_WORKERS)
        wall_s = time.perf_counter() - start
        drives = accounts(run.folder("simulate"))
        score = read_json(run.folder("score") / "score.json", "the score")
    peak_kb = max(
        resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return {
        "seed": seed,
        "wall_s": wall_s,
        "drive_s": float(sum(one["duration_s"] for one in drives)),
        "peak_gb": peak_kb * 1024 / 1e9,
        "arrived": sum(one["ending"] == "arrived" for one in drives) / len(drives),
        "rmse_m": score["elevation"]["rmse_m"],
    }

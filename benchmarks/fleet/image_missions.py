"""Three rovers that drive in images, from the plan to the report, in parts that are stored as they finish."""

import os
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.mission_settings import stated_mission
from benchmarks.report import Row, cpu_seconds, peak_memory_mb
from benchmarks.stored_parts import stored
from sim.config.mission import MissionConfig
from sim.mission.fleet import accounts, drive_rover, rover_folder
from sim.mission.runs import open_run
from sim.mission.stages import run_mission
from survey import Route
from survey.core.documents import read_json
from survey.core.run_folder import RunFolder

N_ROVERS, N_CORES = 3, 2
_EDGE_M = 20.0
_EAST_M, _NORTH_M = 526_000.0, 6_478_000.0


class Stretch(NamedTuple):
    """Number of swaths of a mission, and the side of its square area [m]."""

    n_swaths: int
    side_m: float


WHOLE, SHORT = Stretch(8, 600.0), Stretch(3, 60.0)


def mission_of(seed: int, stretch: Stretch) -> MissionConfig:
    """Return the mission, on ground without crevasses, channels and dirt cones.

    A coarse prior shows none of them, so that routes would run into them; lost rovers are a part of their own.
    """
    west, south = _EAST_M + _EDGE_M, _NORTH_M + _EDGE_M
    start = west + 5.0, south + 5.0
    terrain = {"source": "random", "size_m": stretch.side_m + 2.0 * _EDGE_M, "relief_m": 15.0}
    sections = {
        "fidelity": "vision",
        "terrain": terrain | {"length_scale_m": 120.0, "origin_m": (_EAST_M, _NORTH_M)},
        "area": {
            "bounds_m": (west, south, west + stretch.side_m, south + stretch.side_m),
            "starts_m": (start,),
        },
        "planner": {"pattern": "lawnmower", "swaths": stretch.n_swaths},
        "fleet": {"rovers": N_ROVERS},
        "scenery": {"crevasses_per_ha": 0.0, "channels_per_ha": 0.0, "dirt_cones_per_ha": 0.0},
    }
    return stated_mission("fleet-in-images", seed, sections)


def rows(seed: int, stretch: Stretch, folder: Path) -> Iterator[Row]:
    """Yield the rows of the mission; its drives and its facts are stored in a folder."""
    n, side_m = stretch
    name = f"three rovers in images, {n} swaths of {side_m:g} m"
    found = stored(folder / f"{n}-{seed}.json", lambda: outcome(seed, stretch, folder / f"{n}-{seed}"))
    yield Row.of(f"{name}: rovers that arrive", found["arrived"], "1", ">=", 1.0)
    yield Row(f"{name}: duration of all drives", found["drive_s"], "s")
    yield Row(f"{name}: CPU time of all stages", found["cpu_s"], "s")
    pace = found["drive_s"] / (found["cpu_s"] / N_CORES)
    yield Row.of(f"{name}: drives over the CPU time of each of two cores", pace, "1", ">=", 3.5)
    yield Row(f"{name}: drives over wall time, one process", found["drive_s"] / found["wall_s"], "1")
    yield Row(f"{name}: load of the machine meanwhile", found["load"], "1")
    for part, what in (("drive_gb", "a drive"), ("peak_gb", "the map of all")):
        yield Row.of(f"{name}: memory of the process with {what}", found[part], "GB", "<=", 2.0)
    yield Row(f"{name}: RMSE", found["rmse_m"], "m")


def outcome(seed: int, stretch: Stretch, place: Path) -> dict[str, Any]:
    """Run the mission, rover by rover; return times [s], memory [GB] and the share of rovers that arrived."""
    mission = mission_of(seed, stretch)
    run = open_run(mission, place)
    parts = {"plan": partial(run_mission, mission, run, until="plan", workers=1)}
    for k in range(N_ROVERS):
        parts[f"rover-{k + 1}"] = partial(_drive, mission, run, place, k)
    parts["localize"] = partial(_localize, mission, run, place)
    parts["map"] = partial(run_mission, mission, run, workers=1)
    costs = {name: stored(place / f"{name}.json", partial(_cost, work)) for name, work in parts.items()}
    drives = accounts(run.folder("simulate"))
    score = read_json(run.folder("score") / "score.json", "the score")
    return {
        "seed": seed,
        "cpu_s": sum(cost["cpu_s"] for cost in costs.values()),
        "wall_s": sum(cost["wall_s"] for cost in costs.values()),
        "load": max(cost["load"] for cost in costs.values()),
        "drive_gb": max(cost["peak_gb"] for name, cost in costs.items() if name.startswith("rover")),
        "peak_gb": max(cost["peak_gb"] for cost in costs.values()),
        "drive_s": float(sum(one["duration_s"] for one in drives)),
        "arrived": sum(one["ending"] == "arrived" for one in drives) / len(drives),
        "rmse_m": score["elevation"]["rmse_m"],
    }


def _cost(work: partial[None]) -> dict[str, float]:
    """Return CPU time and wall time of a part [s], the load of the machine, and the memory of this process [GB]."""
    start = time.perf_counter()
    _, cpu_s = cpu_seconds(work)
    wall_s = time.perf_counter() - start
    return {"cpu_s": cpu_s, "wall_s": wall_s, "load": os.getloadavg()[2], "peak_gb": peak_memory_mb() / 1e3}


def _drive(mission: MissionConfig, run: RunFolder, place: Path, rover: int) -> None:
    """Drive one rover's route, as the stage does."""
    route = Route.read(run.folder("plan") / "route.geojson")
    drive_rover(mission, route, place / "drives", rover)


def _localize(mission: MissionConfig, run: RunFolder, place: Path) -> None:
    """Put the drives into their stage, and localize all rovers."""
    if not run.has("simulate"):
        with run.stage("simulate") as folder:
            for rover in range(N_ROVERS):
                drive = rover_folder(place / "drives", rover)
                drive.rename(rover_folder(folder, rover))
            Route.read(run.folder("plan") / "route.geojson").write(folder / "driven_route.geojson")
    run_mission(mission, run, until="localize", workers=1)

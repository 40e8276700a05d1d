"""Missions with a LiDAR beside the same missions with landmarks alone, on random sites that nothing was chosen on.

Run with ``python -m benchmarks.lidar_mission``. Sites of 600 × 600 m are surveyed by four swaths with gravity and
barometer, in the statistical fidelity with errors of the path; the terrain is of another kind on each and goes on
beyond the area. Four surveyed stakes at the ends of swaths hold the level of both maps: without them it is that of the
receiver, an error that no LiDAR changes. The error is shown with and without the level of each map.
Seeds 7201 to 7205 were used for nothing else; sizes and settings were chosen on seeds 41 to 44. The time is the CPU time
of one core from the records to the map, with all scans, over the time of the drive; the simulation of the rays is shown
beside it.
Sites are stored as they finish (``FIRNLINE_LIDAR`` names the folder), and a run that was broken off continues;
``FIRNLINE_LIDAR_SEEDS=7201`` computes some of them alone.
"""

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.lidar_mission import missions
from benchmarks.report import Row, main
from benchmarks.stored_parts import code_digest, stored

_NAMED = os.environ.get("FIRNLINE_LIDAR_SEEDS")
SEEDS = (7201, 7202, 7203, 7204, 7205)
_SOURCES = ("survey", "planners", "vision_slam", "sim", "benchmarks/lidar_mission")
_NAMES = {"landmarks": "landmarks alone", "scans": "LiDAR"}


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    folder = Path(os.environ.get("FIRNLINE_LIDAR") or tempfile.gettempdir())
    parts = folder / f"firnline-lidar-{code_digest(_SOURCES)}"
    seeds = SEEDS if _NAMED is None else tuple(int(seed) for seed in _NAMED.split(","))
    found = [
        stored(parts / f"{seed}.json", lambda seed=seed: missions.outcome(seed))
        for seed in seeds[: 1 if quick else len(seeds)]
    ]
    yield from _map_rows(found)
    yield from _time_rows(found)


def _map_rows(found: list[dict[str, Any]]) -> Iterator[Row]:
    for words, without_level in (("RMSE", False), ("RMSE without the level of each map", True)):
        rms = {kind: _rms_m(found, kind, without_level=without_level) for kind in _NAMES}
        for kind, name in _NAMES.items():
            yield Row(f"{name}: {words}, all sites", rms[kind], "m")
        ratio, name = rms["scans"] / rms["landmarks"], f"LiDAR over landmarks alone: {words}"
        yield Row(name, ratio, "1") if without_level else Row.of(name, ratio, "1", "<=", 0.8)
    worst = max(one["scans"]["rmse_m"] / one["landmarks"]["rmse_m"] for one in found)
    yield Row("LiDAR over landmarks alone: RMSE, worst site", worst, "1")
    coverage = {kind: [one[kind]["coverage"] for one in found] for kind in _NAMES}
    mean = float(np.mean(coverage["scans"]))
    yield Row("LiDAR: coverage of 95 %", mean, "1", "0.93 to 0.97", 0.93 <= mean <= 0.97)
    yield Row("LiDAR: coverage of 95 %, worst site", min(coverage["scans"]), "1")
    yield Row("landmarks alone: coverage of 95 %", float(np.mean(coverage["landmarks"])), "1")


def _rms_m(found: list[dict[str, Any]], kind: str, *, without_level: bool) -> float:
    """Return the RMSE over all sites [m], with or without the mean error of each map."""
    level = [one[kind]["offset_m"] ** 2 if without_level else 0.0 for one in found]
    return float(np.sqrt(np.mean([one[kind]["rmse_m"] ** 2 for one in found]) - np.mean(level)))


def _time_rows(found: list[dict[str, Any]]) -> Iterator[Row]:
    share = max(one["estimate_cpu_s"] / one["drive_s"] for one in found)
    yield Row.of("CPU time from the records to the map over that of the drive, most", share, "1", "<=", 1.0)
    simulated = max(one["simulate_cpu_s"] / one["drive_s"] for one in found)
    yield Row("CPU time of the simulated scans over that of the drive, most", simulated, "1")
    yield Row("returns of a mission, mean", float(np.mean([one["n_returns"] for one in found])), "1")
    yield Row("scans on the disk, most", max(one["scans_mb"] for one in found), "MB")


if __name__ == "__main__":
    main("LiDAR mission", measure, ("numpy", "scipy", "numba"), is_complete=_NAMED is None)

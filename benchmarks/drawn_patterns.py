"""Other patterns at the site of the paper's survey: error and drive of wavy swaths and tie lines beside the paper's two.

Run with ``python -m benchmarks.drawn_patterns``. Surveys are drawn with the error model that was fitted to drives in
images (see ``benchmarks.fidelities``), at 20 sites of ``examples/mendenhall_like.toml`` whose seeds nothing was chosen on
(``FIRNLINE_PATTERN_SITES`` takes fewer); every pattern surveys all of them, with the snow's relief on the ground and the
receiver of the mission. No pattern here was driven in images but the first two.
"""

import os
from collections.abc import Iterator

import numpy as np

from benchmarks.fidelities import mission_of, site_of, surveyed
from benchmarks.report import Row, main
from benchmarks.vision_mission import CLASS_3_M, PLANNERS
from planners import plan
from sim.mission.drives import steer_route
from survey.core.arrays import FloatArray

PATTERNS: dict[str, tuple[str, ...]] = {
    "lawnmower, 4": ("planner.swaths=4",),
    "piecewise-continuous, 2": PLANNERS["piecewise-continuous"],
    "wavy, 3": ("planner.pattern=wavy", "planner.swaths=3"),
    "wavy, 4": ("planner.pattern=wavy", "planner.swaths=4"),
    "lawnmower, 3, and a tie line": ("planner.swaths=3", "planner.inset_share=0.25", "planner.tie_lines=1"),
}
N_SITES = int(os.environ.get("FIRNLINE_PATTERN_SITES", "20"))
FIRST_SEED = 7000


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    names = list(PATTERNS)
    seeds = range(FIRST_SEED, FIRST_SEED + (1 if quick else N_SITES))
    rmse, drive = np.empty((len(names), len(seeds))), np.empty((len(names), len(seeds)))
    for column, seed in enumerate(seeds):
        for row, name in enumerate(names[2:] if quick else names):
            rmse[row, column], drive[row, column] = _survey(PATTERNS[name], seed)
    if quick:
        yield from _rows(names[2:], rmse, drive)
        return
    yield from _rows(names, rmse, drive)
    for row in range(2, len(names)):
        yield from _against_the_papers(names, row, rmse, drive)


def _rows(names: list[str], rmse: FloatArray, drive: FloatArray) -> Iterator[Row]:
    for name, errors, lengths in zip(names, rmse, drive, strict=False):
        yield Row(f"{name}: RMSE, median", float(np.median(errors)), "m")
        yield Row(f"{name}: RMSE, 95th percentile", float(np.percentile(errors, 95.0)), "m")
        yield Row(f"{name}: RMSE, worst", float(errors.max()), "m")
        yield Row(f"{name}: share in Class 3", float(np.mean(errors <= CLASS_3_M)), "1")
        yield Row(f"{name}: drive, mean", float(lengths.mean()), "m")


def _against_the_papers(names: list[str], row: int, rmse: FloatArray, drive: FloatArray) -> Iterator[Row]:
    """Yield error and drive as shares of those of the paper's patterns, site by site."""
    for rival in (0, 1):
        error = float(np.median(rmse[row] / rmse[rival]))
        way = float(np.median(drive[row] / drive[rival]))
        yield Row(f"{names[row]} / {names[rival]}: drive, median of sites", way, "x")
        shown = f"{names[row]} / {names[rival]}: RMSE, median of sites"
        yield Row(shown, error, "x", "< 1, or a shorter drive", min(error, way) < 1.0)


def _survey(settings: tuple[str, ...], seed: int) -> tuple[float, float]:
    """Return error [m] and drive [m] of one survey of the site of a seed."""
    mission = mission_of((f"seed={seed}", *settings))
    world, site = site_of(mission)
    planned = plan(world.area, world.prior, mission.planner, rover=mission.rover)
    route = steer_route(planned, world, mission)
    return surveyed(site, route, mission, seed).rmse_m, route.length_m


if __name__ == "__main__":
    main("Drawn patterns", measure)

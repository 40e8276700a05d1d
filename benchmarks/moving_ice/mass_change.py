"""Mass change between two surveys of moving ice 30 days apart.

Run with ``python -m benchmarks.moving_ice.mass_change``: 150 pairs of surveys with the seeds 12001 to 12150, in parts that are
stored as they finish. The terrain moves by 0.7 m and melts by 6 ± 2 cm a day between and during the surveys, whose errors are
drawn as the estimate assumes them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.moving_ice.cases import TERRAIN, Case, mission_of
from benchmarks.moving_ice.chance import interval_of_share
from benchmarks.moving_ice.figures import by_chance
from benchmarks.moving_ice.parts import SURVEYS, folder_of
from benchmarks.moving_ice.surveys import Drive, drive_of, joint_terrain, with_start_error
from benchmarks.report import Row, main
from benchmarks.stored_parts import stored
from sim.simulate.simulation import simulate_statistical
from sim.world.moving_ice import moving_ice
from survey.reconstruction.motion.refinement import area_mean
from vision_slam import localize_on_ice

FIRST_SEED, N_PAIRS, DAYS, VELOCITY, HOURS = 12001, 150, 30.0, 0.7, 8.0
_AT_ONCE = 10


def pairs(folder: Path, *, n: int) -> list[dict[str, float]]:
    """Return error and claimed standard deviation of the mean change of height of n pairs of surveys."""
    found: list[dict[str, float]] = []
    for first in range(0, n, _AT_ONCE):
        seeds = range(FIRST_SEED + first, FIRST_SEED + min(first + _AT_ONCE, n))
        found += stored(
            folder / f"pairs-{seeds[0]}-{seeds[-1]}.json", lambda s=seeds: [_pair(seed) for seed in s]
        )
    return found


def _pair(seed: int) -> dict[str, float]:
    """Survey a site twice, and compare the mean change of height with the real one."""
    early = drive_of(Case(VELOCITY, HOURS, 4, seed))
    late = _later(early, seed)
    means = [_mean_height(drive) for drive in (early, late)]
    real = [float(np.mean(drive.terrain.at(drive.nodes.xy))) for drive in (early, late)]
    change = means[1][0] - means[0][0]
    sigma = float(np.hypot(means[0][1], means[1][1]))
    return {"error_m": change - (real[1] - real[0]), "sigma_m": sigma, "change_m": real[1] - real[0]}


def _later(early: Drive, seed: int) -> Drive:
    """Return a survey of the same site 30 days later, with other errors."""
    terrain = early.ice.terrain_at(early.start_terrain, DAYS * 86400.0)
    later = mission_of(Case(VELOCITY, HOURS, 4, seed + 100_000))
    mission = early.mission.model_copy(update={"seed": later.seed, "sensors": later.sensors})
    recording, truth = simulate_statistical(terrain, early.route, mission)
    recording = with_start_error(recording, mission)
    ice = moving_ice(mission, terrain)
    assert ice is not None
    return replace(early, mission=mission, recording=recording, terrain=truth.dem, ice=ice)


def _mean_height(drive: Drive) -> tuple[float, float]:
    """Return the mean height of the map of the epoch [m], and its standard deviation."""
    found = localize_on_ice(drive.recording, drive.prior(), drive.mission.assumed)
    solution = joint_terrain(found, TERRAIN).solved(found.points, drive.nodes.bounds)
    return area_mean(solution, drive.nodes)


def rows(found: Sequence[dict[str, float]]) -> Iterator[Row]:
    """Yield the rows of pairs of surveys."""
    error, sigma = (np.array([one[name] for one in found]) for name in ("error_m", "sigma_m"))
    yield Row("pairs of surveys 30 days apart", float(len(found)), "1")
    name, within = "mean change of height within 95 %", float(np.mean(np.abs(error) <= 1.959964 * sigma))
    yield Row(name, within, "1", "0.93 to 0.97", 0.93 <= within <= 0.97)
    yield from by_chance(name, interval_of_share(len(found)))
    yield Row("mean change of height: RMS error", float(np.sqrt(np.mean(error**2))), "m")
    yield Row("mean change of height: claimed standard deviation", float(np.sqrt(np.mean(sigma**2))), "m")
    yield Row(
        "mean change of height, mean of the pairs", float(np.mean([one["change_m"] for one in found])), "m"
    )


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    yield from rows(pairs(folder_of(*SURVEYS), n=2 if quick else N_PAIRS))


if __name__ == "__main__":
    main("Mass change on moving ice", measure, ("numpy", "scipy", "finufft", "numba"))

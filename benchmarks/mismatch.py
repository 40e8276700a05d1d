"""Honesty of maps whose estimator assumes the wrong errors: ``python -m benchmarks.mismatch``.

The statistical surveys of ``benchmarks.honesty`` are mapped twice: with assumptions that are those of the sensors, and
with standard deviations, correlation times and lengths, and claims of landmarks that are each off by a factor between
1/2 and 2 (`benchmarks.mismatched`). The same errors are drawn in both. Seeds 7301 and later were used for nothing else;
``FIRNLINE_MISMATCH_SEEDS`` says how many there are of each terrain, two by default. Outcomes are stored in the folder of
runs, and a run that was stopped continues.
"""

import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

import planners
from benchmarks.honesty.priors import prior
from benchmarks.honesty.surveys import AREA, NODES
from benchmarks.honesty.terrains import KINDS, terrain
from benchmarks.mismatched import mismatched
from benchmarks.report import Row, main
from benchmarks.stored_parts import code_digest, stored
from planners import LawnmowerConfig
from sim.config.mission import MissionConfig, SensorConfig
from sim.config.world import RandomTerrain
from sim.simulate.simulation import simulate_statistical
from survey.data.dem import Dem
from survey.reconstruction import GaussianProcessConfig
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.joint.joint_map import JointTerrain
from vision_slam import LocalizationConfig, localize

FIRST_SEED = 7301
N_SEEDS = int(os.environ.get("FIRNLINE_MISMATCH_SEEDS", "2"))
FOLDER = Path(os.environ.get("FIRNLINE_MISMATCH_PARTS", "results/runs/mismatch"))
_SOURCES = (
    "survey/reconstruction",
    "survey/terrain",
    "vision_slam",
    "benchmarks/honesty",
    "benchmarks/mismatch.py",
)
_CASES = ("as drawn", "off by up to 2")
_PRIORS = ("no prior", "truthful prior")
_SIGMAS_95 = 1.96


@dataclass(frozen=True)
class Outcome:
    """Error, claim [m] and coverage of one map."""

    terrain: str
    seed: int
    assumptions: str
    prior: str
    rmse_m: float
    claimed_m: float
    coverage: float


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    kinds, seeds = (KINDS[:2], 1) if quick else (KINDS, N_SEEDS)
    found = [
        one for kind in kinds for seed in range(FIRST_SEED, FIRST_SEED + seeds) for one in _stored(kind, seed)
    ]
    yield Row("surveys", float(len(kinds) * seeds), "1")
    for name in _PRIORS:
        drawn, off = ([one for one in found if (one.prior, one.assumptions) == (name, c)] for c in _CASES)
        for case, mine in zip(_CASES, (drawn, off), strict=True):
            coverage = np.array([one.coverage for one in mine])
            yield Row(f"{name}, assumptions {case}: coverage of 95 %, mean", float(coverage.mean()), "1")
            yield Row(f"{name}, assumptions {case}: coverage of 95 %, worst", float(coverage.min()), "1")
            claims = float(np.median([one.claimed_m / one.rmse_m for one in mine]))
            yield Row(f"{name}, assumptions {case}: claimed over true RMSE, median", claims, "1")
        ratio = np.median([a.rmse_m / b.rmse_m for a, b in zip(off, drawn, strict=True)])
        yield Row(f"{name}: RMSE over that of right assumptions, median of surveys", float(ratio), "x")


def _stored(kind: str, seed: int) -> list[Outcome]:
    """Return the outcomes of one survey, computed once."""
    file = FOLDER / code_digest(_SOURCES) / f"{kind.replace(' ', '_')}-{seed}.json"
    facts = stored(file, lambda: [asdict(one) for one in _surveyed(kind, seed)])
    return [Outcome(**one) for one in facts]


def _surveyed(kind: str, seed: int) -> Iterator[Outcome]:
    """Survey a terrain once by right and once by wrong assumptions, and map both with and without a prior."""
    real, right = terrain(kind, seed), _mission(100 * seed + KINDS.index(kind))
    cells = prior("truthful", real, kind, seed)
    for case, mission in zip(_CASES, (right, mismatched(right, right.seed)), strict=True):
        recording, _ = simulate_statistical(real, planners.plan(AREA, None, mission.planner), mission)
        found = localize(recording, mission.assumed)
        assert found.trajectory.error is not None
        config, joint = GaussianProcessConfig(tolerance_m=5e-3), JointConfig(slope_passes=1, memory_mb=6.0)
        for name, dem in zip(_PRIORS, (None, cells), strict=True):
            mapped = JointTerrain(found.trajectory.error, dem, config, joint).map(found.points, NODES)
            result = mapped.reconstruction
            yield _judged(
                Outcome(kind, seed, case, name, 0.0, 0.0, 0.0),
                result.mean.elevation,
                result.std.elevation,
                real,
            )


def _judged(named: Outcome, mean: Any, std: Any, real: Dem) -> Outcome:
    """Return an outcome with the errors of its map."""
    error = mean - real.at(NODES.xy).reshape(NODES.shape)
    facts = {
        "rmse_m": float(np.sqrt(np.mean(error**2))),
        "claimed_m": float(np.sqrt(np.mean(std**2))),
        "coverage": float(np.mean(np.abs(error) <= _SIGMAS_95 * std)),
    }
    return Outcome(**(asdict(named) | facts))


def _mission(seed: int) -> MissionConfig:
    return MissionConfig(
        schema_version=1,
        name="mismatch",
        seed=seed,
        terrain=RandomTerrain(source="random"),
        planner=LawnmowerConfig(swaths=4),
        sensors=SensorConfig(landmarks_per_m=0.25),
        localization=LocalizationConfig(node_spacing_m=20.0),
    )


if __name__ == "__main__":
    main("Mismatch", measure, ("numpy", "scipy", "finufft"))

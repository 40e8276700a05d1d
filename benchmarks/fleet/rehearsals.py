"""Rehearsals of a small survey: CPU time of ten runs, and the same outcomes for another number of workers."""

import tempfile
from pathlib import Path
from typing import Any

from benchmarks.report import cpu_seconds
from sim.config.mission import MissionConfig
from sim.mission.rehearsal import outcomes, rehearse
from survey.core.config import read_toml, validated

N_RUNS, _N_REPEATED = 10, 2
_EXAMPLE = Path(__file__).parents[2] / "examples" / "small_survey.toml"


def outcome(seed: int) -> dict[str, Any]:
    """Rehearse the mission ten times in this process, and its first two runs in two processes."""
    drawn = {"setting": "sensors.gps_bias_sigma_m", "between": [0.5, 2.0]}
    content = read_toml(_EXAMPLE) | {"seed": seed, "rehearsal": [drawn]}
    mission = validated(MissionConfig, content, str(_EXAMPLE))
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as two:
        folder, cpu_s = cpu_seconds(lambda: rehearse(mission, Path(one), N_RUNS, workers=1))
        found = outcomes(folder, N_RUNS)
        again = outcomes(rehearse(mission, Path(two), _N_REPEATED, workers=2), _N_REPEATED)
    n_other = sum(first != second for first, second in zip(found, again, strict=False))
    return {"seed": seed, "cpu_s": cpu_s, "n_other": n_other, "causes": [one["cause"] for one in found]}

"""The paper's two surveys in images: their missions, and small ones through the study."""

import csv
import os
from pathlib import Path

import pytest

from sim.mission.runs import read_mission, resolved_text
from sim.studies import study
from sim.studies.glacier.surveys import SEED, mission_of

EXAMPLE = Path(__file__).parents[4] / "examples" / "mendenhall_like.toml"


def test_the_study_runs_the_example():
    example = read_mission(EXAMPLE, [f"seed={SEED}"])
    assert resolved_text(example) == resolved_text(mission_of("lawnmower", quick=False))
    steered = ["planner.pattern=piecewise-continuous", "planner.swaths=2", f"seed={SEED}"]
    other = read_mission(EXAMPLE, steered)
    assert resolved_text(other) == resolved_text(mission_of("piecewise-continuous", quick=False))


@pytest.mark.slow
@pytest.mark.skipif("FIRNLINE_DRIVES" not in os.environ, reason="minutes of driving: set FIRNLINE_DRIVES=1")
def test_both_surveys_are_driven_mapped_and_drawn(tmp_path):
    for name in ("glacier-fig12", "glacier-fig13"):
        (tmp_path / name).mkdir()
        study(name)(tmp_path / name, quick=True, progress=lambda *_: None)
    with (tmp_path / "glacier-fig13" / "maps.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["planner"] for row in rows] == ["lawnmower", "piecewise-continuous"]
    # Relief of 2 m around the prior, which knows it to a metre: the maps are much better than that.
    assert all(float(row["rmse_m"]) < 0.4 for row in rows)
    assert {path.name for path in (tmp_path / "glacier-fig13").iterdir()} == {
        *("maps.csv", "maps.png", "errors.png")
    }

"""The paper's two surveys in images: their missions, and small ones through the study."""

import csv
import os
from pathlib import Path

import pytest

from papers.glacier.surveys import SEEDS, MissionResult, at_median_site, mission_of
from papers.studies import study
from sim.mission.runs import read_mission, resolved_text

EXAMPLE = Path(__file__).parents[3] / "examples" / "mendenhall_like.toml"


def test_the_study_runs_the_example():
    example = read_mission(EXAMPLE, [f"seed={SEEDS[0]}"])
    assert resolved_text(example) == resolved_text(mission_of("lawnmower", SEEDS[0], quick=False))
    steered = ["planner.pattern=piecewise-continuous", "planner.swaths=2", f"seed={SEEDS[0]}"]
    other = read_mission(EXAMPLE, steered)
    assert resolved_text(other) == resolved_text(mission_of("piecewise-continuous", SEEDS[0], quick=False))


def test_the_site_of_the_median_error_is_shown():
    rmse_m = {71: (0.20, 0.40), 72: (0.25, 0.30), 73: (0.20, 0.34), 74: (0.22, 0.28), 75: (0.24, 0.38)}
    done = [
        MissionResult(planner, seed, None, None, None, None, {"elevation": {"rmse_m": value}})
        for seed, values in rmse_m.items()
        for planner, value in zip(("lawnmower", "piecewise-continuous"), values, strict=True)
    ]
    # Means of 0.30, 0.275, 0.27, 0.25 and 0.31 m.
    assert [(one.seed, one.planner) for one in at_median_site(done)] == [
        (72, "lawnmower"),
        (72, "piecewise-continuous"),
    ]


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

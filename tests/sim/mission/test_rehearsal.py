"""Rehearsals: runs with seeds and settings of their own, stored one by one, and what they fail of."""

from pathlib import Path

import pytest
import tomlkit
from typer.testing import CliRunner

from firnline.cli.main import app
from sim.config.mission import MissionConfig
from sim.mission.rehearsal import DRAWN_LOSS, draw_mission, outcomes, rehearse_mission, summarize_outcomes
from survey.core.config import validated
from survey.core.errors import ConfigError, InputError

MISSION = {
    "schema_version": 1,
    "name": "rehearsed",
    "fidelity": "ideal",
    "terrain": {"source": "random", "size_m": 150.0, "step_m": 3.0},
    "planner": {"pattern": "lawnmower", "swaths": 2},
    "reconstruction": {
        "grid_step_m": 8.0,
        "gp": {"fit": False, "variance_m2": 25.0, "length_scale_m": 60.0, "calibrate": False},
    },
    "rehearsal": ({"setting": "rover.speed_m_s", "between": (0.5, 1.5)},),
}
LATE = {"component": "tracks", "failure": "stopped", "from_s": 60.0, "probability": 0.5}


def mission(**changes: object) -> MissionConfig:
    return validated(MissionConfig, MISSION | changes, "the test")


def test_every_run_has_a_seed_and_settings_of_its_own():
    runs = [draw_mission(mission(), k) for k in range(20)]
    assert len({config.seed for config, _ in runs}) == 20
    speeds = [config.rover.speed_m_s for config, _ in runs]
    assert speeds == [drawn["rover.speed_m_s"] for _, drawn in runs]
    assert 0.5 <= min(speeds) < 0.8
    assert 1.2 < max(speeds) <= 1.5
    assert draw_mission(mission(), 7) == draw_mission(mission(), 7)


def test_a_fault_affects_a_rover_with_its_probability():
    drawn = [mission(faults=(LATE,), seed=seed).of_rover(0).faults for seed in range(200)]
    assert sum(len(faults) for faults in drawn) == pytest.approx(100, abs=25)
    certain = mission(faults=(LATE | {"probability": 1.0},))
    assert len(certain.of_rover(0).faults) == 1


def test_outcomes_are_stored_and_not_computed_again(tmp_path: Path):
    folder = rehearse_mission(mission(), tmp_path, 2, workers=1)
    first = (folder / "run-0001.json").stat().st_mtime_ns
    done = list[tuple[int, int]]()
    again = rehearse_mission(
        mission(), tmp_path, 3, workers=1, watch=lambda n, total: done.append((n, total))
    )
    assert again == folder
    assert (folder / "run-0001.json").stat().st_mtime_ns == first
    assert done == [(3, 3)]
    found = outcomes(folder, 3)
    assert [one["run"] for one in found] == [1, 2, 3]
    assert summarize_outcomes(found).n_runs == 3


@pytest.mark.long
def test_outcomes_do_not_depend_on_the_number_of_workers(tmp_path: Path):
    drawn = mission(fidelity="statistical")
    tables = [
        outcomes(rehearse_mission(drawn, tmp_path / str(workers), 2, workers=workers), 2)
        for workers in (1, 2)
    ]
    assert tables[0] == tables[1]


def test_a_run_that_is_refused_is_an_outcome(tmp_path: Path):
    stopped = mission(faults=(LATE | {"from_s": 1.0, "probability": 1.0},))
    found = outcomes(rehearse_mission(stopped, tmp_path, 1, workers=1), 1)
    assert found[0]["cause"] == "refused"
    assert "before it has recorded" in found[0]["message"]


def test_a_setting_that_does_not_exist_is_refused_by_its_name():
    wrong = mission(rehearsal=({"setting": "rover.sped_m_s", "between": (1.0, 2.0)},))
    with pytest.raises(ConfigError, match="speed_m_s"):
        draw_mission(wrong, 0)
    with pytest.raises(ConfigError, match="smaller value first"):
        mission(rehearsal=({"setting": "rover.speed_m_s", "between": (2.0, 1.0)},))


def test_the_interval_is_that_of_a_binomial_share():
    summary = summarize_outcomes([{"cause": "met"}] * 8 + [{"cause": "level"}] * 2)
    assert summary.probability == pytest.approx(0.8)
    assert summary.interval == pytest.approx((0.4439, 0.9748), abs=1e-4)
    assert summarize_outcomes([{"cause": "lost"}] * 3).interval[0] == 0.0


def test_an_outcome_names_the_events_of_its_rovers(tmp_path: Path):
    lost = mission(
        fleet={"loss_probability": 1.0}, faults=({"component": "gps", "failure": "jump", "from_s": 5.0},)
    )
    found = outcomes(rehearse_mission(lost, tmp_path, 1, workers=1), 1)
    assert found[0]["events"] == sorted([DRAWN_LOSS, "gps: jump", "stalled"])


@pytest.mark.long
@pytest.mark.slow
def test_outcomes_on_dask_are_those_of_this_process(tmp_path: Path):
    pytest.importorskip("distributed")
    alone = outcomes(rehearse_mission(mission(), tmp_path / "one", 2, engine="serial"), 2)
    assert outcomes(rehearse_mission(mission(), tmp_path / "two", 2, engine="dask", workers=1), 2) == alone


def test_a_scheduler_that_does_not_answer_is_refused_before_a_run(tmp_path: Path):
    with pytest.raises(InputError, match="no dask scheduler answers"):
        rehearse_mission(mission(), tmp_path, 1, engine="dask", scheduler="tcp://127.0.0.1:9")
    assert not list(tmp_path.rglob("run-*.json"))


def test_the_command_prints_the_probability(tmp_path: Path):
    file = tmp_path / "m.toml"
    file.write_text(tomlkit.dumps(MISSION | {"rehearsal": [dict(MISSION["rehearsal"][0])]}))
    arguments = ["rehearse", str(file), "--count", "1", "--workers", "1", "--runs", str(tmp_path), "-q"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert "of 1 runs: probability" in done.output
    assert list(tmp_path.glob("rehearsed/rehearsal-*/fault_tree.png"))

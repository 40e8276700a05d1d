"""Progress of stages: the time left follows from earlier runs of the same mission."""

from pathlib import Path
from types import SimpleNamespace

from firnline.actions.runs import earlier_seconds
from firnline.cli.progress import TimeLeftColumn, counted
from survey.core.run_folder import RunFolder


def left(expected_s: float | None, elapsed_s: float) -> str:
    task = SimpleNamespace(fields={"expected_s": expected_s}, elapsed=elapsed_s)
    return TimeLeftColumn().render(task).plain


def test_the_time_left_is_stated_where_the_stage_was_timed_before():
    assert left(None, 3.0) == ""
    assert left(200.0, 20.0) == "about 3 min left"
    assert left(30.0, 12.0) == "about 18 s left"
    assert left(10.0, 12.0) == "about to end"


def test_stages_are_timed_by_other_runs_of_the_mission(tmp_path: Path):
    facts = {"mission": "m", "seed": 1, "python": "3.11", "versions": {}}
    mine, other, damaged = (
        RunFolder.open(tmp_path, "m", f"a = {k}\n", {}, facts) for k in ("mine", "other", "damaged")
    )
    for run in (mine, other):
        with run.stage("plan") as folder:
            (folder / "route.txt").write_text("a")
    (damaged.path / "manifest.json").write_text("{}")
    assert earlier_seconds(mine) == {"plan": other.manifest["stages"]["plan"]["wall_s"]}


def test_without_a_terminal_work_prints_a_line_at_once_and_then_each_ten_seconds(monkeypatch, capsys):
    now_s = [100.0]
    monkeypatch.setattr("firnline.cli.progress.time.perf_counter", lambda: now_s[0])
    with counted() as update:
        for done, now_s[0] in ((0, 100.0), (1, 109.0), (2, 110.5), (3, 119.0)):
            update("predicting surveys", done, 9)
    with counted(quiet=True) as update:
        update("predicting surveys", 4, 9)
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(",")[0] for line in lines] == [
        "predicting surveys: 0 of 9",
        "predicting surveys: 2 of 9",
    ]

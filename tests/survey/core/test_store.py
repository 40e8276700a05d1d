import os
from pathlib import Path

import pytest

from survey import InputError
from survey.core.store import RunFolder


def opened(tmp_path: Path, text: str = "seed = 1") -> RunFolder:
    return RunFolder.open(tmp_path, "m", text, {"dem": "0" * 64}, {"seed": 1})


def test_a_failed_stage_leaves_nothing(tmp_path):
    run = opened(tmp_path)

    def failing() -> None:
        with run.stage("plan") as folder:
            (folder / "half.txt").write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        failing()
    assert not run.has("plan")
    assert sorted(p.name for p in run.path.iterdir()) == ["config.toml", "manifest.json"]


def test_the_same_mission_finds_its_folder_again_and_an_edited_one_gets_another(tmp_path):
    run = opened(tmp_path)
    with run.stage("plan") as folder:
        (folder / "a.txt").write_text("a")
    assert opened(tmp_path).has("plan")
    assert not opened(tmp_path, "seed = 2").has("plan")
    assert RunFolder.find(tmp_path / "m").path.name == opened(tmp_path, "seed = 2").path.name


def test_a_leftover_of_a_killed_stage_is_cleared(tmp_path):
    run = opened(tmp_path)
    (run.path / "1-plan.partial").mkdir()
    (run.path / "1-plan.partial" / "half.txt").write_text("half")
    assert not opened(tmp_path).has("plan")
    assert not (run.path / "1-plan.partial").exists()


def test_a_run_that_is_worked_on_is_opened_by_nobody_else(tmp_path):
    run = opened(tmp_path)
    with run.stage("plan") as folder:
        (folder / "a.txt").write_text("a")
        with pytest.raises(InputError, match="another process is working on the run"):
            opened(tmp_path)
    assert (opened(tmp_path).folder("plan") / "a.txt").read_text() == "a"


def test_killed_between_rename_and_manifest_is_still_whole(tmp_path):
    run = opened(tmp_path)
    folder = run.folder("plan")
    folder.mkdir()
    (folder / "a.txt").write_text("a")
    run.verify("plan")
    assert "a.txt" in run.manifest["stages"]["plan"]["files_sha256"]


def test_changed_and_missing_files_are_named(tmp_path):
    run = opened(tmp_path)
    with run.stage("plan") as folder:
        (folder / "a.txt").write_text("a")
    (run.folder("plan") / "a.txt").write_text("b")
    with pytest.raises(InputError, match=r"a\.txt is missing or was changed"):
        run.verify("plan")
    (run.folder("plan") / "a.txt").unlink()
    with pytest.raises(InputError, match=r"a\.txt"):
        run.verify("plan")


def test_discarding_a_stage_discards_what_follows(tmp_path):
    run = opened(tmp_path)
    for stage in ("plan", "simulate", "localize"):
        with run.stage(stage) as folder:
            (folder / "a.txt").write_text(stage)
    run.discard_from("simulate")
    assert [run.has(s) for s in ("plan", "simulate", "localize")] == [True, False, False]


def test_a_damaged_manifest_is_named(tmp_path):
    run = opened(tmp_path)
    (run.path / "manifest.json").write_text('{"stages"')
    with pytest.raises(InputError, match="manifest"):
        _ = run.manifest


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write into read-only folders")
def test_a_read_only_place_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="cannot be made"):
        opened(tmp_path / "runs")

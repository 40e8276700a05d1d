import errno
import os
from pathlib import Path

import pytest

from survey import InputError
from survey.core.run_folder import STAGES, RunFolder


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


def test_a_folder_that_the_manifest_does_not_list_is_not_done(tmp_path):
    # Killed between the rename and the manifest: the stage is done again over it.
    run = opened(tmp_path)
    run.folder("plan").mkdir()
    assert not run.has("plan")
    with pytest.raises(InputError, match="is not done"):
        run.verify("plan")
    with run.stage("plan") as folder:
        (folder / "a.txt").write_text("a")
    assert (run.verified("plan") / "a.txt").read_text() == "a"


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


def done(run: RunFolder, *stages: str) -> RunFolder:
    for stage in stages:
        with run.stage(stage) as folder:
            (folder / "a.txt").write_text(stage)
    return run


def listed(run: RunFolder) -> list[str]:
    return [stage for stage in STAGES if run.has(stage)]


def test_stages_to_be_redone_count_as_not_done_and_stay_until_they_are_replaced(tmp_path):
    run = done(opened(tmp_path), "plan", "simulate", "localize")
    run.redo_from("simulate", {"versions": {"numpy": "3"}})
    assert listed(run) == ["plan"]
    assert run.manifest["versions"] == {"numpy": "3"}
    assert (run.folder("localize") / "a.txt").read_text() == "localize"
    with run.stage("simulate") as folder:
        (folder / "b.txt").write_text("new")
        assert (run.folder("simulate") / "a.txt").exists()
    assert [p.name for p in run.folder("simulate").iterdir()] == ["b.txt"]
    assert listed(run) == ["plan", "simulate"]


def test_a_stage_that_is_replaced_outdates_those_after_it(tmp_path):
    run = done(opened(tmp_path), "plan", "simulate", "localize")
    done(run, "plan")
    assert listed(run) == ["plan"]


def test_fresh_replaces_a_damaged_manifest(tmp_path):
    run = done(opened(tmp_path), "plan")
    (run.path / "manifest.json").write_text("{")
    with pytest.raises(InputError, match="--fresh"):
        opened(tmp_path)
    fresh = RunFolder.open(tmp_path, "m", "seed = 1", {"dem": "0" * 64}, {"seed": 1}, fresh=True)
    assert listed(fresh) == []
    assert fresh.config_text() == "seed = 1"


def test_an_edited_configuration_is_neither_resumed_nor_shown(tmp_path):
    run = done(opened(tmp_path), "plan")
    (run.path / "config.toml").write_text("seed = 2")
    with pytest.raises(InputError, match=r"config\.toml is missing or was changed"):
        run.config_text()
    with pytest.raises(InputError, match=r"config\.toml is missing or was changed"):
        opened(tmp_path)


def test_a_file_that_was_added_to_a_stage_is_refused(tmp_path):
    run = done(opened(tmp_path), "plan")
    (run.folder("plan") / "prior.tif.aux.xml").write_text("<PAMDataset/>")
    with pytest.raises(InputError, match=r"aux\.xml was added"):
        run.verify("plan")


def test_stages_without_a_manifest_are_refused(tmp_path):
    run = done(opened(tmp_path), "plan")
    (run.path / "manifest.json").unlink()
    with pytest.raises(InputError, match="manifest"):
        opened(tmp_path)


def test_an_error_of_the_body_of_a_stage_passes_unchanged(tmp_path):
    run = opened(tmp_path)
    error = OSError(errno.EIO, "Input/output error", "camera.toml")

    def failing() -> None:
        with run.stage("plan"):
            raise error

    with pytest.raises(OSError, match="camera") as caught:
        failing()
    assert caught.value is error
    assert [p.name for p in run.path.iterdir() if p.is_dir()] == []


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write into read-only folders")
def test_a_read_only_place_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="cannot be made"):
        opened(tmp_path / "runs")

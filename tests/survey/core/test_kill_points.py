"""Outputs of a process that is killed before any of its changes are the old ones or the new ones."""

from functools import partial
from pathlib import Path

import pytest

from benchmarks.kill_points import kill_points
from survey.core.files import existing_file, replacing
from survey.core.replacement import replacing_files, replacing_folder
from survey.core.run_folder import RunFolder


def state(folder: Path) -> dict[str, str]:
    """Return the content of all files, drafts left out."""
    files = [file for file in sorted(folder.rglob("*")) if file.is_file()]
    names = {str(file.relative_to(folder)): file.read_text() for file in files}
    return {name: text for name, text in names.items() if not any(p[0] == "." for p in Path(name).parts)}


def write_folder(out: Path, text: str) -> None:
    with replacing_folder(out, own=("*",)) as draft:
        (draft / "deeper").mkdir()
        for name in ("a", "b", "deeper/c", text):
            (draft / name).write_text(text)


def write_grid(out: Path, text: str) -> None:
    """Write a format of several files; the old one has a file that the new one lacks."""
    stale = [out / "a.old.prj"] if text == "new" else []
    with replacing(out / "a.asc", stale=stale) as draft:
        draft.write_text(text)
        draft.with_suffix(".prj").write_text(text)
        if text == "old":
            draft.with_name("a.old.prj").write_text(text)


def write_pair(out: Path, text: str) -> None:
    with replacing_files(out / "route", out / "picture", out / "figures") as (route, picture, figures):
        route.write_text(text)
        picture.write_text(text)
        figures.mkdir()
        (figures / "1").write_text(text)


def completed(path: Path) -> Path:
    """Complete an exchange as the next reader of the file does."""
    return existing_file(path, "the grid")


def test_a_folder_is_the_old_or_the_new_one(tmp_path: Path) -> None:
    out = tmp_path / "out"
    outputs = []
    for text in ("old", "new"):
        write_folder(out, text)
        outputs.append(state(tmp_path))
    points = []
    for point in kill_points(partial(write_folder, out, "new"), partial(write_folder, out, "old")):
        points.append(point)
        assert state(tmp_path) in outputs
    assert len(points) > 10


def test_a_format_of_several_files_is_the_old_or_the_new_one_once_it_is_read(tmp_path: Path) -> None:
    outputs = []
    for text in ("old", "new"):
        write_grid(tmp_path, text)
        outputs.append(state(tmp_path))
    assert len(outputs[0]) == 3
    points = []
    for point in kill_points(partial(write_grid, tmp_path, "new"), partial(write_grid, tmp_path, "old")):
        points.append(point)
        completed(tmp_path / "a.asc")
        assert state(tmp_path) in outputs
    assert len(points) > 5


def test_a_companion_never_stands_beside_another_main_file(tmp_path: Path) -> None:
    points = []
    for point in kill_points(partial(write_pair, tmp_path, "new"), partial(write_pair, tmp_path, "old")):
        points.append(point)
        found = state(tmp_path)
        assert "route" in found
        assert len(set(found.values())) == 1
    assert len(points) > 5


@pytest.mark.long
@pytest.mark.parametrize("stage", ["plan", "simulate"])
def test_a_listed_stage_of_a_run_has_the_files_that_it_listed(tmp_path: Path, stage: str) -> None:
    def opened() -> RunFolder:
        return RunFolder.open(tmp_path, "mission", "a = 1\n", {}, {})

    def write(name: str, text: str) -> None:
        with opened().stage(name) as folder:
            for file in ("a", text):
                (folder / file).write_text(text)

    def prepare() -> None:
        for name in ("plan", "simulate"):
            write(name, "old")

    for _ in kill_points(partial(write, stage, "new"), prepare):
        run = opened()
        for name in run.manifest["stages"]:
            run.verify(name)

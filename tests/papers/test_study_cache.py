"""Drafts and records of studies, with processes that end at every change of a file."""

from functools import partial

import pytest

from benchmarks.kill_points import kill_points
from papers.provenance import Began
from papers.studies import is_complete, replacing_study
from survey.core.errors import InputError


def make(folder, *, quick):
    """Write a study whose files depend on its depth, in the draft and in a folder of blocks."""
    with replacing_study(folder, quick=quick) as draft:
        (draft / "blocks").mkdir(exist_ok=True)
        (draft / "blocks" / "1").write_text("block")
        (draft / "table.csv").write_text("quick" if quick else "full")
        (draft / ("rough.csv" if quick else "fine.csv")).write_text("x")
        for file in (draft / "blocks").iterdir():
            file.unlink()
        (draft / "blocks").rmdir()


def state(folder):
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_text() for path in files}


@pytest.mark.long
def test_a_study_that_is_killed_at_any_change_of_a_file_is_the_old_or_the_new_one(tmp_path, monkeypatch):
    # The date and the times of a run differ from one process to the next.
    monkeypatch.setattr(Began, "facts", lambda _, *, quick, **more: {"quick": quick, **more})
    folder = tmp_path / "out" / "study"
    outputs = {}
    for quick in (False, True):
        make(folder, quick=quick)
        outputs[quick] = state(folder)
    for quick in (False, True):
        points = []
        for point in kill_points(partial(make, folder, quick=quick), partial(make, folder, quick=not quick)):
            points.append(point)
            assert state(folder) in outputs.values()
            make(folder, quick=not quick)
            assert state(folder) == outputs[not quick]
        assert len(points) > 10
    make(folder, quick=False)
    assert [path.name for path in folder.parent.iterdir()] == ["study"]


def test_files_of_a_stopped_study_are_made_again_and_its_blocks_stay(tmp_path):
    draft = tmp_path / "study.unfinished-quick"
    (draft / "unfinished").mkdir(parents=True)
    (draft / "unfinished" / "block").write_text("done")
    (draft / ".table-x").mkdir()
    (draft / ".table-x" / "table.csv").write_text("half")
    (draft / "of_another_version.csv").write_text("old")
    with replacing_study(tmp_path / "study", quick=True) as place:
        assert [path.name for path in place.iterdir()] == ["unfinished"]
        (place / "unfinished" / "block").unlink()
        (place / "unfinished").rmdir()
        (place / "table.csv").write_text("new")
    assert sorted(path.name for path in (tmp_path / "study").iterdir()) == ["made.json", "table.csv"]
    assert is_complete(tmp_path / "study", quick=True)


def test_a_folder_with_files_of_others_is_refused_before_the_study_is_made(tmp_path):
    (tmp_path / "study").mkdir()
    (tmp_path / "study" / "thesis.doc").write_text("mine")
    with pytest.raises(InputError, match=r"thesis\.doc"), replacing_study(tmp_path / "study", quick=False):
        pytest.fail("the study was made")


def test_a_study_is_complete_without_the_photographs_that_are_not_kept(tmp_path):
    folder = tmp_path / "study"
    for _ in range(2):  # a picture that is there is no file of others
        with replacing_study(folder, quick=True) as draft:
            (draft / "photographs.csv").write_text("measures")
            (draft / "photographs.png").write_text("picture")
        assert (folder / "photographs.png").exists()
    (folder / "photographs.png").unlink()
    assert is_complete(folder, quick=True)


def test_two_processes_do_not_make_the_same_study(tmp_path):
    with (
        replacing_study(tmp_path / "study", quick=False),
        pytest.raises(InputError, match="another process"),
        replacing_study(tmp_path / "study", quick=False),
    ):
        pytest.fail("the study was made twice")

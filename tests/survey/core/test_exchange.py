import errno
import os
import subprocess
import sys

import pytest

from survey import InputError
from survey.core import replacement
from survey.core.files import write_refusal
from survey.core.replacement import refuse_foreign, replacing_files, replacing_folder

OWN = ("*.txt", "pictures/*.png")


def write(folder, text):
    (folder / "a.txt").write_text(text)
    (folder / "pictures").mkdir()
    (folder / "pictures" / f"{text}.png").write_text(text)


def names(folder):
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file())


def replaced(out, text):
    with replacing_folder(out, own=OWN) as draft:
        write(draft, text)


def test_a_new_folder_and_its_parents_are_created(tmp_path):
    replaced(tmp_path / "deep" / "map", "new")
    assert names(tmp_path) == ["deep/map/a.txt", "deep/map/pictures/new.png"]


@pytest.mark.parametrize("is_supported", [True, False])
def test_the_old_folder_goes_with_all_its_files(tmp_path, monkeypatch, is_supported):
    if not is_supported:
        monkeypatch.setattr(replacement, "_exchanged_at_once", lambda *_: False)
    replaced(tmp_path / "map", "old")
    replaced(tmp_path / "map", "new")
    assert names(tmp_path) == ["map/a.txt", "map/pictures/new.png"]


@pytest.mark.parametrize(
    "error", [OSError(errno.EIO, "Input/output error"), KeyboardInterrupt(), ValueError()]
)
def test_an_error_of_the_body_passes_unchanged_and_leaves_the_old_folder(tmp_path, error):
    replaced(tmp_path / "map", "old")

    def failing():
        with replacing_folder(tmp_path / "map", own=OWN) as draft:
            write(draft, "new")
            raise error

    with pytest.raises(type(error)) as caught:
        failing()
    assert caught.value is error
    assert names(tmp_path) == ["map/a.txt", "map/pictures/old.png"]


def test_files_of_others_are_never_deleted(tmp_path):
    replaced(tmp_path / "map", "old")
    (tmp_path / "map" / "thesis.doc").write_text("mine")
    with pytest.raises(InputError, match=r"holds 'thesis\.doc'"):
        replaced(tmp_path / "map", "new")
    assert names(tmp_path / "map") == ["a.txt", "pictures/old.png", "thesis.doc"]


def test_a_file_and_the_current_folder_are_refused(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="is a file"):
        refuse_foreign(tmp_path / "file", OWN)
    (tmp_path / "deep").mkdir()
    monkeypatch.chdir(tmp_path / "deep")
    for place in (".", ".."):
        with pytest.raises(InputError, match="contains the current folder"):
            refuse_foreign((tmp_path / "deep" / place), OWN)


def test_two_writers_of_one_folder_exclude_one_another(tmp_path):
    with replacing_folder(tmp_path / "map", own=OWN) as draft:
        write(draft, "first")
        with pytest.raises(InputError, match="another process is writing"):
            replaced(tmp_path / "map", "second")
    assert names(tmp_path) == ["map/a.txt", "map/pictures/first.png"]


def test_a_killed_writer_leaves_the_old_folder_and_the_next_one_clears_its_draft(tmp_path):
    replaced(tmp_path / "map", "old")
    killed = (
        "import os, sys, signal\n"
        "from survey.core.replacement import replacing_folder\n"
        "with replacing_folder(sys.argv[1], own=('*',)) as draft:\n"
        "    (draft / 'a.txt').write_text('half')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    subprocess.run([sys.executable, "-c", killed, str(tmp_path / "map")], check=False)
    assert (tmp_path / "map" / "a.txt").read_text() == "old"
    assert (tmp_path / ".map.draft").exists()
    replaced(tmp_path / "map", "new")
    assert names(tmp_path) == ["map/a.txt", "map/pictures/new.png"]


def test_a_group_of_files_is_put_in_place_together(tmp_path):
    (tmp_path / "route.geojson").write_text("old")
    (tmp_path / "route.png").write_text("old")
    with replacing_files(tmp_path / "route.geojson", tmp_path / "route.png") as (route, picture):
        route.write_text("new")
        assert (tmp_path / "route.geojson").read_text() == "old"
        picture.write_text("new")
        (route.parent / "route.prj").write_text("new")
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == dict.fromkeys(
        ("route.geojson", "route.png", "route.prj"), "new"
    )


def test_no_old_companion_stays_beside_a_new_main_file(tmp_path):
    (tmp_path / "route.png").write_text("old")
    with replacing_files(tmp_path / "route.geojson", tmp_path / "route.png") as (route, _):
        route.write_text("new")
    assert names(tmp_path) == ["route.geojson"]


def test_a_group_that_fails_leaves_what_was_there(tmp_path):
    (tmp_path / "route.geojson").write_text("old")

    def failing():
        with replacing_files(tmp_path / "route.geojson", tmp_path / "route.png") as (route, _):
            route.write_text("new")
            raise KeyError

    with pytest.raises(KeyError):
        failing()
    assert names(tmp_path) == ["route.geojson"]
    assert (tmp_path / "route.geojson").read_text() == "old"


def test_only_a_full_disk_asks_for_space(tmp_path):
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    read_only = OSError(errno.EROFS, os.strerror(errno.EROFS))
    assert "free space" in str(write_refusal(tmp_path, full))
    assert "free space" not in str(write_refusal(tmp_path, read_only))


def test_a_place_that_cannot_be_made_is_refused():
    with pytest.raises(InputError, match="could not be written"), replacing_folder("/proc/x/map", own=OWN):
        pass
    with pytest.raises(InputError, match="could not be written"), replacing_files("/proc/x/route.geojson"):
        pass


def test_an_old_folder_beside_a_main_file_is_removed_before_the_main_file_is_replaced(tmp_path):
    (tmp_path / "page").mkdir()  # a folder in the place of the main file stops the replacement there
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "old.png").write_bytes(b"old")
    with pytest.raises(InputError):
        write_page_with_figures(tmp_path)
    assert not (tmp_path / "figures").exists()


def write_page_with_figures(folder):
    with replacing_files(folder / "page", folder / "figures") as (page, figures):
        page.write_text("new")
        figures.mkdir()
        (figures / "new.png").write_bytes(b"new")

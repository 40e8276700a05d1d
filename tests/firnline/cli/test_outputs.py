from pathlib import Path

import pytest

from firnline.actions.interface import refuse_existing
from survey import InputError

OWN = ("*.tif",)


def test_outputs_that_do_not_exist_pass(tmp_path):
    refuse_existing([tmp_path / "route.geojson", tmp_path / "route.png"], force=False)
    refuse_existing([tmp_path / "new" / "map"], force=False, own=OWN)
    assert list(tmp_path.iterdir()) == []


def test_every_output_that_exists_needs_force(tmp_path):
    (tmp_path / "route.png").write_text("mine")
    outputs = [tmp_path / "route.geojson", tmp_path / "route.png"]
    with pytest.raises(InputError, match=r"route\.png exists"):
        refuse_existing(outputs, force=False)
    refuse_existing(outputs, force=True)


def test_an_empty_folder_counts_as_missing_and_a_filled_one_needs_force(tmp_path):
    (tmp_path / "map").mkdir()
    refuse_existing([tmp_path / "map"], force=False, own=OWN)
    (tmp_path / "map" / "dem.tif").write_text("old")
    with pytest.raises(InputError, match="map exists"):
        refuse_existing([tmp_path / "map"], force=False, own=OWN)
    refuse_existing([tmp_path / "map"], force=True, own=OWN)


def test_files_of_others_are_refused_before_any_work(tmp_path):
    (tmp_path / "map").mkdir()
    (tmp_path / "map" / "thesis.doc").write_text("mine")
    with pytest.raises(InputError, match=r"thesis\.doc"):
        refuse_existing([tmp_path / "map"], force=True, own=OWN)


def test_an_input_is_never_an_output(tmp_path):
    (tmp_path / "dem.tif").write_text("mine")
    for output in (tmp_path / "dem.tif", tmp_path / ".." / tmp_path.name / "dem.tif"):
        with pytest.raises(InputError, match="the input"):
            refuse_existing([output], force=True, inputs=[None, tmp_path / "dem.tif"])
    with pytest.raises(InputError, match="contains the input"):
        refuse_existing([tmp_path], force=True, inputs=[tmp_path / "dem.tif"], own=("*",))


def test_an_input_is_recognised_behind_a_link(tmp_path):
    (tmp_path / "dem.tif").write_text("mine")
    (tmp_path / "link.tif").symlink_to(tmp_path / "dem.tif")
    with pytest.raises(InputError, match="the input"):
        refuse_existing([tmp_path / "link.tif"], force=True, inputs=[tmp_path / "dem.tif"])


def test_places_where_nothing_can_be_written_are_refused(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="is a file"):
        refuse_existing([tmp_path / "file" / "deep" / "map"], force=False, own=OWN)
    with pytest.raises(InputError, match="does not exist"):
        refuse_existing([tmp_path / "missing" / "route.geojson"], force=False)
    with pytest.raises(InputError, match="could not be written"):
        refuse_existing([Path("/proc/map")], force=False, own=OWN)


def test_a_folder_is_no_place_for_a_file(tmp_path):
    with pytest.raises(InputError):
        refuse_existing([tmp_path], force=True)

"""A file is replaced by a complete new one or stays as it was, and what cannot be read is refused."""

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely
from pyproj import CRS

from survey import Dem, Grid, InputError
from survey.core.documents import read_json, write_json
from survey.core.files import existing_file, finish_exchange, replacing, unwritable
from survey.io.vector import read_features, write_features

UTM = "EPSG:32608"


def test_an_error_of_the_body_passes_through_and_nothing_changes(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("old")
    for fault in (
        ValueError("no"),
        FileNotFoundError(errno.ENOENT, "missing", "other.txt"),
        OSError("no disk"),
    ):
        with pytest.raises(type(fault)) as caught, replacing(tmp_path / "a.txt") as draft:  # noqa: PT012
            draft.write_text("new")
            raise fault
        assert caught.value is fault
    assert [file.read_text() for file in tmp_path.iterdir()] == ["old"]


@pytest.mark.parametrize(("code", "asks"), [(errno.ENOSPC, True), (errno.EDQUOT, True), (errno.EIO, False)])
def test_only_a_full_disk_asks_for_space(code: int, asks: bool, tmp_path: Path) -> None:
    with pytest.raises(InputError) as refusal, replacing(tmp_path / "a.txt"):
        raise OSError(code, os.strerror(code))
    assert ("free space" in str(refusal.value)) == asks
    assert "free space" not in str(unwritable(tmp_path / "a.tif", "the driver has no such option"))


def test_a_place_below_a_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="is no folder"), replacing(tmp_path / "file" / "a.txt"):
        pass
    with pytest.raises(InputError, match="does not exist"), replacing(tmp_path / "none" / "a.txt"):
        pass


def test_metadata_of_the_replaced_raster_goes_with_it_and_that_of_others_stays(tmp_path: Path) -> None:
    dem = Dem.on(Grid((5.0, 5.0, 35.0, 25.0), 10.0, UTM), np.ones((3, 4)))
    dem.write(tmp_path / "a.tif")
    for name in ("a.tif.aux.xml", "a.tif.msk", "a.prj", "ab.tif.aux.xml"):
        (tmp_path / name).write_text("<PAMDataset/>")
    dem.write(tmp_path / "a.tif")
    assert sorted(f.name for f in tmp_path.iterdir()) == ["a.prj", "a.tif", "ab.tif.aux.xml"]


def squares(path: Path, n: int) -> None:
    shapes = [shapely.box(k, 0, k + 1, 1) for k in range(n)]
    write_features(path, shapes, {"k": np.arange(float(n))}, CRS(UTM), layer="a")


def test_an_exchange_that_was_begun_is_completed_by_the_next_reader(tmp_path: Path) -> None:
    squares(tmp_path / "a.shp", 3)
    new = tmp_path / "new"
    new.mkdir()
    squares(new / "a.shp", 5)
    new.rename(tmp_path / ".a.shp.exchange")
    # The first of the new files was moved before the writer was killed.
    (tmp_path / ".a.shp.exchange" / "a.dbf").replace(tmp_path / "a.dbf")
    assert len(read_features(tmp_path / "a.shp").geometry) == 5
    assert not (tmp_path / ".a.shp.exchange").exists()


def test_an_exchange_removes_no_files_of_others(tmp_path: Path) -> None:
    ready = tmp_path / ".a.shp.exchange"
    ready.mkdir()
    (ready / ".removed").write_text("b.txt\n../a.txt\n")
    (ready / "b.txt").write_text("x")
    for name in ("b.txt", "a.shp"):
        (tmp_path / name).write_text("mine")
    finish_exchange(tmp_path / "a.shp")
    assert sorted(f.name for f in tmp_path.iterdir()) == ["a.shp", "b.txt"]
    assert (tmp_path / "b.txt").read_text() == "mine"


_WRITER = """
import sys
from pathlib import Path
from tests.survey.core.test_files import squares
path = Path(sys.argv[1])
squares(path, 3)
print("ready", flush=True)
n = 3
while True:
    n = 5 if n == 3 else 3
    squares(path, n)
"""


@pytest.mark.reliability
def test_killed_at_any_time_a_shapefile_is_old_or_new(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for _ in range(int(os.environ.get("FIRNLINE_KILLS", "4"))):
        command = [sys.executable, "-c", _WRITER, str(tmp_path / "a.shp")]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as writer:
            assert writer.stdout is not None
            assert writer.stdout.readline() == b"ready\n"
            with pytest.raises(subprocess.TimeoutExpired):
                writer.wait(rng.uniform(0.0, 0.3))
            writer.send_signal(signal.SIGKILL)
        features = read_features(tmp_path / "a.shp")
        assert len(features.geometry) in (3, 5)
        np.testing.assert_array_equal(features.attributes["k"], np.arange(len(features.geometry)))


def test_what_is_no_readable_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_text("x")
    for path, words in (
        (tmp_path, "is a folder"),
        (tmp_path / "pipe", "no regular file"),
        (tmp_path / "file" / "below", "does not exist"),
        (tmp_path / ("x" * 300), "cannot be reached"),
        ("a\0b", "does not exist|cannot be reached"),
        (".", "is a folder"),
    ):
        with pytest.raises(InputError, match=words):
            existing_file(path, "the file")


def test_names_that_are_no_utf_8_are_read_and_written(tmp_path: Path) -> None:
    place = Path(os.fsdecode(bytes(tmp_path / "x") + b"\xff.json"))
    write_json(place, {"file": str(place)})
    assert read_json(place, "the document")["file"] == str(place)
    with pytest.raises(InputError):
        Dem.read(place.with_suffix(".tif"))
    raster = place.with_suffix(".tif")
    raster.write_bytes(b"II*\0")
    with pytest.raises(InputError):
        Dem.read(raster)


def test_documents_that_are_damaged_are_refused(tmp_path: Path) -> None:
    for content, words in ((b"[" * 100_000, "nested"), (b"\xff", "damaged"), (b"[]", "object")):
        (tmp_path / "a.json").write_bytes(content)
        with pytest.raises(InputError, match=words):
            read_json(tmp_path / "a.json", "the document")

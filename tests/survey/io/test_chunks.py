"""Point files read in chunks."""

from pathlib import Path

import numpy as np
import plyfile
import pyarrow as pa
import pytest
from pyarrow import parquet

from survey.core.errors import InputError
from survey.io import point_chunks
from survey.io.point_chunks import chunked_files, point_file_facts, read_chunks
from tests.survey.reconstruction.tiled.conftest import write_laz

XYZ = np.round(np.random.default_rng(1).uniform(0.0, 100.0, (500, 3)), 3)
STRIP = np.repeat([3, 4], 250)


def write_ply(path: Path) -> Path:
    rows = np.empty(500, [("x", "f8"), ("y", "f8"), ("z", "f8"), ("point_source_id", "u2")])
    rows["x"], rows["y"], rows["z"], rows["point_source_id"] = *XYZ.T, STRIP
    element = plyfile.PlyElement.describe(rows, "vertex")
    plyfile.PlyData([element], text=False, comments=["crs EPSG:32608"]).write(str(path))
    return path


def write_parquet(path: Path) -> Path:
    columns = dict(zip(("x", "y", "z"), XYZ.T, strict=True))
    table = pa.table({**columns, "point_source_id": STRIP}).replace_schema_metadata({"crs": "EPSG:32608"})
    parquet.write_table(table, path, row_group_size=200)
    return path


@pytest.fixture(params=["laz", "ply", "parquet"])
def file(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(point_chunks, "CHUNK_POINTS", 120)
    if request.param == "laz":
        return write_laz(tmp_path / "a.laz", XYZ, STRIP)
    return write_ply(tmp_path / "a.ply") if request.param == "ply" else write_parquet(tmp_path / "a.parquet")


def test_chunks_are_the_points_in_their_order(file: Path) -> None:
    found = list(read_chunks(file, 0, 500))
    assert max(len(chunk.xyz) for chunk in found) <= 120
    assert np.concatenate([chunk.xyz for chunk in found]) == pytest.approx(XYZ, abs=1e-6)
    assert (np.concatenate([chunk.strip for chunk in found]) == STRIP).all()


def test_a_part_of_a_file_is_read(file: Path) -> None:
    found = np.concatenate([chunk.xyz for chunk in read_chunks(file, 190, 230)])
    assert found == pytest.approx(XYZ[190:420], abs=1e-6)


def test_facts_are_number_bounds_and_crs(file: Path) -> None:
    facts = point_file_facts(file)
    assert facts.n_points == 500
    assert facts.bounds == pytest.approx((*XYZ[:, :2].min(axis=0), *XYZ[:, :2].max(axis=0)), abs=1e-3)
    assert "32608" in str(facts.crs) or "zone 8N" in str(facts.crs)


def test_missing_points_are_refused(file: Path) -> None:
    with pytest.raises(InputError, match="it was cut off"):
        list(read_chunks(file, 400, 200))


def test_coordinates_that_are_no_numbers_are_refused(tmp_path: Path) -> None:
    table = pa.table({"x": [1.0, np.nan], "y": [1.0, 2.0], "z": [1.0, 2.0]})
    parquet.write_table(table, tmp_path / "a.parquet")
    with pytest.raises(InputError, match="NaN or infinite"):
        list(read_chunks(tmp_path / "a.parquet", 0, 2))


def test_columns_without_coordinates_are_refused(tmp_path: Path) -> None:
    parquet.write_table(pa.table({"x": [1.0], "height": [2.0]}), tmp_path / "a.parquet")
    with pytest.raises(InputError, match=r"no columns x, y and z \(found: x, height\)"):
        point_file_facts(tmp_path / "a.parquet")


@pytest.mark.parametrize("name", ["a.laz", "a.ply", "a.parquet"])
def test_damaged_files_are_refused_in_a_sentence(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"no points at all" * 20)
    with pytest.raises(InputError, match="damaged"):
        point_file_facts(tmp_path / name)


def test_folders_are_opened(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no points")
    file = write_parquet(tmp_path / "a.parquet")
    assert chunked_files([tmp_path, file]) == [file]


def test_other_endings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read in chunks"):
        chunked_files([tmp_path / "a.e57"])

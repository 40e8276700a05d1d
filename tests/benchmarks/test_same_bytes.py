"""Two folders of outputs are compared file by file, by bytes and then by values."""

import json
import sqlite3

import numpy as np
import pytest

from benchmarks.same_bytes import compared


def write_table(path, heights, changed):
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE points (z REAL)")
        database.execute("CREATE TABLE gpkg_contents (last_change TEXT)")
        database.executemany("INSERT INTO points VALUES (?)", [(z,) for z in heights])
        database.execute("INSERT INTO gpkg_contents VALUES (?)", (changed,))
    database.close()


@pytest.fixture
def folders(tmp_path):
    before, after = tmp_path / "before", tmp_path / "after"
    for folder in (before, after):
        folder.mkdir()
        (folder / "made.json").write_text(json.dumps({"folder": folder.name}))
        (folder / "same.csv").write_text("x_m\n1\n")
    (before / "score.json").write_text('{"rmse_m": 0.1, "n": [1, 2]}')
    (after / "score.json").write_text('{"n": [1, 2], "rmse_m": 0.1, "mae_m": 0.05}')
    (before / "route.geojson").write_text('{"legs": [{"length_m": 1.0}]}')
    (after / "route.geojson").write_text('{"legs": [{"length_m": 2.0}]}')
    np.savez(before / "a.npz", z=np.arange(3.0))
    np.savez(after / "a.npz", z=np.arange(3.0), crc=1)
    write_table(before / "p.gpkg", [1.0, 2.0], "2026-01-01")
    write_table(after / "p.gpkg", [1.0, 2.0], "2026-01-02")
    (before / "old.png").write_bytes(b"1")
    return before, after


def test_each_file_but_the_records_has_a_verdict(folders):
    found = {name: (verdict, values) for name, verdict, values in compared(*folders)}
    assert found == {
        "same.csv": ("same bytes", []),
        "score.json": ("same values", []),
        "a.npz": ("same values", []),
        "p.gpkg": ("same values", []),
        "route.geojson": ("different", ["legs.0.length_m"]),
        "old.png": ("different", ["only before"]),
    }

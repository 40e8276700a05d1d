"""Checkpoints, exports and refusals from the command line."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from sim.cli.main import app
from survey import Dem, Grid

UTM = "EPSG:32608"


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A map that is 5 cm off at checkpoints spread evenly over it."""
    monkeypatch.chdir(tmp_path)
    grid = Grid((0.0, 0.0, 600.0, 600.0), 10.0, UTM)
    x, y = np.meshgrid(grid.x, grid.y)
    plane = Dem.on(grid, 100.0 + 0.1 * x - 0.05 * y, "EGM96 height")
    plane.write("map.tif")
    places = np.stack(np.meshgrid(np.arange(45.0, 600.0, 100.0), np.arange(45.0, 600.0, 110.0)), -1).reshape(
        -1, 2
    )
    heights = plane.at(places) + 0.05 * np.where(np.arange(len(places)) % 2 == 0, 1.0, -1.0)
    rows = [f"P{k},{e},{n},{z},0.02\n" for k, ((e, n), z) in enumerate(zip(places, heights, strict=True))]
    Path("all.csv").write_text("name,x_m,y_m,z_m,sigma_z_m\n" + "".join(rows[:36]))
    Path("few.csv").write_text("name,x_m,y_m,z_m,sigma_z_m\n" + "".join(rows[:29]))
    return tmp_path


def told(*args: str, code: int = 0) -> str:
    done = CliRunner().invoke(app, list(args))
    assert done.exit_code == code, done.output
    return done.stdout if code == 0 else done.stderr


def test_checkpoints_are_judged_by_a_named_edition(site: Path) -> None:
    args = ("--class", "0.10", "--datum", "EGM96 height", "--json")
    for file, n, outcome in (("few.csv", 29, "not assessed to the standard"), ("all.csv", None, "met")):
        found = json.loads(told("score", "map.tif", "--checkpoints", file, *args))
        finding = found["assessments"][0]
        assert finding["outcome"] == outcome
        assert "Edition 2" in finding["edition"]
        assert finding["n"] == (n or len(Path(file).read_text().splitlines()) - 1)
        assert found["elevation"]["rmse_m"] == pytest.approx(0.05, abs=1e-5)
    words = told("score", "map.tif", "--checkpoints", "few.csv", "--standard", "nssda-1998")
    assert "tested accuracy at 95 % 0.098 m" in words
    assert "tens of metres" in words


def test_checkpoints_that_are_control_unknown_standards_and_other_datums_are_refused(site: Path) -> None:
    score = ("score", "map.tif", "--checkpoints", "all.csv")
    assert "within 0.1 m of control" in told(*score, "--control", "few.csv", code=3)
    assert "asprs-2014" in told(*score, "--standard", "asprs-2020", code=4)
    assert "vertical datums" in told(*score, "--datum", "ellipsoidal height", code=3)


def test_a_map_goes_through_every_format_and_back(site: Path) -> None:
    told("export", "map.tif", "map.nc")
    told("export", "map.nc", "map.asc")
    told("export", "map.asc", "again.tif", "--crs", UTM)
    np.testing.assert_array_equal(Dem.read("again.tif").elevation, Dem.read("map.tif").elevation)
    told("export", "all.csv", "points.laz", "--crs", UTM, code=3)
    assert "not known" in told("export", "map.tif", "x.gpkg", "--as", "poem", code=4)

"""``firnline payload``: a real log joins a drive or brings its own places."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from firnline.cli.main import app
from survey import Dem, Grid

GRID = Grid((0.0, 0.0, 200.0, 200.0), 10.0, "EPSG:32608")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    x, y = np.meshgrid(GRID.x, GRID.y)
    Dem.on(GRID, 0.1 * x + 3.0 * np.sin(y / 40.0)).write("dem.tif")
    xy = np.random.default_rng(1).uniform(0.0, 200.0, (200, 2))
    warm = -4.0 + np.sin(xy[:, 0] / 50.0)
    lines = [f"{e},{n},{t}" for (e, n), t in zip(xy, warm, strict=True)]
    Path("log.csv").write_text("\n".join(["easting_m,northing_m,air_temperature", *lines]) + "\n")
    return tmp_path


def run(*arguments: str) -> tuple[int, str]:
    command = ["payload", "log.csv", "--name", "air_temperature", "--unit", "degC", "--terrain", "dem.tif"]
    done = CliRunner().invoke(app, [*command, *arguments])
    return done.exit_code, done.output


def test_a_log_with_places_is_mapped_and_written(folder):
    code, said = run("--noise", "0.01")
    assert code == 0, said
    assert "200 readings" in said
    assert {"dem.tif", "air_temperature.nc", "reconstruction.json"} <= {
        file.name for file in (folder / "payload").iterdir()
    }
    code, said = run()
    assert code != 0
    assert "payload" in said


def test_logs_without_as_many_paths_are_refused(folder):
    code, said = run("--trajectory", "a.csv", "--trajectory", "b.csv")
    assert code == 4
    assert "2 trajectories" in said
    assert not (folder / "payload").exists()


def test_readings_in_one_place_are_refused(folder):
    rows = "".join(f"100.0,100.0,{k % 3}\n" for k in range(20))
    Path("log.csv").write_text("easting_m,northing_m,air_temperature\n" + rows)
    code, said = run()
    assert (code, "a map needs readings along a way" in said) == (3, True)

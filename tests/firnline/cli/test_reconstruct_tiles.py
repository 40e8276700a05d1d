"""``firnline reconstruct --tiles``."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from firnline.cli.main import app
from survey import SurfacePoints
from tests.survey.reconstruction.tiled.conftest import ground, strip_points, write_laz

SMALL = ["--set", "tiles.tile_cells=80", "--set", "tiles.halo_cells=40", "--set", "tiles.n_draws=8"]


def invoked(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["reconstruct", *map(str, arguments)])


@pytest.fixture(scope="module")
def points(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("points")
    return write_laz(folder / "a.laz", strip_points(1, 0.0, 100.0, 0.0), np.full(20_000, 7))


@pytest.mark.pictures
def test_a_map_in_tiles_is_written_with_its_test(points: Path, tmp_path: Path) -> None:
    xy = np.array([[20.0, 30.0], [70.0, 90.0]])
    rows = [f"{x},{y},{z},0.01" for (x, y), z in zip(xy, ground(*xy.T), strict=True)]
    control = tmp_path / "gnss.csv"
    control.write_text("\n".join(["x_m,y_m,z_m,sigma_z_m", *rows]) + "\n")
    result = invoked(points, "--tiles", "--workers", 1, "--control", control, "-o", tmp_path / "map", *SMALL)
    assert result.exit_code == 0, result.output
    assert "within the 95 % interval" in result.output
    facts = json.loads((tmp_path / "map" / "reconstruction.json").read_text())
    assert facts["diagnostics"]["n_control"] == 2
    assert abs(facts["diagnostics"]["strips"]["7"]["offset_m"]) < 0.05
    assert {"dem.vrt", "withheld.png", "coverage.tif"} <= {f.name for f in (tmp_path / "map").iterdir()}
    again = invoked(points, "--tiles", "-o", tmp_path / "map")
    assert again.exit_code == 3
    assert "holds a finished map" in again.output


def test_a_dry_run_states_points_tiles_and_disk(points: Path, tmp_path: Path) -> None:
    result = invoked(points, "--tiles", "--dry-run", "-o", tmp_path / "map", *SMALL)
    assert result.exit_code == 0, result.output
    assert "20,000 points in 1 files" in result.output
    assert "GB of disk" in result.output
    assert not (tmp_path / "map").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--tiles", "--method", "gp"], "do not use --method"),
        (["--workers", "2"], "--workers is of maps in tiles"),
        (["--control", "a.csv"], "--control is of maps in tiles"),
        (["--tiles", "--scheduler", "nowhere"], "no scheduler's address"),
    ],
)
def test_options_that_do_not_belong_together_are_refused(
    points: Path, tmp_path: Path, options: list[str], said: str
) -> None:
    result = invoked(points, *options, "-o", tmp_path / "map", *SMALL)
    assert result.exit_code in (3, 4)
    assert said in result.output


def test_a_setting_that_is_not_known_is_refused(points: Path, tmp_path: Path) -> None:
    result = invoked(points, "--tiles", "--set", "tiles.halo=4", "-o", tmp_path / "map")
    assert result.exit_code == 4
    assert "halo" in result.output


def test_foreign_files_in_the_folder_are_never_deleted(points: Path, tmp_path: Path) -> None:
    (tmp_path / "map").mkdir()
    (tmp_path / "map" / "mine.txt").write_text("mine")
    result = invoked(points, "--tiles", "--force", "-o", tmp_path / "map")
    assert result.exit_code == 3
    assert (tmp_path / "map" / "mine.txt").read_text() == "mine"


def test_control_points_beside_the_map_are_refused(points: Path, tmp_path: Path) -> None:
    control = tmp_path / "gnss.csv"
    control.write_text("x_m,y_m,z_m,sigma_z_m\n9000.0,9000.0,5.0,0.01\n")
    result = invoked(points, "--tiles", "--control", control, "--dry-run", "-o", tmp_path / "map", *SMALL)
    assert result.exit_code == 3
    assert "none of the 1 control points" in result.output


def test_files_above_different_datums_are_refused(tmp_path: Path) -> None:
    for name, datum in (("a.las", "EGM96 height"), ("b.las", "ellipsoidal height")):
        xyz = strip_points(1, 0.0, 100.0, 0.0)[:50]
        SurfacePoints(xyz, sigma_m=0.05, crs="EPSG:32608", vertical_datum=datum).write(tmp_path / name)
    result = invoked(tmp_path / "a.las", tmp_path / "b.las", "--tiles", "-o", tmp_path / "map", *SMALL)
    assert (result.exit_code, "different vertical datums" in result.output) == (3, True)

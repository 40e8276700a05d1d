"""`firnline track`: displacements of two rasters as points."""

from pathlib import Path

import geopandas
import numpy as np
import pytest
from typer.testing import CliRunner

from firnline.cli.main import app
from survey import Dem, Grid


@pytest.fixture
def pair(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two rasters of bumps that move by 6 m to the east and 2 m to the south."""
    grid = Grid((0.0, 0.0, 300.0, 300.0), 3.0, "EPSG:32608")
    x, y = np.meshgrid(grid.x, grid.y)
    waves = np.random.default_rng(3).uniform(-0.2, 0.2, (60, 2))
    for name, (east, north) in {"a.tif": (0.0, 0.0), "b.tif": (6.0, -2.0)}.items():
        heights = sum(np.cos((x - east) * kx + (y - north) * ky + 7.0 * kx) for kx, ky in waves)
        Dem.on(grid, heights).write(tmp_path / name)
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("pair")
def test_displacements_and_velocities_are_written_as_points():
    done = CliRunner().invoke(
        app, ["track", "a.tif", "b.tif", "--days", "4", "--window", "21", "--search", "6", "-o", "v.gpkg"]
    )
    assert done.exit_code == 0, done.output
    found = geopandas.read_file("v.gpkg")
    assert (found.outlier == 0).all()
    np.testing.assert_allclose(found[["east_m", "north_m"]], np.tile([6.0, -2.0], (len(found), 1)), atol=0.1)
    np.testing.assert_allclose(found.east_m_per_day, found.east_m / 4.0)
    assert "median speed 1.58 m a day" in done.output


@pytest.mark.usefixtures("pair")
def test_rasters_on_different_grids_are_refused_with_one_sentence():
    Dem.read("b.tif").window((0.0, 0.0, 200.0, 200.0)).write("c.tif")
    done = CliRunner().invoke(app, ["track", "a.tif", "c.tif", "--days", "4"])
    assert done.exit_code == 3
    assert "different grids" in done.output


@pytest.mark.usefixtures("pair")
def test_speeds_in_a_stretched_projection_are_those_on_the_ground():
    for name in ("a.tif", "b.tif"):
        dem = Dem.read(name)
        # 60° N, where a metre on the ground is two of Web Mercator.
        grid = Grid((0.0, 8_400_000.0, 300.0, 8_400_300.0), 3.0, "EPSG:3857")
        Dem.on(grid, dem.elevation).write(f"mercator_{name}")
    options = ["--days", "4", "--window", "21", "--search", "6", "-o", "m.gpkg"]
    done = CliRunner().invoke(app, ["track", "mercator_a.tif", "mercator_b.tif", *options])
    assert done.exit_code == 0, done.output
    assert "median speed 0.79" in done.output
    assert "of which are one metre on the ground here" in done.output

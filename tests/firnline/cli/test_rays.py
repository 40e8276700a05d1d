"""Scans with lines of sight on the command line: bounds, pictures, no-go ground, and refusals."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from firnline.cli.main import app
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route


@pytest.fixture
def scans(tmp_path: Path) -> Path:
    """A plateau, its edge, and the ground below it farther off, as a scanner on the plateau sees them."""
    rng = np.random.default_rng(4)
    x, y = rng.uniform(-6.0, 2.0, 3000), rng.uniform(-4.0, 4.0, 3000)
    far_x, far_y = rng.uniform(4.9, 8.0, 2000), rng.uniform(-4.0, 4.0, 2000)
    near, far = np.column_stack([x, y, 0.0 * x]), np.column_stack([far_x, far_y, 0.0 * far_x - 2.0])
    points = np.concatenate([near, far])
    points[:, 2] += 0.02 * rng.standard_normal(len(points))
    folder = tmp_path / "scans"
    folder.mkdir()
    np.savez(folder / "a.npz", points=points, origin=np.array([0.0, 0.0, 1.5]))
    np.savez(tmp_path / "blind.npz", points=points)
    return folder


def run(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(
        app, ["reconstruct", *map(str, arguments), "--crs", "EPSG:32608", "--sigma", "0.02"]
    )
    return result.exit_code, result.output


@pytest.mark.pictures
def test_rays_give_bounds_pictures_and_no_go_ground(scans: Path, tmp_path: Path) -> None:
    out = tmp_path / "map"
    code, said = run(scans, "--method", "field", "--rays", "--max-slope", 25, "--grid", 0.5, "-o", out)
    assert code == 0, said
    for name in ("dem.tif", "bounds.tif", "support.tif", "mean.png", "width.png", "support.png"):
        assert (out / name).is_file()
    no_go = Dem.read(out / "no_go.tif")
    x = no_go.xy[:, 0].reshape(no_go.shape)
    # The drop of 2 m lies somewhere between 2 and 5 m, unseen; nothing else is steep.
    assert (no_go.elevation[(x > 2.0) & (x < 5.0)] == 1.0).any()
    level = (np.abs(no_go.xy[:, 1]).reshape(no_go.shape) < 3.5) & (x < 1.0) & (x > -5.0)
    assert (no_go.elevation[level] == 0.0).all()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--method", "emap", "--rays"), "uses no lines of sight"),
        (("--method", "field", "--max-slope", "20"), "add --rays to --max-slope"),
    ],
)
def test_what_makes_no_sense_is_refused(
    scans: Path, tmp_path: Path, arguments: tuple[str, ...], said: str
) -> None:
    code, output = run(scans, *arguments, "-o", tmp_path / "map")
    assert code == 3
    assert said in output


def test_rays_without_origins_are_refused(scans: Path, tmp_path: Path) -> None:
    code, output = run(tmp_path / "blind.npz", "--method", "field", "--rays", "-o", tmp_path / "map")
    assert code == 3
    assert "do not say where their sensor stood" in output
    assert not (tmp_path / "map").exists()


def test_a_plan_keeps_off_ground_that_the_bounds_show_to_be_steep(scans: Path, tmp_path: Path) -> None:
    out, route_file = tmp_path / "map", tmp_path / "route.geojson"
    code, said = run(scans, "--method", "field", "--rays", "--max-slope", 25, "--grid", 0.5, "-o", out)
    assert code == 0, said
    area = SurveyArea(shapely.box(-5.5, -3.5, 7.5, 3.5), "EPSG:32608")
    area.write(tmp_path / "site.gpkg")
    planned = CliRunner().invoke(
        app,
        [
            "plan",
            str(tmp_path / "site.gpkg"),
            "--no-go",
            str(out / "no_go.tif"),
            "--swaths",
            "3",
            "-o",
            str(route_file),
        ],
    )
    assert planned.exit_code == 0, planned.output
    no_go = Dem.read(out / "no_go.tif")
    marked = no_go.xy[no_go.elevation.ravel() == 1.0]
    for leg in Route.read(route_file).legs:
        line = shapely.LineString(leg.xy)
        assert min(line.distance(shapely.Point(xy)) for xy in marked) > 0.25

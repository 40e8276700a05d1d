"""Every command does its work on a small mission."""

import json
import shutil
import tomllib
import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import rasterio
from typer.testing import CliRunner

from firnline.cli.main import app
from survey import Dem, Grid, SurfacePoints, SurveyArea

CRS = "EPSG:32608"
MISSION = """
schema_version = 1
name = "small"
seed = 11
fidelity = "ideal"
[terrain]
source = "random"
size_m = 150.0
relief_m = 6.0
length_scale_m = 60.0
step_m = 3.0
[planner]
pattern = "lawnmower"
swaths = 3
[reconstruction]
grid_step_m = 5.0
[reconstruction.gp]
fit = false
variance_m2 = 4.0
length_scale_m = 60.0
"""


def firnline(*args: str, code: int = 0) -> str:
    result = CliRunner().invoke(app, list(args))
    assert result.exit_code == code, result.output
    return result.stdout


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> Path:
    """A finished run of the small mission."""
    folder = tmp_path_factory.mktemp("runs")
    (folder / "m.toml").write_text(MISSION)
    firnline("run", str(folder / "m.toml"), "--runs", str(folder / "runs"), "-q")
    return folder


def test_run_prints_times_rmse_class_and_report(runs):
    out = firnline("run", str(runs / "m.toml"), "--runs", str(runs / "runs"), "-q")
    lines = dict(line.split(maxsplit=1) for line in out.strip().splitlines())
    assert set(lines) == {"stages", "RMSE", "class", "map", "report"}
    assert Path(lines["report"]).is_file()
    assert "cm class, vertical, by ASPRS Edition 2" in lines["class"]


def test_a_smooth_site_with_a_perfect_sensor_meets_the_class(runs):
    content = json.loads(
        firnline("run", str(runs / "m.toml"), "--runs", str(runs / "runs"), "-q", "--json", "--require")
    )
    assert content["score"]["elevation"]["rmse_m"] < 0.4572
    assert set(content["stage_wall_s"]) == {"plan", "simulate", "localize", "reconstruct", "score", "report"}


def test_a_class_that_is_not_met_ends_with_5(runs):
    args = ["run", str(runs / "m.toml"), "--runs", str(runs / "runs"), "-q", "--set", "planner.swaths=1"]
    firnline(*args, "--set", "reconstruction.use_prior=false", "--until", "score", "--require", code=5)


def test_products_carry_their_crs(runs):
    run = runs / "runs" / "small" / "latest"
    run = runs / "runs" / "small" / run.readlink() if run.is_symlink() else run
    for name in ("1-plan/prior.tif", "2-simulate/truth/dem.tif", "4-reconstruct/dem.tif"):
        with rasterio.open(run / name) as raster:
            assert raster.crs.to_epsg() == 32608, name
    with rasterio.open(run / "4-reconstruct" / "dem.tif") as raster:
        assert raster.count == 2


def test_a_run_has_a_qgis_project_of_its_own_files(runs):
    # Another test ends a later run before its report.
    project = next((runs / "runs" / "small").glob("*/*/run.qgz")).resolve()
    with zipfile.ZipFile(project) as archive:
        root = ET.fromstring(archive.read("run.qgs"))
    groups = [group.get("name") for group in root.findall("layer-tree-group/layer-tree-group")]
    assert groups == ["Survey", "Map", "Reference", "Prior"]
    for layer in root.iter("maplayer"):
        source = layer.findtext("datasource").split("|")[0]
        assert source.startswith("../")
        assert (project.parent / source).is_file()


@pytest.mark.long
def test_a_report_for_a_paper_has_figures_as_pdf_and_states_the_field_work(runs):
    run, rates = runs / "runs" / "small", runs / "rates.toml"
    rates.write_text('currency = "EUR"\nperson_day = 500.0\n')
    said = firnline("report", str(run), "--paper", "copernicus", "--rates", str(rates), "--json")
    page = Path(json.loads(said)["report"])
    assert {file.suffix for file in (page.parent / "figures").iterdir()} == {".pdf"}
    assert "1 day, 2 person-days, 1000 EUR" in page.read_text(encoding="utf-8")
    firnline("report", str(run))


@pytest.mark.long
def test_stages_can_be_repeated_and_shown(runs):
    mission = ("run", str(runs / "m.toml"), "--runs", str(runs / "runs"), "-q")
    firnline(*mission, "--from", "score", "--until", "score")
    firnline("report", str(runs / "runs" / "small"))
    assert firnline("show", str(runs / "runs" / "small")).startswith("  done")


def test_every_stage_verb_takes_a_mission(runs, tmp_path):
    for verb, folder in (
        ("plan", "1-plan"),
        ("simulate", "2-simulate"),
        ("reconstruct", "4-reconstruct"),
        ("score", "5-score"),
    ):
        firnline(verb, str(runs / "m.toml"), "--runs", str(tmp_path), "-q")
        assert (tmp_path / "small" / "latest" / folder).is_dir()


def test_init_writes_a_mission_that_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    firnline("init", "mine.toml")
    content = tomllib.loads(Path("mine.toml").read_text())
    assert content["name"] == "mine"
    assert content["terrain"]["source"] == "random"
    firnline("plan", "mine.toml", "--runs", "runs", "-q")


def test_doctor_finds_everything_well():
    rows = json.loads(firnline("doctor", "--json"))
    assert all(row["well"] for row in rows)
    assert {"Python", "numpy", "memory", "GDAL"} <= {row["what"] for row in rows}


def test_plan_export_and_reconstruct_outside_data(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    grid = Grid((0.0, 0.0, 100.0, 100.0), 5.0, CRS)
    x, y = np.meshgrid(grid.x, grid.y)
    truth = Dem.on(grid, 10.0 + 0.05 * x + 2.0 * np.sin(y / 30.0))
    truth.write("truth.tif")
    SurveyArea.rectangle((0.0, 0.0, 100.0, 100.0), CRS).write("area.gpkg")
    firnline("plan", "area.gpkg", "--swaths", "5", "-o", "route.geojson")
    firnline("export", "route.geojson", "route.gpx")
    assert Path("route.gpx").read_text().startswith("<?xml")
    places = grid.xy[::3]
    SurfacePoints(np.column_stack([places, truth.at(places)]), sigma_m=0.02, crs=CRS).write("points.csv")
    firnline("reconstruct", "points.csv", "--crs", CRS, "--grid", "5", "-o", "map")
    content = json.loads(firnline("score", "map", "--truth", "truth.tif", "--area", "area.gpkg", "--json"))
    assert content["elevation"]["rmse_m"] < 0.05
    shutil.copy("truth.tif", "copy.tif")
    out = firnline("score", "copy.tif", "--truth", "truth.tif")
    assert "met" in out


def test_init_never_replaces_its_input_and_other_files_with_force_only(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.toml").write_text("mine")
    firnline("init", "mine.toml", code=3)
    firnline("init", "mine.toml", "--dem", "mine.toml", "--force", code=3)
    firnline("init", "missing/mine.toml", code=3)
    assert Path("mine.toml").read_text() == "mine"
    firnline("init", "mine.toml", "--force")

"""``firnline plan -o plan.pdf``: sheets, route and standard deviation, and what the command prints."""

import json
import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from typer.testing import CliRunner

from firnline.cli.main import app
from survey import Dem, Grid, Route, SurveyArea

CRS = "EPSG:32608"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    grid = Grid((525_940.0, 6_477_940.0, 526_260.0, 6_478_260.0), 20.0, CRS)
    x, y = np.meshgrid(grid.x - 526_100.0, grid.y - 6_478_100.0)
    Dem.on(grid, 40.0 * np.exp(-(x**2 + y**2) / (2.0 * 50.0**2)), "EGM2008 height").write("hill.tif")
    SurveyArea.rectangle((526_000.0, 6_478_000.0, 526_200.0, 6_478_200.0), CRS).write("site.gpkg")
    return tmp_path


def planned(*args: str, code: int = 0):
    result = CliRunner().invoke(app, ["plan", "site.gpkg", "--prior", "hill.tif", *args, "-q"])
    assert result.exit_code == code, result.output
    return result


def test_sheets_come_with_the_route_and_the_standard_deviation():
    out = planned("--spacing", "50", "-o", "plan.pdf", "--json").stdout
    facts = json.loads(out)
    assert [facts[name] for name in ("sheets", "route", "sigma")] == [
        "plan.pdf",
        "plan.geojson",
        "plan_sigma.tif",
    ]
    content = Path("plan.pdf").read_bytes()
    assert content.startswith(b"%PDF")
    assert content.count(b"/Type /Page ") == 3  # overview, prediction, one rover
    sigma = Dem.read("plan_sigma.tif")
    assert np.sqrt(np.nanmean(sigma.elevation**2)) == pytest.approx(facts["rmse_m"], rel=0.1)
    assert Route.read("plan.geojson").ground_length_m == pytest.approx(facts["length_m"])


def test_sheets_replace_others_with_force_only():
    planned("--swaths", "3", "-o", "plan.pdf")
    before = Path("plan.geojson").read_bytes()
    assert "plan.pdf exists" in planned("--swaths", "4", "-o", "plan.pdf", code=3).stderr
    Path("plan.pdf").unlink()
    assert "plan.geojson exists" in planned("--swaths", "4", "-o", "plan.pdf", code=3).stderr
    assert Path("plan.geojson").read_bytes() == before
    planned("--swaths", "4", "-o", "plan.pdf", "--force")


def test_people_read_hours_kilometres_and_kilowatt_hours():
    out = planned("--spacing", "5").stdout
    assert "40 swaths, written to route.geojson, route.png" in out
    assert "  length             8." in out
    assert " km\n" in out
    assert "  time               2 h" in out
    assert "kWh" in out
    assert "_m =" not in out


def test_a_qgis_project_comes_with_its_layers():
    facts = json.loads(planned("--spacing", "50", "-o", "plan.qgz", "--json").stdout)
    assert [facts[name] for name in ("project", "route", "area", "sigma", "terrain")] == [
        "plan.qgz",
        "plan.gpkg",
        "plan_area.gpkg",
        "plan_sigma.tif",
        "plan_terrain.tif",
    ]
    with zipfile.ZipFile("plan.qgz") as archive:
        root = ET.fromstring(archive.read(archive.namelist()[0]))
    sources = {layer.findtext("layername"): layer.findtext("datasource") for layer in root.iter("maplayer")}
    assert sources["Route"] == "./plan.gpkg|layername=route"
    assert all(Path(source.split("|")[0]).is_file() for source in sources.values())
    assert {"Survey area", "Predicted standard deviation", "Hillshade", "Elevation"} < set(sources)


def test_missing_starts_and_a_local_crs_are_refused_before_any_work(monkeypatch):
    monkeypatch.setattr("planners.terrain_kernel", lambda *_: pytest.fail("work began"))
    refused = planned("--swaths", "3", "--set", "rover.battery_j=1e6", code=3).stderr
    assert "needs one; mark a start in the area" in refused
    local = 'LOCAL_CS["site grid",UNIT["metre",1]]'
    SurveyArea.rectangle((0.0, 0.0, 200.0, 200.0), local).write("local.gpkg")
    result = CliRunner().invoke(app, ["plan", "local.gpkg", "--swaths", "3", "-o", "plan.pdf", "-q"])
    assert (result.exit_code, "is a local system" in result.stderr) == (3, True)

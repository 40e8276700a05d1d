"""A glaciologist's first day: a KML polygon, elevations in degrees, sheets for a permit, a rover's autopilot, QGIS."""

import json
import subprocess
import zipfile
from pathlib import Path

import pytest
import rasterio
from pyproj import CRS

from tests.first_day.conftest import Firnline
from tests.survey.reporting.qgis_check import layers_in_qgis, qgis_python

pytestmark = pytest.mark.walkthrough

PLAN = ("plan", "site.kml", "--prior", "degrees.tif", "--swaths", "6")


def test_elevations_and_areas_in_degrees_just_work(firnline: Firnline, here: Path) -> None:
    planned = firnline(*PLAN, "-o", "plan.pdf")
    assert "site.kml is in degrees (WGS 84); it is projected to WGS 84 / UTM zone 8N." in planned.stderr
    assert (
        "degrees.tif is in degrees (WGS 84); it is warped to WGS 84 / UTM zone 8N, cells of" in planned.stderr
    )
    assert "interpolation" in planned.stderr
    mapped = firnline(
        "reconstruct", "landmarks.csv", "--crs", "EPSG:32608", "--prior", "degrees.tif", "--grid", "20"
    )
    assert "is warped to WGS 84 / UTM zone 8N" in mapped.stderr
    firnline("init", "mine.toml", "--dem", "degrees.tif")
    assert "degrees.tif" in (here / "mine.toml").read_text()


def test_a_plan_is_sheets_with_human_units_and_the_predicted_error_as_a_map(
    firnline: Firnline, here: Path
) -> None:
    said = firnline(*PLAN, "-o", "plan.pdf").stdout.splitlines()
    assert said[0] == "6 swaths, written to plan.pdf, plan.geojson, plan_sigma.tif"
    facts = dict(line.strip().split("  ", 1) for line in said[1:])
    assert facts["length"].strip().endswith(" km")
    assert facts["time"].strip().endswith(" min")
    assert facts["energy"].strip().endswith("Wh")
    assert (here / "plan.pdf").read_bytes().startswith(b"%PDF")
    with rasterio.open(here / "plan_sigma.tif") as sigma:
        assert CRS(sigma.crs).to_epsg() == 32608
        assert sigma.width >= 60
    machine = json.loads(firnline(*PLAN, "-o", "again.pdf", "--json").stdout)
    assert machine["length_m"] > 1000.0


def test_one_command_writes_missions_with_fence_speed_and_home_for_all_rovers(
    firnline: Firnline, here: Path
) -> None:
    for_two = ("--swaths", "6", "--rovers", "2", "-o", "two.geojson")
    firnline("plan", "site.kml", "--prior", "degrees.tif", *for_two, code=3)
    features = json.loads((here / "site.geojson").read_text())
    start = {"role": "start"} | {}
    middle = [500_300.0, 6_700_300.0]
    features["features"].append(
        {"type": "Feature", "properties": start, "geometry": {"type": "Point", "coordinates": middle}}
    )
    (here / "started.geojson").write_text(json.dumps(features))
    firnline("plan", "started.geojson", "--prior", "srtm.tif", *for_two)
    options = ("--area", "started.geojson", "--dem", "srtm.tif", "--speed", "1.2", "--return")
    done = firnline("export", "two.geojson", "two.plan", "--autopilot", "ardupilot", *options)
    assert done.stdout == "two_rover1.plan, two_rover2.plan written\n"
    mission = json.loads((here / "two_rover1.plan").read_text())
    assert mission["geoFence"]["polygons"]
    assert mission["mission"]["plannedHomePosition"][2] > 500.0
    firnline("export", "two.geojson", "two.gpx", "--dem", "srtm.tif")
    assert "<ele>" in (here / "two.gpx").read_text()
    firnline("export", "two.geojson", "two.kmz", "--area", "started.geojson")
    with zipfile.ZipFile(here / "two.kmz") as archive:
        assert "<Folder>" in archive.read("doc.kml").decode()
    firnline("export", "two_rover1.plan", "back.gpkg")


def test_qgis_opens_every_layer_of_a_plan_and_of_a_run(firnline: Firnline, here: Path) -> None:
    python = qgis_python()
    if python is None:
        pytest.skip("QGIS with its Python interface is not installed (Debian: python3-qgis)")
    firnline(*PLAN, "-o", "plan.qgz")
    crs, layers = layers_in_qgis(python, here / "plan.qgz")
    assert crs == "EPSG:32608"
    assert {name: kind for name, (_, kind) in layers.items()} == {
        "Route": "categorizedSymbol",
        "Survey area": "categorizedSymbol",
        "Predicted standard deviation": "singlebandpseudocolor",
        "Hillshade": "hillshade",
        "Elevation": "singlebandpseudocolor",
    }
    assert all(is_valid for is_valid, _ in layers.values())
    run = small_run(firnline, here)
    crs, layers = layers_in_qgis(python, run / "6-report" / "run.qgz")
    assert all(is_valid for is_valid, _ in layers.values())
    kinds = {name: kind for name, (_, kind) in layers.items()}
    assert kinds["Support"] == "paletted"
    assert kinds["Standard deviation"] == "singlebandpseudocolor"
    assert kinds["Driven route"] == "categorizedSymbol"
    assert kinds["Surface points"] == "singleSymbol"


def small_run(firnline: Firnline, here: Path) -> Path:
    """Run a small mission and return its folder."""
    from benchmarks.small_inputs import IDEAL_MISSION

    (here / "small.toml").write_text(IDEAL_MISSION)
    done: subprocess.CompletedProcess[str] = firnline("run", "small.toml", "--json", "-q")
    return here / json.loads(done.stdout)["run"]


def test_a_guarantee_states_what_it_rests_on_and_obeys_the_most_swaths(firnline: Firnline) -> None:
    wanted = ("plan", "site.geojson", "--prior", "srtm.tif", "--require", "0.8", "--probability", "0.9")
    made = firnline(*wanted, "-o", "g.geojson").stdout
    assert "is guaranteed with" in made
    assert "  assumed " in made
    wanted = ("plan", "site.geojson", "--prior", "srtm.tif", "--require", "0.1", "--max-swaths", "2")
    assert "by up to 2 swaths" in firnline(*wanted, "-o", "h.geojson", code=5).stderr

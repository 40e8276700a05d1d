"""``firnline export`` of routes: missions of autopilots with fence, speed, home and return; GPX, KML and KMZ."""

import json
import re
import zipfile
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
from pymavlink import mavwp
from pyproj import Transformer
from typer.testing import CliRunner

from firnline.cli.main import app
from survey import Dem, Grid, Route, SurveyArea
from survey.core.run_folder import RunFolder
from survey.data.route import Leg
from survey.interchange.route_formats import read_plan

CRS = "EPSG:32608"
ORIGIN = np.array([526_000.0, 6_478_000.0])
NO_GO = shapely.box(526_080.0, 6_478_040.0, 526_120.0, 6_478_060.0)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    corner = ORIGIN.tolist()
    area = shapely.box(*corner, corner[0] + 200.0, corner[1] + 100.0)
    SurveyArea(area, CRS, (NO_GO,)).write("site.gpkg")
    grid = Grid((525_900.0, 6_477_900.0, 526_300.0, 6_478_200.0), 20.0, CRS)
    Dem.on(grid, 500.0 + 0.1 * (grid.xy[:, 0] - 526_000.0).reshape(grid.shape), "EGM2008 height").write(
        "dem.tif"
    )
    swaths = [[[0.0, 10.0], [200.0, 10.0]], [[200.0, 30.0], [0.0, 30.0]]]
    legs = []
    for rover, north in enumerate((0.0, 60.0)):
        first, second = (np.array(line) + ORIGIN + [0.0, north] for line in swaths)
        legs += [
            Leg("swath", first, rover),
            Leg("transit", [first[1], second[0]], rover),
            Leg("swath", second, rover),
        ]
    Route(tuple(legs), CRS, "lawnmower", 20.0, {"time_s": 430.0}).write("two.geojson")
    Route(tuple(legs[:3]), CRS, "lawnmower", 20.0, {"time_s": 430.0}).write("one.geojson")
    return tmp_path


def run(*args: str, code: int = 0):
    result = CliRunner().invoke(app, ["export", *args])
    assert result.exit_code == code, result.output
    return result


def metres(latlon: list[list[float]]) -> np.ndarray:
    lat, lon = np.array(latlon).T
    return np.column_stack(Transformer.from_crs(4326, CRS, always_xy=True).transform(lon, lat))


@pytest.mark.parametrize(("autopilot", "firmware"), [("ardupilot", 3), ("px4", 12)])
def test_one_command_writes_a_complete_mission_for_every_rover(autopilot, firmware):
    args = (
        f"two.geojson survey.plan --autopilot {autopilot} --area site.gpkg --dem dem.tif --speed 1.2 --return"
    )
    assert run(*args.split()).stdout == "survey_rover1.plan, survey_rover2.plan written\n"
    for rover in (0, 1):
        plan = json.loads(Path(f"survey_rover{rover + 1}.plan").read_text())
        mission, items = plan["mission"], plan["mission"]["items"]
        assert (mission["firmwareType"], mission["vehicleType"], mission["cruiseSpeed"]) == (
            firmware,
            10,
            1.2,
        )
        assert [item["command"] for item in items] == [178, 16, 16, 16, 16, 20]
        assert items[0]["params"] == [1, 1.2, -1, 0, 0, 0, 0]
        assert [item["doJumpId"] for item in items] == [1, 2, 3, 4, 5, 6]
        latitude, longitude, height = mission["plannedHomePosition"]
        start = ORIGIN + [0.0, 10.0 + 60.0 * rover]
        np.testing.assert_allclose(metres([[latitude, longitude]])[0], start, atol=1e-3)
        assert height == pytest.approx(500.0, abs=0.01)
        # 200 m to the east the ground is 20 m higher than home.
        assert [item["Altitude"] for item in items[1:5]] == pytest.approx([0.0, 20.0, 20.0, 0.0], abs=0.01)
        fences = plan["geoFence"]["polygons"]
        assert [fence["inclusion"] for fence in fences] == [True, False]
        outline = shapely.Polygon(metres(fences[0]["polygon"]))
        assert outline.bounds == pytest.approx((525_990.0, 6_477_990.0, 526_210.0, 6_478_110.0), abs=0.01)
        assert shapely.Polygon(metres(fences[1]["polygon"])).symmetric_difference(NO_GO).area < 0.1


def test_a_plain_text_mission_has_home_speed_and_return():
    run(
        *[
            "one.geojson",
            "survey.waypoints",
            "--autopilot",
            "ardupilot",
            "--dem",
            "dem.tif",
            "--speed",
            "0.8",
            "--return",
        ]
    )
    loader = mavwp.MAVWPLoader()
    assert loader.load("survey.waypoints") == 7
    assert [loader.wp(i).command for i in range(7)] == [16, 178, 16, 16, 16, 16, 20]
    assert loader.wp(0).z == pytest.approx(500.0, abs=0.01)
    assert loader.wp(1).param2 == pytest.approx(0.8)


def test_missions_that_cannot_be_driven_are_refused():
    assert "ardupilot or px4" in run("one.geojson", "a.plan", "--autopilot", "dji", code=4).stderr
    assert "the speed is 0 m/s" in run("one.geojson", "a.plan", "--speed", "0", code=3).stderr
    SurveyArea.rectangle((526_000.0, 6_478_000.0, 526_100.0, 6_478_100.0), CRS).write("half.gpkg")
    assert "outside the area" in run("one.geojson", "a.plan", "--area", "half.gpkg", code=3).stderr
    block = shapely.box(525_999.0, 6_478_015.0, 526_010.0, 6_478_025.0)
    SurveyArea(shapely.box(525_990.0, 6_477_990.0, 526_210.0, 6_478_110.0), CRS, (block,)).write("cut.gpkg")
    error = run("one.geojson", "a.plan", "--area", "cut.gpkg", "--return", code=3).stderr
    assert "crosses no-go ground" in error
    assert not Path("a.plan").exists()
    assert "goes with routes" in run("dem.tif", "b.asc", "--speed", "1", code=4).stderr


def test_missions_of_all_rovers_replace_none_without_force():
    Path("survey_rover2.plan").write_text("mine")
    assert "survey_rover2.plan exists" in run("two.geojson", "survey.plan", code=3).stderr
    assert not Path("survey_rover1.plan").exists()


def test_gpx_and_geojson_have_the_heights_of_the_terrain():
    run("two.geojson", "out.gpx", "--dem", "dem.tif")
    heights = [float(text) for text in re.findall("<ele>([^<]*)</ele>", Path("out.gpx").read_text())]
    assert heights == pytest.approx([500.0, 520.0, 520.0, 500.0] * 2, abs=0.01)
    run("two.geojson", "out.geojson", "--dem", "dem.tif")
    content = json.loads(Path("out.geojson").read_text())
    assert "crs" not in content  # RFC 7946
    longitude, latitude, height = content["features"][0]["geometry"]["coordinates"][0]
    assert (round(longitude), round(latitude), height) == (-135, 58, 500.0)


@pytest.mark.parametrize("ending", ["kml", "kmz"])
def test_kml_has_folders_styles_and_labels(ending):
    run("two.geojson", f"out.{ending}", "--area", "site.gpkg", "--dem", "dem.tif")
    if ending == "kmz":
        with zipfile.ZipFile("out.kmz") as archive:
            assert archive.namelist() == ["doc.kml"]
            archive.extractall()
        Path("doc.kml").rename("out.kml")
    layers = [str(name) for name, _ in pyogrio.list_layers("out.kml")]
    assert layers == ["Rover 1", "Rover 2", "Rover 1, labels", "Rover 2, labels", "Survey area", "No-go"]
    text = Path("out.kml").read_text()
    assert text.count("<Style id=") == 8
    assert "<styleUrl>#swath-1</styleUrl>" in text
    assert "<name>Start, rover 2</name>" in text
    back = read_plan("out.kml", CRS)
    np.testing.assert_allclose(back.path(1), Route.read("two.geojson").path(1), atol=1e-3)
    assert [leg.kind for leg in back.legs] == ["swath", "transit", "swath"] * 2


@pytest.mark.parametrize("has_void", [False, True])
def test_a_run_brings_its_area_and_its_prior_where_that_has_no_voids(has_void):
    facts = {"mission": "m", "seed": 1, "python": "3.11", "versions": {}}
    run_folder = RunFolder.open(Path("runs"), "m", "a = 1\n", {}, facts)
    dem = Dem.read("dem.tif")
    heights = np.where((dem.xy[:, 0] > 526_150.0).reshape(dem.shape) & has_void, np.nan, dem.elevation)
    with run_folder.stage("plan") as stage:
        Route.read("one.geojson").write(stage / "route.geojson")
        SurveyArea.read("site.gpkg").write(stage / "area.gpkg")
        Dem(heights, dem.transform, dem.crs, dem.vertical_datum).write(stage / "prior.tif")
    said = run(str(run_folder.path), "survey.plan").stderr
    assert ("has voids on the route; heights are left out" in said) == has_void
    plan = json.loads(Path("survey.plan").read_text())
    assert len(plan["geoFence"]["polygons"]) == 2
    assert (plan["mission"]["plannedHomePosition"][2] == 0) == has_void

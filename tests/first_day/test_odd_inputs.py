"""Files that were read wrongly once: each is right, or refused in one sentence. ``FIRNLINE_DATA`` holds them."""

import json
import logging
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner, Result

from firnline.cli.main import app
from survey import Dem, Route, SurveyArea

ODD = Path(os.environ.get("FIRNLINE_DATA", Path(__file__).parents[3] / "shared" / "data")) / "odd_inputs"
REFUSED = 3
LOCALIZE = ("-o", "out", "--force", "-q")
MAP = ("--grid", "5", "--no-pictures", "-o", "out", "--force", "-q")

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not ODD.is_dir(), reason="the real data are not here (FIRNLINE_DATA)"),
]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(shutil.copytree(ODD, tmp_path / "odd", copy_function=shutil.copyfile))
    return Path()


def run(*args: Any) -> Result:
    return CliRunner().invoke(app, [str(word) for word in args])


def words_of(result: Result, caplog: pytest.LogCaptureFixture) -> str:
    return result.output + caplog.text


def planned(area: str, n_swaths: int) -> Route:
    result = run("plan", area, "--swaths", n_swaths, "-o", "route.geojson", "--force", "-q")
    assert result.exit_code == 0, result.output
    return Route.read("route.geojson")


def test_all_holes_of_google_earth_are_holes() -> None:
    areas = [SurveyArea.read(name) for name in ("google_earth.kml", "standard.kml")]
    assert [len(area.polygon.interiors) for area in areas] == [3, 3]
    driven = shapely.MultiLineString([leg.xy for leg in planned("google_earth.kml", 6).legs])
    assert areas[0].free.buffer(0.5).covers(driven)


@pytest.mark.parametrize("name", ["wound.shp", "nested.geojson"])
def test_a_part_inside_another_is_refused(name: str) -> None:
    result = run("plan", name, "--swaths", 5, "-o", "route.geojson")
    assert result.exit_code == REFUSED
    assert "a part inside another part" in result.output


@pytest.mark.parametrize("name", ["spline.waypoints", "loiter.waypoints"])
def test_splines_and_loiters_keep_their_places(name: str) -> None:
    assert run("export", name, "route.geojson").exit_code == 0
    rows = [line.split("\t") for line in Path(name).read_text().splitlines()[2:]]
    stated = [(float(row[9]), float(row[8])) for row in rows if float(row[8])]
    features = json.loads(Path("route.geojson").read_text())["features"]
    lines = [feature["geometry"]["coordinates"] for feature in features]
    kept = [lines[0][0], *(place for line in lines for place in line[1:])]
    np.testing.assert_allclose(np.array(kept)[:, :2], stated, atol=1e-6)


@pytest.mark.parametrize(
    ("args", "sentence"),
    [
        (("export", "zero.waypoints", "out.geojson"), "item 1 (NAV_TAKEOFF, command 22)"),
        (("export", "4-m.plan", "out.geojson"), "nested deeper"),
        (("plan", "fault.fgb", "--swaths", 4, "-o", "out.geojson"), "is damaged"),
        (("plan", "g.geojson", "--prior", "self.vrt", "--swaths", 4, "-o", "out.geojson"), "names self.vrt as a source"),
        (("localize", "6-b.bag", *LOCALIZE), "is damaged"),
    ],
)  # fmt: skip
def test_damaged_files_are_refused(args: tuple[Any, ...], sentence: str) -> None:
    result = run(*args)
    assert result.exit_code == REFUSED
    assert sentence in result.output


def test_an_exported_mission_lies_outside_its_own_exclusions() -> None:
    planned("island.geojson", 8)
    assert run("export", "route.geojson", "mission.plan", "--area", "island.geojson").exit_code == 0
    plan = json.loads(Path("mission.plan").read_text())
    places = [item["params"][4:6] for item in plan["mission"]["items"] if item["command"] == 16]
    line = shapely.LineString(places)
    fences = plan["geoFence"]["polygons"]
    assert {fence["inclusion"] for fence in fences} == {True, False}
    for fence in fences:
        slack_deg = 1e-7 if fence["inclusion"] else -1e-7
        inside = shapely.Polygon(fence["polygon"]).buffer(slack_deg).intersection(line).length / line.length
        assert inside == pytest.approx(1.0 if fence["inclusion"] else 0.0, abs=1e-6)


@pytest.mark.parametrize(("autopilot", "most"), [("ardupilot", 70), ("px4", 64)])
def test_a_fence_has_no_more_corners_than_the_autopilot_holds(autopilot: str, most: int) -> None:
    planned("star.geojson", 5)
    args = ("--area", "star.geojson", "--autopilot", autopilot)
    assert run("export", "route.geojson", "mission.plan", *args).exit_code == 0
    fences = json.loads(Path("mission.plan").read_text())["geoFence"]["polygons"]
    assert fences
    assert sum(len(fence["polygon"]) for fence in fences) <= most


@pytest.mark.parametrize(
    "names",
    [("feet_vertical_units.las",), ("navd88_feet.las",), ("metres.las", "navd88_feet.las", "--tiles")],
)
def test_heights_in_feet_are_converted_and_said(
    names: tuple[str, ...], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    sigma = () if "--tiles" in names else ("--sigma", "0.05")
    result = run("reconstruct", *names, *sigma, *MAP)
    assert result.exit_code == 0, result.output
    assert "US survey feet" in words_of(result, caplog)
    heights = Dem.read(f"out/dem.{'vrt' if '--tiles' in names else 'tif'}").elevation
    assert 300.0 < np.nanmin(heights) < np.nanmax(heights) < 335.0


def test_rasters_that_name_no_geoid_are_compared_with_a_note() -> None:
    result = run("change", "proj_egm96.tif", "proj_egm08.tif", "--outline", "g.geojson", "-o", "out")
    assert result.exit_code == 0
    assert "does not state its vertical datum" in result.output


@pytest.mark.parametrize("method", ["gp", "tin"])
@pytest.mark.parametrize(("name", "sigma"), [("conflict.csv", ("--sigma", "0.05")), ("tiny_sigma.csv", ())])
def test_heights_that_contradict_are_named(name: str, sigma: tuple[str, ...], method: str) -> None:
    result = run("reconstruct", name, *sigma, "--crs", "EPSG:32632", "--method", method, *MAP)
    assert result.exit_code == 0, result.output
    assert "hold heights that contradict one another: the first, at" in result.output
    assert "not below the scatter" in result.output


def test_photographs_that_are_no_fixes_are_counted(caplog: pytest.LogCaptureFixture) -> None:
    result = run("localize", "noref", *LOCALIZE)
    assert "4 images, the first IMG_0000.jpg, state no hemisphere" in words_of(result, caplog)
    result = run("localize", "some_zero", "--set", "localization.landmark_max_sigma_m=500", *LOCALIZE)
    assert "2 fixes at a height of 0 m" in words_of(result, caplog)


@pytest.mark.parametrize("name", ["t_edge.geojson", "rounded_edge.geojson"])
def test_neighbours_that_touch_are_one_area(name: str) -> None:
    assert planned(name, 5).prediction["left_out_share"] == pytest.approx(0.0, abs=1e-3)


def test_a_calibration_of_half_the_size_is_noted(caplog: pytest.LogCaptureFixture) -> None:
    result = run("localize", "noref", "--camera", "half.yaml", *LOCALIZE)
    assert "half" in words_of(result, caplog)

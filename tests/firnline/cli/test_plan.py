"""``firnline plan`` on areas: routes, pictures, limits, and what it refuses in one sentence."""

import json
import re
from pathlib import Path

import numpy as np
import pyproj
import pytest
import shapely
from pyogrio.raw import write
from typer.testing import CliRunner

import planners
from firnline.cli.main import app
from planners.registry import pattern_names
from survey import Dem, Grid, Route, SurveyArea
from survey.core.transformation import transformed

CRS = "EPSG:32608"
SITE = shapely.box(526_000.0, 6_478_000.0, 526_200.0, 6_478_200.0)


@pytest.fixture(autouse=True)
def room(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    grid = Grid((525_940.0, 6_477_940.0, 526_260.0, 6_478_260.0), 20.0, CRS)
    x, y = np.meshgrid(grid.x - 526_100.0, grid.y - 6_478_100.0)
    Dem.on(grid, 40.0 * np.exp(-(x**2 + y**2) / (2.0 * 50.0**2))).write("hill.tif")
    SurveyArea(SITE, CRS, starts=[[526_005.0, 6_478_005.0]]).write("site.gpkg")
    return tmp_path


def planned(*args: str, code: int = 0) -> tuple[str, str]:
    result = CliRunner().invoke(app, ["plan", *args, "-q"])
    assert result.exit_code == code, result.output
    return result.stdout, result.stderr


def drawn(shape: shapely.Geometry, crs: str | None = CRS) -> str:
    """Write one feature as a GIS would."""
    write("drawn.gpkg", np.array([shapely.to_wkb(shape)], dtype=object), [np.array([1])], ["id"], crs=crs,
          geometry_type=shape.geom_type, driver="GPKG")  # fmt: skip
    return "drawn.gpkg"


def test_a_plan_comes_with_its_picture_and_what_is_expected():
    out, _ = planned("site.gpkg", "--prior", "hill.tif", "--spacing", "25", "--json")
    content = json.loads(out)
    assert {"length_m", "n_turns", "time_s", "energy_j", "rmse_m", "left_out_share"} <= set(content)
    assert Route.read(content["route"]).ground_length_m == pytest.approx(content["length_m"])
    assert Path(content["picture"]).read_bytes().startswith(b"\x89PNG")


def test_slopes_are_read_at_the_noise_of_the_product_and_the_plan_says_so(caplog: pytest.LogCaptureFixture):
    grid = Grid((525_810.0, 6_477_810.0, 526_390.0, 6_478_390.0), 20.0, CRS)
    noise = 4.0 * np.random.default_rng(5).standard_normal(grid.shape)
    Dem.on(grid, 0.05 * (grid.y[:, None] - 6_478_000.0) + noise).write("noisy.tif")
    steep = ("site.gpkg", "--prior", "noisy.tif", "--swaths", "3", "--max-slope", "10", "--json")
    out, _ = planned(*steep, "--product", "aster-30")
    content = json.loads(out)
    assert content["left_out_share"] == 0.0
    assert "by planes of ± 40 m about each cell" in content["notes"][0]
    assert "aster-30 tilt the ground by" in content["notes"][0]


def test_gaps_that_were_closed_stand_in_the_record_of_the_plan(caplog: pytest.LogCaptureFixture):
    west, east = (shapely.affinity.translate(shapely.box(0, 0, 99.99, 200), x, 0) for x in (0.0, 100.0))
    both = shapely.affinity.translate(shapely.MultiPolygon([west, east]), *SITE.bounds[:2])
    out, _ = planned(drawn(both), "--spacing", "25", "--json")
    (note,) = json.loads(out)["notes"]
    assert "the gaps of 2 m² between them are closed" in note
    assert note in caplog.text
    assert json.loads(planned("site.gpkg", "--spacing", "25", "--json", "--force")[0])["notes"] == []


def test_a_predicted_error_says_what_it_excludes():
    out, _ = planned("site.gpkg", "--prior", "hill.tif", "--spacing", "25")
    assert "predicted RMSE" in out
    assert re.search(r"predicted RMSE +\d\.\d\d m \(\d\.\d\d to \d\.\d\d m with 80 %\)", out)
    assert "RMSE excludes      errors of position that grow along the path" in out
    assert "RMSE excludes" not in planned("site.gpkg", "--spacing", "25", "--force")[0]


def test_limits_rovers_and_settings_reach_the_plan():
    args = ("site.gpkg", "--prior", "hill.tif", "--spacing", "25", "--max-slope", "20", "--rovers", "2")
    out, _ = planned(
        *args, "--set", "rover.speed_m_s=2.0", "--set", "fleet.separation_m=5.0", "-o", "two.geojson"
    )
    route = Route.read("two.geojson")
    assert route.n_rovers == 2
    slopes = Dem.read("hill.tif").slope()
    places = np.vstack([route.sample(2.0, rover).xy for rover in range(2)])
    assert slopes.at(places).max() <= 20.0
    assert route.prediction["left_out_share"] > 0.05
    assert "rover 2 departs after" in out


def test_a_prior_too_coarse_to_predict_from_still_plans():
    grid = Grid((525_900.0, 6_477_900.0, 526_300.0, 6_478_300.0), 400.0, CRS)
    Dem.on(grid, np.add.outer(grid.x, grid.y) * 1e-4).write("coarse.tif")
    SurveyArea(SITE.buffer(-40.0), CRS).write("small.gpkg")
    out, err = planned("small.gpkg", "--prior", "coarse.tif", "--swaths", "3")
    assert "no error is predicted: the prior has 4 known cells" in err
    assert "rmse_m" not in out


@pytest.mark.parametrize(
    ("shape", "crs", "message"),
    [
        (shapely.Polygon([(0, 0), (100, 100), (100, 0), (0, 100)]), CRS, "Self-intersection"),
        (shapely.Polygon(), CRS, "feature 1 is an empty polygon"),
        (shapely.LineString([(0, 0), (100, 0), (100, 100)]), CRS, "a LineString; a polygon was expected"),
        (shapely.Polygon(shapely.box(0, 0, 90, 90).exterior, [shapely.box(200, 0, 210, 10).exterior]), CRS, "outside shell"),
        (shapely.box(-134.5, 89.9, -134.4, 90.5), "EPSG:4326", "not on Earth"),
    ],
    ids=["self-crossing", "empty", "line", "hole outside", "beyond the pole"],
)  # fmt: skip
def test_areas_that_are_none_are_refused_in_one_sentence(shape, crs, message):
    _, err = planned(drawn(shape, crs), "--swaths", "3", code=3)
    assert message in err
    assert err.startswith("firnline: ")
    assert err.count("\n") == 1
    assert not Path("route.geojson").exists()


def test_an_area_in_degrees_is_planned_in_the_crs_that_is_named():
    lonlat = drawn(shapely.box(-134.560, 58.440, -134.555, 58.443), "EPSG:4326")
    planned(lonlat, "--swaths", "3", "--crs", CRS)
    assert 1000.0 < Route.read("route.geojson").length_m < 2000.0


@pytest.mark.parametrize("file", ["a.geojson", "a.kml", "a.shp", "a.gpkg"])
def test_areas_of_every_format_give_the_same_plan(file):
    lonlat = shapely.box(-134.560, 58.440, -134.555, 58.443) - shapely.box(-134.558, 58.441, -134.557, 58.442)
    driver = {"geojson": "GeoJSON", "kml": "KML", "shp": "ESRI Shapefile", "gpkg": "GPKG"}[file.split(".")[1]]
    write(file, np.array([shapely.to_wkb(lonlat)], dtype=object), [np.array(["x"], dtype=object)], ["Name"],
          crs="EPSG:4326", geometry_type="Polygon", driver=driver)  # fmt: skip
    planned(file, "--spacing", "40", "--crs", CRS)
    metres = shapely.transform(
        lonlat, lambda xy: transformed(xy, pyproj.CRS("EPSG:4326"), pyproj.CRS(CRS), file)
    )
    drawn_by_hand = planners.plan(SurveyArea(metres, CRS), None, planners.LawnmowerConfig(spacing_m=40.0))
    # Formats that keep nine decimals of a degree keep a tenth of a millimetre.
    assert Route.read("route.geojson").length_m == pytest.approx(drawn_by_hand.length_m, abs=0.1)


def test_an_area_smaller_than_the_spacing_gets_one_swath_through_its_middle():
    planned("site.gpkg", "--spacing", "500", "--set", "planner.heading_deg=0.0")
    route = Route.read("route.geojson")
    assert [swath.xy[:, 1].tolist() for swath in route.swaths] == [[6_478_100.0] * 2]


def test_a_start_in_a_no_go_zone_is_refused():
    shapes = [
        SITE,
        shapely.box(526_000.0, 6_478_000.0, 526_050.0, 6_478_050.0),
        shapely.Point(526_020.0, 6_478_020.0),
    ]
    roles = np.array(["area", "no-go", "start"], dtype=object)
    write("zone.gpkg", np.array([shapely.to_wkb(s) for s in shapes], dtype=object), [roles], ["role"], crs=CRS,
          geometry_type="Unknown", driver="GPKG")  # fmt: skip
    _, err = planned("zone.gpkg", "--swaths", "3", code=3)
    assert "the start (526020.0, 6478020.0) is outside the area or in a no-go zone; move it" in err


def outline_of(n_corners: int, tooth_m: float) -> str:
    """Draw a circle of 500 m whose corners lie in and out by a tooth in turn."""
    angle = np.linspace(0.0, 2.0 * np.pi, n_corners, endpoint=False)
    radius_m = 500.0 - tooth_m * (np.arange(n_corners) % 2)
    corners = np.column_stack([np.cos(angle), np.sin(angle)]) * radius_m[:, None]
    return drawn(shapely.Polygon(corners + [526_000.0, 6_478_000.0]))


@pytest.mark.long
def test_a_smooth_outline_of_a_million_corners_is_simplified(caplog):
    planned(outline_of(1_000_000, 0.0), "--swaths", "3")
    assert "1000001 corners; it is simplified to" in caplog.text


@pytest.mark.long
def test_an_outline_that_stays_of_too_many_corners_is_refused_with_the_remedy():
    _, err = planned(outline_of(60_000, 3.0), "--swaths", "3", code=3)
    assert "corners; at most 50000 can be planned on" in err
    assert "simplify the outline" in err


@pytest.mark.parametrize(
    ("args", "code", "message"),
    [
        (("--spacing", "0"), 4, "spacing_m"),
        (("--swaths", "3", "--set", "rover.max_pich_deg=20.0"), 4, "did you mean max_pitch_deg?"),
        (("--swaths", "3", "--max-slope", "20"), 3, "need heights; give a prior DEM"),
        (("--swaths", "3", "--max-slope", "95"), 4, "max_pitch_deg"),
        (("--swaths", "3", "--product", "aster-30"), 4, "goes with a limit of slope"),
        (("--swaths", "3", "--max-slope", "20", "--product", "aster"), 4, "copernicus-30, srtm-90, aster-30"),
        (("--pattern", "wavy", "--swaths", "3"), 3, "give a prior DEM"),
        (
            ("--swaths", "3", "--set", "fleet.end_m=[1.0, 2.0]"),
            3,
            "the point (1.0, 2.0) is outside the free ground",
        ),
        (("--swaths", "3", "--set", "rover.battery_j=10.0"), 3, "the battery holds"),
    ],
)
def test_options_that_cannot_be_are_refused_in_one_sentence(args, code, message):
    _, err = planned("site.gpkg", *args, code=code)
    assert message in err
    assert err.count("\n") == 1


def test_a_mission_plans_for_its_rover_and_simulates_one_only():
    Path("m.toml").write_text(
        'schema_version = 1\nname = "m"\nfidelity = "ideal"\n[terrain]\nsource = "dem"\nfile = "hill.tif"\n'
        "[satellite]\ncell_m = 20.0\nsigma_m = 0.0\n[area]\nbounds_m = [526000.0, 6478000.0, 526200.0, 6478200.0]\n"
        '[planner]\npattern = "lawnmower"\nspacing_m = 40.0\n[rover]\nmax_pitch_deg = 15.0\n'
    )
    _, err = planned("m.toml", "--runs", "runs", "--max-slope", "20", code=4)
    assert "change it with --set" in err
    _, err = planned("m.toml", "--runs", "runs")
    assert "of the area is left out" in err
    route = Route.read("runs/m/latest/1-plan/route.geojson")
    assert route.prediction["left_out_share"] > 0.02
    result = CliRunner().invoke(app, ["run", "m.toml", "--runs", "runs", "-q", "--set", "fleet.rovers=2"])
    assert result.exit_code == 3
    assert "0 starts for 2 rovers" in result.stderr


def test_a_route_or_a_picture_that_exists_is_replaced_with_force_only():
    planned("site.gpkg", "--swaths", "3")
    before = Path("route.geojson").read_bytes()
    _, err = planned("site.gpkg", "--swaths", "4", code=3)
    assert "route.geojson exists" in err
    assert "--force" in err
    assert Path("route.geojson").read_bytes() == before
    planned("site.gpkg", "--swaths", "4", "--force")
    assert len(Route.read("route.geojson").swaths) == 4


def test_an_unrelated_picture_beside_the_route_is_not_overwritten():
    Path("survey.png").write_bytes(b"a photograph")
    _, err = planned("site.gpkg", "--swaths", "3", "-o", "survey.geojson", code=3)
    assert "survey.png exists" in err
    assert Path("survey.png").read_bytes() == b"a photograph"
    assert not Path("survey.geojson").exists()


@pytest.mark.parametrize("out", ["site.gpkg", "./site.gpkg"])
def test_an_input_is_never_an_output(out):
    before = Path("site.gpkg").read_bytes()
    _, err = planned("site.gpkg", "--swaths", "3", "-o", out, "--force", code=3)
    assert "the input" in err
    assert Path("site.gpkg").read_bytes() == before


def test_a_failing_picture_leaves_the_old_route_and_picture(monkeypatch):
    planned("site.gpkg", "--swaths", "3")
    before = {name: Path(name).read_bytes() for name in ("route.geojson", "route.png")}

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("survey.figures.picture_bytes", full)
    CliRunner().invoke(app, ["plan", "site.gpkg", "--swaths", "4", "--force", "-q"])
    assert {name: Path(name).read_bytes() for name in before} == before


@pytest.mark.parametrize("kind", ["pdf", "svg"])
def test_the_picture_is_drawn_in_the_chosen_format(kind):
    out, _ = planned("site.gpkg", "--swaths", "3", "--pictures", kind)
    assert f"route.{kind}" in out
    assert Path(f"route.{kind}").read_bytes()[:5] in (b"%PDF-", b"<?xml")
    assert not Path("route.png").exists()


def test_rates_give_person_days_and_cost():
    Path("rates.toml").write_text('currency = "EUR"\nperson_day = 500.0\npeople = 3\nfixed = 100.0\n')
    out, _ = planned("site.gpkg", "--swaths", "3", "--rates", "rates.toml", "--no-pictures")
    assert "field work         1 day, 3 person-days, 1600 EUR" in out
    planned("site.gpkg", "--swaths", "3", "--rates", "rates.toml", "-o", "sheets.pdf")
    Path("rates.toml").write_text('currency = "EUR"\nday = 500.0\n')
    _, err = planned("site.gpkg", "--swaths", "3", "--rates", "rates.toml", "-o", "b.geojson", code=4)
    assert "rates.toml" in err


def test_formats_that_hold_no_route_are_refused_before_planning():
    _, err = planned("site.gpkg", "--swaths", "3", "-o", "route.png", code=3)
    assert "one of .geojson, .gpkg, .pdf, .qgz was expected" in err


def test_lines_cut_by_a_bay_are_counted_apart_from_their_pieces():
    bay = SITE - shapely.box(526_080.0, 6_478_050.0, 526_120.0, 6_478_201.0)
    out, _ = planned(drawn(bay), "--swaths", "4", "--set", "planner.heading_deg=0.0")
    assert out.startswith("4 lines in 7 pieces, ")
    out, _ = planned(drawn(bay), "--swaths", "4", "--set", "planner.heading_deg=0.0", "--json", "--force")
    assert {"lines": 4, "swaths": 7}.items() <= json.loads(out).items()


def test_a_prior_elsewhere_is_refused_and_a_part_is_said():
    grid = Grid((527_000.0, 6_478_000.0, 527_200.0, 6_478_200.0), 20.0, CRS)
    Dem.on(grid, np.zeros(grid.shape)).write("elsewhere.tif")
    _, err = planned("site.gpkg", "--prior", "elsewhere.tif", "--swaths", "3", code=3)
    assert err.count("\n") == 1
    grid = Grid((525_940.0, 6_477_940.0, 526_060.0, 6_478_260.0), 20.0, CRS)
    Dem.on(grid, np.add.outer(np.sin(grid.y / 40.0), np.cos(grid.x / 30.0))).write("part.tif")
    out, _ = planned("site.gpkg", "--prior", "part.tif", "--swaths", "3", "--json")
    assert json.loads(out)["prior_covered_share"] == pytest.approx(0.35, abs=0.02)


def test_the_map_scale_is_stated():
    out, _ = planned("site.gpkg", "--swaths", "3", "--json")
    assert json.loads(out)["map_scale"] == pytest.approx(0.9996, abs=2e-4)


def test_a_million_swaths_are_refused_with_the_most_that_can_be_planned():
    _, err = planned("site.gpkg", "--swaths", "1000000", code=3)
    assert "at most 8000 can be planned" in err
    _, err = planned("site.gpkg", "--spacing", "0.001", code=3)
    assert "widen the spacing" in err


def test_an_unknown_pattern_lists_those_of_the_registry():
    _, err = planned("site.gpkg", "--pattern", "spiral", "--swaths", "3", code=4)
    for name in pattern_names():
        assert name in err


@pytest.mark.parametrize("option", [("--joint",), ("--adaptive",), ("--assume", "whittle")])
def test_options_of_a_guarantee_need_a_requirement(option):
    _, err = planned("site.gpkg", *option, code=4)
    assert "goes with --require" in err


def test_a_pattern_without_a_number_of_swaths_gets_none_by_default():
    _, err = planned("site.gpkg", "--prior", "hill.tif", "--pattern", "variance-driven", code=4)
    assert "give either budget_m or rmse_m" in err

"""Exports whose content decides what is written: routes, areas, points, tracks."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from pyproj import CRS
from typer.testing import CliRunner

from firnline.cli.main import app
from planners import LawnmowerConfig, plan
from survey import Route, SurveyArea, Trajectory
from survey.io.trajectory_files import read_track, write_track
from survey.io.vector import read_features, write_features

UTM = "EPSG:32608"
AREA = SurveyArea.rectangle((500_000.0, 6_000_000.0, 500_300.0, 6_000_300.0), UTM)


@pytest.fixture
def route(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Route:
    """Write a route of three swaths to route.gpkg in an empty folder."""
    monkeypatch.chdir(tmp_path)
    made = plan(AREA, None, LawnmowerConfig(swaths=3))
    made.write("route.gpkg")
    return made


def export(*args: str, code: int = 0) -> str:
    done = CliRunner().invoke(app, ["export", *args])
    assert done.exit_code == code, done.output
    return done.stderr


@pytest.mark.parametrize("suffix", [".kml", ".waypoints", ".plan", ".gpx", ".geojson", ".gpkg"])
def test_every_route_format_is_exported_back_without_options(route: Route, suffix: str) -> None:
    export("route.gpkg", f"a{suffix}")
    export(f"a{suffix}", "back.gpkg")
    back = Route.read("back.gpkg")
    assert back.crs.to_epsg() == route.crs.to_epsg()
    assert shapely.hausdorff_distance(back.line, route.line) < 0.01


@pytest.mark.parametrize("suffix", [".csv", ".wkt"])
def test_a_route_in_metres_without_crs_needs_its_name(route: Route, suffix: str) -> None:
    export("route.gpkg", f"a{suffix}")
    refusal = export(f"a{suffix}", "back.gpkg", code=3)
    assert "states no projected CRS; name that of the route, e.g. --crs EPSG:32608." in refusal
    export(f"a{suffix}", "back.gpkg", "--crs", UTM)
    assert shapely.hausdorff_distance(Route.read("back.gpkg").line, route.line) < 0.01


@pytest.mark.usefixtures("route")
def test_lines_of_another_tool_stay_in_their_projected_crs() -> None:
    line = [shapely.LineString([(10.0, 10.0), (200.0, 10.0)])]
    write_features("lines.gpkg", line, {"name": np.array(["a"], dtype=object)}, CRS("EPSG:3413"), layer="l")
    export("lines.gpkg", "back.gpkg")
    assert Route.read("back.gpkg").crs.to_epsg() == 3413


@pytest.mark.usefixtures("route")
def test_points_are_no_route() -> None:
    Path("landmarks.csv").write_text("x_m,y_m,z_m,sigma_z_m\n500010.0,6000010.0,3.0,0.1\n")
    export("landmarks.csv", "points.gpkg", "--crs", UTM)
    assert "sigma_z_m" in read_features("points.gpkg").attributes
    export("points.gpkg", "again.csv")
    assert Path("again.csv").read_text().startswith("x_m,y_m,z_m")


def test_polygons_are_an_area(route: Route) -> None:
    AREA.write("site.kml")
    export("site.kml", "site.gpkg")
    assert SurveyArea.read("site.gpkg").crs.to_epsg() == route.crs.to_epsg()


@pytest.mark.usefixtures("route")
def test_poses_with_times_are_a_track() -> None:
    times = np.arange(5.0)
    place, turn = np.column_stack([times + 5e5, times + 6e6, times]), np.tile([0.0, 0.0, 0.0, 1.0], (5, 1))
    Trajectory(times, place, turn, np.zeros((5, 3, 3)), UTM).write("path.csv")
    export("path.csv", "path.gpkg", "--crs", UTM)
    np.testing.assert_array_equal(read_track("path.gpkg", CRS(UTM))[0], times)


@pytest.mark.usefixtures("route")
def test_a_track_of_places_is_read_in_the_crs_that_it_states() -> None:
    times = np.arange(5.0)
    place = np.column_stack([times + 5e5, times + 6e6, times])
    write_track("track.gpkg", times, place, CRS(UTM))
    export("track.gpkg", "a.gpx", "--as", "track")
    export("a.gpx", "back.gpkg", "--as", "track")
    export("track.gpkg", "same.gpkg", "--as", "track", "--crs", UTM)
    for name, tolerance_m in (("a.gpx", 1e-3), ("back.gpkg", 1e-3), ("same.gpkg", 0.0)):
        found = read_track(name, CRS(UTM))
        np.testing.assert_array_equal(found[0], times)
        np.testing.assert_allclose(found[1], place, rtol=0.0, atol=tolerance_m)
    assert read_features("back.gpkg").crs == CRS(UTM)
    assert "export the trajectory.csv" in export("track.gpkg", "a.txt", "--as", "track", code=3)
    assert "UTM zone 33N was named" in export(
        "track.gpkg", "b.gpx", "--as", "track", "--crs", "EPSG:32633", code=3
    )

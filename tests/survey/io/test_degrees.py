"""A CRS without a code is preserved in files that hold degrees, or the file is refused."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from pyproj import CRS

from survey import InputError, Leg, Route, SurveyArea
from survey.interchange.route_formats import read_plan, write_plan
from survey.io.vector import write_features

CONIC = "+proj=lcc +lat_1=60 +lat_2=62 +lat_0=61 +lon_0=-123 +x_0=5000 +y_0=7000 +datum=WGS84 +units=m"
LOCAL = 'LOCAL_CS["site grid",UNIT["metre",1],AXIS["x",EAST],AXIS["y",NORTH]]'
UTM_TEXT = "+proj=utm +zone=8 +datum=WGS84 +units=m"
XY = np.array([[5000.0, 7000.0], [5030.0, 7040.0], [5030.0, 7100.0]])


def _route(crs: str) -> Route:
    return Route((Leg("swath", XY[:2]), Leg("transit", XY[1:])), crs, "line", prediction={"time_s": 9.0})


def test_a_geojson_of_a_crs_without_a_code_holds_degrees(tmp_path: Path) -> None:
    _route(CONIC).write(tmp_path / "r.geojson")
    content = json.loads((tmp_path / "r.geojson").read_text())
    longitude, latitude = content["features"][0]["geometry"]["coordinates"][0]
    assert (longitude, latitude) == pytest.approx((-123.0, 61.0), abs=1e-6)


@pytest.mark.parametrize("name", ["r.geojson", "r.gpkg", "r.json"])
def test_a_route_keeps_a_crs_without_a_code(tmp_path: Path, name: str) -> None:
    _route(CONIC).write(tmp_path / name)
    back = Route.read(tmp_path / name)
    assert back.crs.equals(CRS(CONIC), ignore_axis_order=True)
    np.testing.assert_allclose(back.path(), XY, atol=1e-6)
    assert back.prediction == {"time_s": 9.0}


def test_a_crs_that_equals_a_registered_one_is_named_by_its_code(tmp_path: Path) -> None:
    route = Route((Leg("swath", [[500_000.0, 6.7e6], [500_100.0, 6.7e6]]),), UTM_TEXT, "line")
    route.write(tmp_path / "r.geojson")
    assert "EPSG::32608" in (tmp_path / "r.geojson").read_text()
    np.testing.assert_array_equal(Route.read(tmp_path / "r.geojson").path(), route.path())


def test_an_area_keeps_a_crs_without_a_code(tmp_path: Path) -> None:
    area = SurveyArea(shapely.box(5000.0, 7000.0, 5100.0, 7100.0), CONIC, starts=[[5050.0, 7050.0]])
    area.write(tmp_path / "a.geojson")
    back = SurveyArea.read(tmp_path / "a.geojson")
    assert back.crs.equals(area.crs, ignore_axis_order=True)
    np.testing.assert_allclose(back.bounds, area.bounds, atol=1e-6)


def test_heights_of_features_stay_as_they_are(tmp_path: Path) -> None:
    from survey.io.vector import read_features

    point = shapely.Point(5000.0, 7000.0, 123.25)
    write_features(
        tmp_path / "p.geojson", [point], {"name": np.array(["a"], dtype=object)}, CRS(CONIC), layer="p"
    )
    back = read_features(tmp_path / "p.geojson")
    np.testing.assert_allclose(
        shapely.get_coordinates(back.geometry, include_z=True)[0], [5000.0, 7000.0, 123.25]
    )
    assert list(back.attributes) == ["name"]


@pytest.mark.parametrize("name", ["r.geojson", "r.json", "r.kml", "r.gpx", "r.plan", "r.waypoints", "r.csv"])
def test_degrees_of_a_local_crs_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"local system .* GeoPackage \(\.gpkg\)"):
        write_plan(_route(LOCAL), tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["a.geojson", "a.kml"])
def test_an_area_in_a_local_crs_is_not_written_in_degrees(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="local system"):
        SurveyArea.rectangle((0.0, 0.0, 50.0, 50.0), LOCAL).write(tmp_path / name)


def test_a_local_crs_is_preserved_in_a_geopackage(tmp_path: Path) -> None:
    write_plan(_route(LOCAL), tmp_path / "r.gpkg")
    assert Route.read(tmp_path / "r.gpkg").crs.equals(_route(LOCAL).crs, ignore_axis_order=True)


@pytest.mark.parametrize(
    "name", ["r.geojson", "r.kml", "r.gpx", "r.plan", "r.waypoints", "r.csv", "r.wkt", "r.gpkg"]
)
def test_every_route_format_gives_back_a_route_in_a_crs_without_a_code(tmp_path: Path, name: str) -> None:
    route = _route(CONIC)
    write_plan(route, tmp_path / name)
    np.testing.assert_allclose(read_plan(tmp_path / name, CONIC).path(), route.path(), atol=0.001)

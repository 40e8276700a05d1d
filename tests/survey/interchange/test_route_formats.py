"""Plans written for other tools, read back by other tools."""

import json
import os
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
from pymavlink import mavwp
from pyproj import Transformer

from survey.core.errors import InputError
from survey.data.route import Leg, Route
from survey.interchange.route_formats import read_plan, write_plan

CRS = "EPSG:32608"
DATA = Path(os.environ.get("FIRNLINE_DATA", Path(__file__).parents[4] / "shared" / "data"))
# Nine decimals of a degree are 0.06 mm of rounding; CSV has a tenth of a millimetre.
ROUNDING_M = 2e-4


@pytest.fixture
def route() -> Route:
    """Two swaths and the transit between them, 600 km from the equator's origin of its zone."""
    origin = np.array([600_000.0, 6_700_000.0])
    legs = (
        Leg("swath", origin + [[0.0, 0.0], [0.0, 100.0]]),
        Leg("transit", origin + [[0.0, 100.0], [10.0, 120.0], [20.0, 100.0]]),
        Leg("swath", origin + [[20.0, 100.0], [25.0, 50.0], [20.0, 0.0]]),
    )
    return Route(legs, CRS, "lawnmower", 20.0, {"time_s": 450.0})


@pytest.fixture
def two_rovers(route: Route) -> Route:
    other = tuple(Leg(leg.kind, leg.xy + [100.0, 0.0], 1) for leg in route.legs)
    return Route(route.legs + other, CRS, "lawnmower", 20.0)


def to_metres(lonlat: np.ndarray) -> np.ndarray:
    east, north = Transformer.from_crs("EPSG:4326", CRS, always_xy=True).transform(*np.asarray(lonlat).T)
    return np.column_stack([east, north])


@pytest.mark.parametrize("ending", [".geojson", ".kml", ".gpx"])
def test_names_count_rovers_from_1_as_plan_sheets_and_missions_do(
    tmp_path: Path, two_rovers: Route, ending: str
) -> None:
    write_plan(two_rovers, tmp_path / f"plan{ending}")
    text = (tmp_path / f"plan{ending}").read_text()
    assert "rover 1" in text
    assert "rover 2" in text
    assert "rover 0" not in text


@pytest.mark.parametrize("ending", [".geojson", ".json", ".kml", ".gpkg"])
def test_gdal_reads_every_leg_with_its_kind(tmp_path: Path, route: Route, ending: str) -> None:
    write_plan(route, tmp_path / f"plan{ending}")
    meta, _, geometry, columns = pyogrio.raw.read(tmp_path / f"plan{ending}", layer=0)
    kinds = columns[list(meta["fields"]).index("kind")]
    assert list(kinds) == [leg.kind for leg in route.legs]
    for shape, leg in zip(shapely.from_wkb(geometry), route.legs, strict=True):
        xy = shapely.get_coordinates(shape)
        np.testing.assert_allclose(xy if ending == ".gpkg" else to_metres(xy), leg.xy, atol=ROUNDING_M)


def test_gdal_reads_gpx_as_one_route_per_rover(tmp_path: Path, two_rovers: Route) -> None:
    write_plan(two_rovers, tmp_path / "plan.gpx")
    _, _, geometry, _ = pyogrio.raw.read(tmp_path / "plan.gpx", layer="routes")
    assert len(geometry) == 2
    for rover, shape in enumerate(shapely.from_wkb(geometry)):
        xy = to_metres(shapely.get_coordinates(shape))
        np.testing.assert_allclose(xy, two_rovers.path(rover), atol=ROUNDING_M)


def test_gdal_reads_csv_columns(tmp_path: Path, route: Route) -> None:
    write_plan(route, tmp_path / "plan.csv")
    meta, _, _, columns = pyogrio.raw.read(tmp_path / "plan.csv")
    table = dict(zip(meta["fields"], columns, strict=True))
    easting = table["easting_m"].astype(float)
    np.testing.assert_allclose(easting, np.vstack([leg.xy for leg in route.legs])[:, 0], atol=ROUNDING_M)
    degrees = np.column_stack([table["longitude_deg"].astype(float), table["latitude_deg"].astype(float)])
    np.testing.assert_allclose(to_metres(degrees)[:, 0], easting, atol=ROUNDING_M)


def test_wkt_is_exact(tmp_path: Path, route: Route) -> None:
    write_plan(route, tmp_path / "plan.wkt")
    shapes = [shapely.from_wkt(line) for line in (tmp_path / "plan.wkt").read_text().splitlines()]
    for shape, leg in zip(shapes, route.legs, strict=True):
        np.testing.assert_array_equal(shapely.get_coordinates(shape), leg.xy)


def test_pymavlink_reads_the_mission(tmp_path: Path, route: Route) -> None:
    write_plan(route, tmp_path / "plan.waypoints")
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(tmp_path / "plan.waypoints")) == len(route.path()) + 1
    items = [loader.wp(i) for i in range(1, loader.count())]
    assert {item.command for item in items} == {16}
    assert loader.wp(0).current == 1
    # pymavlink keeps degrees in single precision: 1e-5 degrees of longitude, a metre.
    xy = to_metres(np.array([[item.y, item.x] for item in items]))
    np.testing.assert_allclose(xy, route.path(), atol=2.0)


def test_qgroundcontrol_plan_follows_the_schema(tmp_path: Path, route: Route) -> None:
    write_plan(route, tmp_path / "site.plan")
    plan = json.loads((tmp_path / "site.plan").read_text())
    assert (plan["fileType"], plan["version"], plan["groundStation"]) == ("Plan", 1, "QGroundControl")
    assert set(plan["geoFence"]) == {"circles", "polygons", "version"}
    assert set(plan["rallyPoints"]) == {"points", "version"}
    mission = plan["mission"]
    assert (mission["version"], mission["vehicleType"]) == (2, 10)
    assert mission["cruiseSpeed"] == pytest.approx(route.length_m / 450.0, abs=1e-3)
    assert [item["doJumpId"] for item in mission["items"]] == list(range(1, len(route.path()) + 1))
    for item, xy in zip(mission["items"], route.path(), strict=True):
        assert (item["type"], item["command"], item["frame"], len(item["params"])) == ("SimpleItem", 16, 3, 7)
        np.testing.assert_allclose(to_metres([item["params"][5:3:-1]])[0], xy, atol=ROUNDING_M)


@pytest.mark.parametrize(
    "ending", [".geojson", ".kml", ".gpkg", ".csv", ".wkt", ".gpx", ".plan", ".waypoints"]
)
def test_what_is_written_reads_back(tmp_path: Path, route: Route, ending: str) -> None:
    write_plan(route, tmp_path / f"plan{ending}")
    back = read_plan(tmp_path / f"plan{ending}", CRS)
    np.testing.assert_allclose(back.path(), route.path(), atol=ROUNDING_M)
    if ending in (".geojson", ".kml", ".gpkg", ".csv"):
        assert [leg.kind for leg in back.legs] == [leg.kind for leg in route.legs]


def test_writing_twice_gives_the_same_bytes(tmp_path: Path, route: Route) -> None:
    for ending in (".geojson", ".gpx", ".kml", ".csv", ".wkt", ".plan", ".waypoints", ".gpkg"):
        paths = [tmp_path / f"{name}" / f"plan{ending}" for name in "ab"]
        for path in paths:
            path.parent.mkdir(exist_ok=True)
            write_plan(route, path)
        assert paths[0].read_bytes() == paths[1].read_bytes(), ending


@pytest.mark.parametrize("ending", [".plan", ".waypoints"])
def test_a_mission_holds_one_vehicle(tmp_path: Path, two_rovers: Route, ending: str) -> None:
    with pytest.raises(InputError, match="one file per rover"):
        write_plan(two_rovers, tmp_path / f"plan{ending}")
    write_plan(two_rovers, tmp_path / f"plan{ending}", rover=1)
    back = read_plan(tmp_path / f"plan{ending}", CRS)
    np.testing.assert_allclose(back.path(), two_rovers.path(1), atol=ROUNDING_M)


def test_rovers_survive_geojson(tmp_path: Path, two_rovers: Route) -> None:
    write_plan(two_rovers, tmp_path / "plan.geojson")
    back = read_plan(tmp_path / "plan.geojson", CRS)
    np.testing.assert_allclose(back.path(1), two_rovers.path(1), atol=ROUNDING_M)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.plan", "{}", "damaged"),
        ("a.plan", '{"mission": {"items": []}}', "no line of two waypoints"),
        ("a.waypoints", "QGC WPL 100\n", "QGC WPL 110 was expected"),
        ("a.waypoints", "QGC WPL 110\n0\t1\n", "damaged"),
        ("a.csv", "a,b\n1,2\n", "damaged"),
        ("a.wkt", "LINESTRING (0 0", "damaged"),
        ("a.geojson", "{", "damaged"),
        ("a.txt", "x", "ends in"),
        ("a.plan", "", "empty"),
    ],
)
def test_damaged_plans_are_refused_in_a_sentence(tmp_path: Path, name: str, text: str, message: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_plan(tmp_path / name, CRS)
    assert "\n" not in str(caught.value)


def test_unknown_endings_and_rovers_are_refused(tmp_path: Path, route: Route) -> None:
    with pytest.raises(InputError, match="ends in"):
        write_plan(route, tmp_path / "plan.xyz")
    with pytest.raises(InputError, match="no rover 3"):
        write_plan(route, tmp_path / "plan.csv", rover=3)


@pytest.mark.skipif(not DATA.is_dir(), reason="FIRNLINE_DATA is missing")
def test_missions_of_ground_stations_are_read() -> None:
    folder = DATA / "coverage_qgc"
    text = read_plan(folder / "MissionPlanner.waypoints", "EPSG:32610")
    plan = read_plan(folder / "SectionTest.plan", "EPSG:32610")
    assert len(text.path()) == 5
    assert len(plan.path()) == 4  # take-off and three waypoints

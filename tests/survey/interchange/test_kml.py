"""KML and KMZ of a route: folders, styles, labels, heights, polygons with holes."""

import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import shapely

from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.route import Leg, Route
from survey.interchange.missions import Surroundings
from survey.interchange.route_writers import write_kml, write_kmz

CRS = "EPSG:32608"
ORIGIN = np.array([600_000.0, 6_700_000.0])
K = "{http://www.opengis.net/kml/2.2}"


@pytest.fixture
def route() -> Route:
    """Two swaths with a transit for one rover, a swath for another."""
    legs = (
        Leg("swath", ORIGIN + [[0.0, 0.0], [0.0, 100.0]]),
        Leg("transit", ORIGIN + [[0.0, 100.0], [20.0, 100.0]]),
        Leg("swath", ORIGIN + [[20.0, 100.0], [20.0, 0.0]]),
        Leg("swath", ORIGIN + [[60.0, 0.0], [60.0, 80.0]], 1),
    )
    return Route(legs, CRS, "lawnmower", 20.0)


def written(route: Route, folder: Path, around: Surroundings | None = None) -> ET.Element:
    write_kml(route, folder / "plan.kml", around or Surroundings())
    return ET.parse(folder / "plan.kml").getroot()


def folders(root: ET.Element) -> dict[str, ET.Element]:
    return {folder.findtext(f"{K}name"): folder for folder in root.iter(f"{K}Folder")}


def test_each_rover_has_a_folder_of_legs_and_one_of_labels(route: Route, tmp_path: Path) -> None:
    found = folders(written(route, tmp_path))
    assert set(found) == {"Rover 1", "Rover 2", "Rover 1, labels", "Rover 2, labels"}
    assert len(found["Rover 1"].findall(f"{K}Placemark")) == 3
    labels = [mark.findtext(f"{K}name") for mark in found["Rover 1, labels"].findall(f"{K}Placemark")]
    assert labels == ["1", "2", "Start, rover 1", "End, rover 1"]


def test_every_style_that_a_placemark_names_is_defined(route: Route, tmp_path: Path) -> None:
    area = SurveyArea(shapely.box(*ORIGIN, *(ORIGIN + 100.0)), CRS)
    root = written(route, tmp_path, Surroundings(area=area))
    defined = {style.get("id") for style in root.iter(f"{K}Style")}
    assert {url.text.removeprefix("#") for url in root.iter(f"{K}styleUrl")} <= defined


def test_waypoints_have_three_numbers_with_a_terrain_and_two_without(route: Route, tmp_path: Path) -> None:
    grid = Grid((*(ORIGIN - 50.0), *(ORIGIN + 150.0)), 10.0, CRS)
    flat = Surroundings(terrain=Dem.on(grid, np.full(grid.shape, 812.5)))
    lines = [line.findtext(f"{K}coordinates") for line in written(route, tmp_path).iter(f"{K}LineString")]
    assert {place.count(",") for line in lines for place in line.split()} == {1}
    lines = [
        line.findtext(f"{K}coordinates") for line in written(route, tmp_path, flat).iter(f"{K}LineString")
    ]
    assert {place.rpartition(",")[2] for line in lines for place in line.split()} == {"812.50"}


def test_a_hole_of_the_area_is_an_inner_boundary(route: Route, tmp_path: Path) -> None:
    outline = shapely.box(*(ORIGIN - 10.0), *(ORIGIN + 120.0)).difference(
        shapely.box(*(ORIGIN + 30.0), *(ORIGIN + 50.0))
    )
    root = written(route, tmp_path, Surroundings(area=SurveyArea(outline, CRS)))
    (polygon,) = folders(root)["Survey area"].iter(f"{K}Polygon")
    assert len(polygon.findall(f"{K}outerBoundaryIs")) == len(polygon.findall(f"{K}innerBoundaryIs")) == 1


def test_kmz_holds_the_same_document_in_equal_bytes(route: Route, tmp_path: Path) -> None:
    write_kml(route, tmp_path / "plan.kml", Surroundings())
    for name in ("plan.kmz", "again.kmz"):
        (tmp_path / name.removesuffix(".kmz")).mkdir()
        write_kmz(route, tmp_path / name.removesuffix(".kmz") / "plan.kmz", Surroundings())
    first, second = (tmp_path / "plan" / "plan.kmz", tmp_path / "again" / "plan.kmz")
    assert first.read_bytes() == second.read_bytes()
    with zipfile.ZipFile(first) as archive:
        assert archive.namelist() == ["doc.kml"]
        assert archive.read("doc.kml") == (tmp_path / "plan.kml").read_bytes()


def test_a_seventh_rover_has_the_colour_of_the_first(tmp_path: Path) -> None:
    legs = tuple(Leg("swath", ORIGIN + [[30.0 * k, 0.0], [30.0 * k, 50.0]], k) for k in range(7))
    root = written(Route(legs, CRS, "lawnmower", 30.0), tmp_path)
    colours = {
        style.get("id"): style.findtext(f"{K}LineStyle/{K}color")
        for style in root.iter(f"{K}Style")
        if style.find(f"{K}LineStyle") is not None
    }
    assert colours["swath-6"] == colours["swath-0"] != colours["swath-5"]


def test_heights_above_the_ellipsoid_are_noted(caplog: pytest.LogCaptureFixture) -> None:
    grid = Grid((0.0, 0.0, 100.0, 100.0), 10.0, CRS)
    terrain = Dem.on(grid, np.full(grid.shape, 812.5), "ellipsoidal height")
    assert Surroundings(terrain=terrain).heights(np.array([[50.0, 50.0]])) == pytest.approx([812.5])
    assert "count from the ellipsoid" in caplog.text

"""Files that are dropped onto the page."""

import numpy as np
import pytest
import shapely

from desk.plan.document import PlanDocument
from desk.plan.dropped import dropped
from survey.core.errors import FirnlineError
from survey.data.area import SurveyArea
from survey.io.vector import write_features
from tests.desk.conftest import SOUTH, SQUARE, WEST


def area() -> SurveyArea:
    from pyproj import CRS

    return PlanDocument(areas=((SQUARE,),), starts=((WEST + 300.0, SOUTH + 300.0),)).survey_area(
        CRS("EPSG:32608")
    )


@pytest.mark.parametrize("suffix", [".gpkg", ".geojson", ".kml"])
def test_an_outline_comes_with_its_starts_in_the_crs_of_the_terrain(tmp_path, suffix):
    file = tmp_path / f"site{suffix}"
    area().write(file)
    found = dropped(file.name, file.read_bytes(), area().crs)
    assert found["kind"] == "outline"
    (outline,) = found["document"]["areas"][0]
    assert min(x for x, _ in outline) == pytest.approx(WEST + 200.0, abs=1e-3)
    assert found["document"]["starts"][0] == pytest.approx([WEST + 300.0, SOUTH + 300.0], abs=1e-3)


def test_a_raster_becomes_an_image_with_its_place(dem_file):
    found = dropped("error.tif", dem_file.read_bytes(), area().crs, ["elevations"])
    assert found["kind"] == "raster"
    assert found["bounds"] == [WEST, SOUTH, WEST + 900.0, SOUTH + 900.0]
    assert found["limits"][0] < found["limits"][1]


def test_points_are_thinned_and_counted():
    rows = "\n".join(f"{WEST + k},{SOUTH + k},800.0,0.1" for k in range(6000))
    found = dropped("points.csv", f"x_m,y_m,z_m,sigma_z_m\n{rows}\n".encode(), area().crs)
    assert found["n_points"] == 6000
    assert len(found["places"]) == 3000


def test_points_without_an_uncertainty_are_taken():
    rows = "\n".join(f"{WEST + k},{SOUTH + k},800.0" for k in range(5))
    assert dropped("points.csv", f"x_m,y_m,z_m\n{rows}\n".encode(), area().crs)["n_points"] == 5


def test_landmarks_in_a_geopackage_are_points(tmp_path):
    from survey.data.surface_points import SurfacePoints

    xyz = [[WEST + 10.0 * k, SOUTH, 800.0] for k in range(5)]
    SurfacePoints(xyz, sigma_m=0.1, crs="EPSG:32608").write(tmp_path / "landmarks.gpkg")
    found = dropped("landmarks.gpkg", (tmp_path / "landmarks.gpkg").read_bytes(), area().crs)
    assert found["kind"] == "points"
    assert found["n_points"] == 5


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("page.html", b"<html>"),
        ("noending", b"x"),
        ("../../evil.sh", b"x"),
        ("site.kml", b"<kml>"),
        ("site.geojson", b'{"type": "FeatureCollection", "features": []}'),
        ("site.gpkg", b"SQLite format 3\x00 broken"),
        ("map.tif", b"II*\x00" + bytes(100)),
        ("points.csv", b"a,b\n1,2\n"),
        ("empty.kml", b""),
    ],
)
def test_a_wrong_file_is_refused_by_its_name(name, content):
    with pytest.raises(FirnlineError) as refused:
        dropped(name, content, area().crs)
    assert "firnline-desk-" not in str(refused.value)
    assert str(refused.value).endswith(".")


def test_an_outline_beside_a_raster_in_another_crs_is_refused(dem_file):
    from pyproj import CRS

    with pytest.raises(FirnlineError, match="different systems"):
        dropped("error.tif", dem_file.read_bytes(), CRS("EPSG:32609"), ["elevations"])


def test_a_file_of_many_outlines_is_answered_with_a_choice(tmp_path):
    shapes = [shapely.box(WEST + 100.0 * k, SOUTH, WEST + 100.0 * k + 50.0, SOUTH + 90.0) for k in range(3)]
    columns = {"RGIId": [f"RGI60-01.0000{k}" for k in range(3)], "Name": ["Gulkana", None, "Wolverine"]}
    attributes = {name: np.array(values, dtype=object) for name, values in columns.items()}
    write_features(tmp_path / "rgi.gpkg", shapes, attributes, area().crs, layer="rgi")
    content = (tmp_path / "rgi.gpkg").read_bytes()
    found = dropped("rgi.gpkg", content, area().crs)
    assert found["kind"] == "choices"
    assert [choice["title"] for choice in found["choices"]][:2] == [
        "all of them",
        "RGIId=RGI60-01.00000 (Gulkana)",
    ]
    chosen = dropped("rgi.gpkg", content, area().crs, [found["choices"][3]["select"]])
    assert chosen["document"]["areas"][0][0][0] == pytest.approx([WEST + 250.0, SOUTH], abs=1e-3)
    assert len(dropped("rgi.gpkg", content, area().crs, ["*"])["document"]["areas"]) == 3
    two = dropped("rgi.gpkg", content, area().crs, [choice["select"] for choice in found["choices"][1:3]])
    assert len(two["document"]["areas"]) == 2


@pytest.mark.parametrize("n", [1, 2, 13])
def test_of_several_outlines_one_is_asked_for(tmp_path, n):
    shapes = [shapely.box(WEST + 20.0 * k, SOUTH, WEST + 20.0 * k + 9.0, SOUTH + 9.0) for k in range(n)]
    write_features(tmp_path / "fields.gpkg", shapes, {"id": np.arange(n)}, area().crs, layer="fields")
    content = (tmp_path / "fields.gpkg").read_bytes()
    found = dropped("fields.gpkg", content, area().crs)
    assert found["kind"] == ("outline" if n == 1 else "choices")
    assert len(found.get("choices", [])) == (0 if n == 1 else n + 1)
    assert len(dropped("fields.gpkg", content, area().crs, ["*"])["document"]["areas"]) == n

"""Kinds of content by ending, columns and geometries."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.route import Leg, Route
from survey.interchange.conversion import kind_of
from survey.interchange.route_formats import write_plan
from survey.interchange.route_readers import READERS

CRS = "EPSG:32608"


@pytest.mark.parametrize(
    ("source", "out", "kind"),
    [
        ("map.vrt", "map.tif", "raster"),
        ("map", "MAP.ASC", "raster"),
        ("scan.laz", "scan.csv", "points"),
        ("points.csv", "points.ply", "points"),
        ("path.tum", "path.txt", "track"),
        ("path.csv", "path.tum", "track"),
        ("survey.waypoints", "survey.csv", "route"),
    ],
)
def test_an_ending_that_stands_for_one_kind_decides_without_reading(source, out, kind):
    assert kind_of(source, out) == kind


def test_an_ending_that_only_routes_have_stands_for_a_route(monkeypatch):
    monkeypatch.setitem(READERS, ".poly", READERS[".wkt"])
    assert kind_of("survey.poly", "survey.gpkg") == "route"


@pytest.mark.parametrize(
    ("columns", "kind"),
    [
        ("time_s,x_m,y_m,z_m,qx,qy,qz,qw,var_xx_m2", "track"),
        ("rover,leg,kind,waypoint,easting_m,northing_m", "route"),
        ('\ufeff"x_m","y_m","z_m"', "points"),
    ],
)
def test_the_columns_of_a_table_decide(tmp_path: Path, columns, kind):
    (tmp_path / "a.csv").write_text(columns + "\n", encoding="utf-8")
    assert kind_of(tmp_path / "a.csv", "a.gpkg") == kind


def test_the_geometries_of_a_vector_file_decide(tmp_path: Path):
    SurveyArea(shapely.box(500_000.0, 6_700_000.0, 500_100.0, 6_700_100.0), CRS).write(tmp_path / "area.gpkg")
    line = np.array([[500_000.0, 6_700_000.0], [500_100.0, 6_700_000.0]])
    write_plan(Route((Leg("swath", line),), CRS, "line"), tmp_path / "route.gpkg")
    assert kind_of(tmp_path / "area.gpkg", "a.kml") == "area"
    assert kind_of(tmp_path / "route.gpkg", "a.kml") == "route"


def test_a_missing_table_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match="does not exist"):
        kind_of(tmp_path / "a.csv", "a.gpkg")

"""Exchanged eastings and northings, and degrees, are refused in points and areas; uncommon places of a CRS are not."""

import numpy as np
import pytest
import shapely
from pyproj import CRS, Transformer

from survey import SurfacePoints, SurveyArea
from survey.core.crs import refuse_degrees, refuse_exchanged
from survey.core.errors import InputError
from survey.io.vector import write_features

PLACE = np.array([[500_000.0, 6_700_000.0], [500_300.0, 6_700_200.0]])


@pytest.mark.parametrize("code", [32608, 2056, 25832, 3857, 3413, 3031, 3995])
def test_places_in_and_around_the_area_of_use_pass(code):
    crs = CRS.from_epsg(code)
    area = crs.area_of_use
    to_crs = Transformer.from_crs(4326, crs, always_xy=True)
    middle = to_crs.transform(0.5 * (area.west + area.east), 0.5 * (area.south + area.north))
    refuse_exchanged(np.array([middle]), crs, "the test")
    refuse_exchanged(np.zeros((1, 2)), crs, "the test")


def test_a_place_far_beyond_the_area_of_use_passes_where_exchanging_does_not_help():
    refuse_exchanged(PLACE, CRS("EPSG:3031"), "the test")
    refuse_exchanged(PLACE, CRS("EPSG:32601"), "the test")


def test_exchanged_points_are_refused(tmp_path):
    rows = [f"{y},{x},100,0.1" for x, y in PLACE.tolist()]
    (tmp_path / "p.csv").write_text("\n".join(["x_m,y_m,z_m,sigma_z_m", *rows]) + "\n")
    with pytest.raises(InputError, match=r"p\.csv lies at easting 6700100 m .* when the two are exchanged"):
        SurfacePoints.read(tmp_path / "p.csv", crs="EPSG:32608")


@pytest.mark.parametrize("wanted", [None, "EPSG:32609"])
def test_an_exchanged_area_is_refused(tmp_path, wanted):
    shape = shapely.Polygon([(y, x) for x, y in shapely.box(*PLACE[0], *PLACE[1]).exterior.coords])
    write_features(tmp_path / "a.gpkg", [shape], {}, CRS("EPSG:32608"), layer="area")
    with pytest.raises(InputError, match="when the two are exchanged"):
        SurveyArea.read(tmp_path / "a.gpkg", crs=wanted)


DEGREES = np.array([[-134.98, 60.41], [-134.95, 60.43]])


@pytest.mark.parametrize("header", ["x,y,z,sigma_z_m", "Easting,Northing,Elevation,sigma_z_m"])
def test_points_in_degrees_in_columns_of_metres_are_refused(tmp_path, header):
    rows = [f"{x},{y},100,0.1" for x, y in DEGREES.tolist()]
    (tmp_path / "p.csv").write_text("\n".join([header, *rows]) + "\n")
    with pytest.raises(
        InputError, match=r"p\.csv has coordinates such as -134\.98, 60\.41, which are degrees"
    ):
        SurfacePoints.read(tmp_path / "p.csv", crs="EPSG:32608")


def test_an_area_in_degrees_that_names_a_projected_crs_is_refused(tmp_path):
    write_features(
        tmp_path / "a.gpkg", [shapely.box(*DEGREES[0], *DEGREES[1])], {}, CRS("EPSG:32608"), layer="area"
    )
    with pytest.raises(InputError, match="degrees and no metres"):
        SurveyArea.read(tmp_path / "a.gpkg")


@pytest.mark.parametrize("code", [32608, 25832, 3857, 3413])
def test_local_coordinates_of_some_metres_are_no_degrees(code):
    refuse_degrees(np.array([[0.0, 0.0], [60.0, 40.0]]), CRS.from_epsg(code), "the test")
    refuse_degrees(np.array([[-135.0, 60.0], [-100.0, 80.0]]), CRS("EPSG:32608"), "the test")

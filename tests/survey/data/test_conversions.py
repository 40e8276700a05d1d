"""Data types as xarray and GeoPandas objects."""

import sys

import numpy as np
import pytest
import shapely

from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.route import Leg, Route
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.reconstruction.terrain_map import Reconstruction

GRID = Grid((0.0, 0.0, 3.0, 2.0), 1.0)
DEM = Dem.on(GRID, GRID.xy[:, 0].reshape(GRID.shape), "EGM2008")


def test_dem_becomes_a_data_array_with_coordinates_and_crs():
    array = DEM.to_xarray()
    assert array.sel(x=2.0, y=1.0).item() == 2.0
    assert array.attrs["units"] == "m"
    assert "zone 8N" in array.coords["spatial_ref"].attrs["crs_wkt"]


@pytest.mark.parametrize("flipped", [{}, {"y": slice(None, None, -1)}, {"x": slice(None, None, -1)}])
def test_a_dem_comes_back_from_its_data_array(flipped):
    array = DEM.to_xarray().isel(flipped)
    for one in (array, array.expand_dims("band"), array.rename(x="easting", y="northing")):
        back = Dem.from_xarray(one)
        np.testing.assert_array_equal(back.elevation, DEM.elevation)
        assert (back.transform, back.crs, back.vertical_datum) == (DEM.transform, DEM.crs, "EGM2008")


def test_unknown_heights_of_a_data_array_are_nan():
    array = DEM.to_xarray()
    marked = array.where(array.x != 1.0, -9999.0).assign_attrs(array.attrs | {"_FillValue": -9999.0})
    np.testing.assert_array_equal(
        np.isnan(Dem.from_xarray(marked).elevation), GRID.xy[:, 0].reshape(GRID.shape) == 1.0
    )


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda array: array.assign_attrs(units="ft"), "is in 'ft'"),
        (lambda array: array.isel(x=0), "two were expected, rows and columns"),
        (lambda array: array.isel(x=[0, 1, 3]), "uneven steps along 'x', 2 after 1"),
        (lambda array: array.isel(x=slice(None, None, 2)), "cells of 2 × 1 m"),
        (lambda array: array.drop_vars("x"), "no coordinates along 'x'"),
        (lambda array: array.drop_vars("spatial_ref"), "states no CRS"),
    ],
)
def test_data_arrays_that_are_no_dem_are_refused(change, sentence):
    with pytest.raises(InputError, match=sentence):
        Dem.from_xarray(change(DEM.to_xarray()))


def test_the_crs_of_an_array_without_one_is_named():
    assert Dem.from_xarray(DEM.to_xarray().drop_vars("spatial_ref"), crs="EPSG:32633").crs == "EPSG:32633"


def test_reconstruction_becomes_a_dataset():
    dataset = Reconstruction(
        DEM, DEM, np.full(GRID.shape, 3), "tin", {}, quantity="temperature_c"
    ).to_xarray()
    assert set(dataset.data_vars) == {"temperature", "standard_deviation", "support"}
    assert dataset["temperature"].attrs["units"] == "degree_Celsius"
    assert dataset["standard_deviation"].attrs["units"] == "degree_Celsius"
    assert dataset.attrs["method"] == "tin"
    assert dataset.attrs["vertical_datum"] == "EGM2008"


def test_a_map_has_the_attributes_of_the_cf_conventions():
    codes = np.arange(DEM.elevation.size).reshape(GRID.shape) % 4
    dataset = Reconstruction(DEM, DEM, codes, "gp", {}).to_xarray()
    assert dataset.attrs["Conventions"] == "CF-1.11"
    height, deviation, support = (dataset[name] for name in ("elevation", "standard_deviation", "support"))
    assert height.attrs["standard_name"] == "surface_altitude"
    assert height.attrs["ancillary_variables"].split() == ["standard_deviation", "support"]
    assert deviation.attrs["standard_name"] == "surface_altitude standard_error"
    meanings = support.attrs["flag_meanings"].split()
    assert [meanings[code] for code in support.attrs["flag_values"]] == [
        "unseen", "interpolated", "ray_bounded", "measured",
    ]  # fmt: skip
    assert dataset["spatial_ref"].attrs["grid_mapping_name"] == "transverse_mercator"
    assert dataset["x"].encoding["_FillValue"] is None


@pytest.mark.parametrize(
    ("datum", "name"),
    [
        ("", None),
        ("ellipsoidal height", "height_above_reference_ellipsoid"),
        ("NAVD88 height", "surface_altitude"),
    ],
)
def test_heights_have_a_standard_name_where_their_datum_is_stated(datum, name):
    array = Dem.on(GRID, DEM.elevation, datum).to_xarray()
    assert array.attrs.get("standard_name") == name


@pytest.mark.parametrize(("datum", "vertical"), [("ellipsoidal height", "Ellipsoid"), ("DVR90 height", None)])
def test_a_dem_becomes_one_of_xdem(datum, vertical, monkeypatch):
    pytest.importorskip("xdem", reason="xdem is not installed")
    dem = Dem.on(GRID, np.where(DEM.elevation == 1.0, np.nan, DEM.elevation), datum)
    theirs = dem.to_xdem()
    np.testing.assert_array_equal(theirs.data.filled(np.nan), dem.elevation)
    assert (theirs.transform, theirs.crs.to_epsg(), theirs.vcrs_name and "Ellipsoid") == (
        dem.transform,
        32608,
        vertical,
    )


def test_route_becomes_a_table_of_legs():
    legs = (Leg("swath", [[0.0, 0.0], [3.0, 0.0]]), Leg("transit", [[3.0, 0.0], [3.0, 2.0]]))
    frame = Route(legs, GRID.crs, "line", prediction={"rmse_m": 0.4}).to_geodataframe()
    assert list(frame["kind"]) == ["swath", "transit"]
    assert list(frame.length) == [3.0, 2.0]
    assert frame.crs == GRID.crs
    assert (frame["predicted_rmse_m"] == 0.4).all()


def test_points_and_poses_become_tables_with_elevations():
    points = SurfacePoints([[0.0, 1.0, 5.0]], sigma_m=0.1, crs=GRID.crs).to_geodataframe()
    assert shapely.get_coordinates(points.geometry, include_z=True).tolist() == [[0.0, 1.0, 5.0]]
    assert points["sigma_z_m"].tolist() == [0.1]
    pose = Trajectory([0.0], [[0.0, 1.0, 5.0]], [[0.0, 0.0, 0.0, 1.0]], 4.0 * np.eye(3)[None], GRID.crs)
    frame = pose.to_geodataframe()
    assert frame[["sigma_x_m", "sigma_z_m", "health"]].to_numpy().tolist() == [[2.0, 2.0, 1.0]]


def test_survey_area_becomes_a_table_with_roles():
    hole = shapely.box(1.0, 1.0, 2.0, 2.0)
    area = SurveyArea(shapely.box(0.0, 0.0, 9.0, 9.0), GRID.crs, (hole,), [[5.0, 5.0]])
    assert area.to_geodataframe()["role"].tolist() == ["area", "no-go", "start"]


@pytest.mark.parametrize(
    ("package", "convert"),
    [
        ("xarray", DEM.to_xarray),
        ("geopandas", lambda: SurveyArea.rectangle(GRID.bounds, GRID.crs).to_geodataframe()),
        ("xdem", DEM.to_xdem),
    ],
)
def test_a_missing_optional_package_is_named_with_its_extra(package, convert, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    install = "xdem" if package == "xdem" else r"firnline\[notebook\]"
    with pytest.raises(InputError, match=rf"needs {package}, which is not installed; install {install}\."):
        convert()

import numpy as np
import pytest
from affine import Affine

from survey import Dem, Grid, InputError

CRS = "EPSG:32608"


def test_bilinear_interpolation_is_exact_on_a_plane(plane, rng):
    xy = rng.uniform([-2.4, -2.4], [102.4, 52.4], (200, 2))  # the outer half cell included
    # Only rounding of numbers near 100 m remains.
    np.testing.assert_allclose(plane.at(xy), 100.0 + 0.1 * xy[:, 0] - 0.2 * xy[:, 1], atol=1e-12)


def test_height_is_not_known_outside_the_cells(plane):
    assert np.isnan(plane.at([[-2.6, 10.0], [50.0, 52.6], [1e9, 0.0]])).all()


def test_nodata_spoils_only_the_patches_that_touch_it(plane):
    elevation = plane.elevation.copy()
    elevation[5, 10] = np.nan  # the node at x = 50, y = 25
    holed = Dem(elevation, plane.transform, plane.crs)
    assert np.isnan(holed.at([[50.0, 25.0], [47.0, 26.0]])).all()
    assert np.isfinite(holed.at([[45.0, 25.0], [40.0, 25.0], [55.0, 30.0]])).all()


def test_slope_of_a_plane_points_east_and_south(plane):
    to_east, to_north = plane.gradient()
    np.testing.assert_allclose(to_east, 0.1, atol=1e-12)
    np.testing.assert_allclose(to_north, -0.2, atol=1e-12)
    np.testing.assert_allclose(plane.slope().elevation, np.degrees(np.arctan(np.hypot(0.1, 0.2))))


def test_block_mean_of_a_plane_is_the_plane_at_the_block_centres():
    grid = Grid((0.5, 0.5, 11.5, 7.5), 1.0, CRS)
    x, y = np.meshgrid(grid.x, grid.y)
    coarse = Dem.on(grid, 3.0 * x + y).block_mean(4.0)
    assert coarse.shape == (2, 3)
    np.testing.assert_allclose(coarse.elevation, 3.0 * np.array([2.0, 6.0, 10.0]) + np.array([[6.0], [2.0]]))


def test_block_mean_needs_half_of_the_cells():
    grid = Grid((0.5, 0.5, 3.5, 3.5), 1.0, CRS)
    values = np.ones(grid.shape)
    values[:2, :2] = [[np.nan, np.nan], [np.nan, 1.0]]
    coarse = Dem.on(grid, values).block_mean(2.0)
    assert np.isnan(coarse.elevation[0, 0])
    assert np.isfinite(coarse.elevation).sum() == 3


def test_file_gives_back_elevation_georeference_and_datum(plane, tmp_path):
    stated = Dem(plane.elevation, plane.transform, plane.crs, "EGM96 height")
    stated.write(tmp_path / "a.tif")
    back = Dem.read(tmp_path / "a.tif")
    # Files hold float32: seven digits of about 110 m.
    np.testing.assert_allclose(back.elevation, plane.elevation, atol=1e-5)
    assert back.transform == plane.transform
    assert back.crs == plane.crs
    assert back.vertical_datum == "EGM96 height"


def test_nodata_survives_the_file(plane, tmp_path):
    elevation = plane.elevation.copy()
    elevation[0, :3] = np.nan
    Dem(elevation, plane.transform, plane.crs).write(tmp_path / "a.tif")
    np.testing.assert_array_equal(np.isnan(Dem.read(tmp_path / "a.tif").elevation), np.isnan(elevation))


def test_same_dem_same_bytes(plane, tmp_path):
    plane.write(tmp_path / "a.tif")
    plane.write(tmp_path / "b.tif")
    assert (tmp_path / "a.tif").read_bytes() == (tmp_path / "b.tif").read_bytes()


@pytest.mark.parametrize(
    ("elevation", "transform", "crs", "words"),
    [
        ([[1.0]], Affine(1, 0, 0, 0, -1, 0), CRS, "at least 2 × 2"),
        (np.full((3, 3), np.nan), Affine(1, 0, 0, 0, -1, 0), CRS, "no height at all"),
        (np.full((3, 3), np.inf), Affine(1, 0, 0, 0, -1, 0), CRS, "infinite"),
        (np.zeros((3, 3)), Affine.rotation(10) @ Affine(1, 0, 0, 0, -1, 0), CRS, "rotated"),
        (np.zeros((3, 3)), Affine(1, 0, 0, 0, 1, 0), CRS, "no georeference"),
        (np.zeros((3, 3)), Affine(1, 0, 500, 0, 1, 900), CRS, "northern"),
        (np.zeros((3, 3)), Affine(1, 0, 0, 0, -2, 0), CRS, "square"),
        (np.zeros((3, 3)), Affine(1, 0, 0, 0, -1, 0), "EPSG:4326", "metres"),
        (np.zeros((3, 3)), Affine(1, 0, 0, 0, -1, 0), None, "no coordinate reference system"),
        (np.zeros((3, 3)), Affine(1, 0, 0, 0, -1, 0), "EPSG:2225", "foot"),
    ],
)
def test_refusals(elevation, transform, crs, words):
    with pytest.raises(InputError, match=words):
        Dem(elevation, transform, crs)


def test_arrays_are_read_only(plane):
    with pytest.raises(ValueError, match="read-only"):
        plane.elevation[0, 0] = 0.0


def test_real_rasters_are_read_with_their_crs(real_data):
    lidar = Dem.read(real_data / "dem_slovenia_lidar_1m" / "TM1_564_146.tif")
    assert lidar.crs.to_epsg() == 3794
    assert lidar.shape == (1000, 1000)
    with pytest.raises(InputError, match="carries no coordinate reference system"):
        Dem.read(real_data / "dem_landlab_repeat_and_lidar" / "pre_runout_DEM.asc")


def test_a_real_raster_in_degrees_is_warped_to_its_utm_zone(real_data):
    srtm = Dem.read(real_data / "dem_oggm_glaciers" / "hintereisferner_srtm_90m.tif")
    assert srtm.crs.to_epsg() == 32632
    assert 60.0 < srtm.step_m < 95.0
    assert 1000.0 < np.nanmin(srtm.elevation) < np.nanmax(srtm.elevation) < 3800.0

"""Numbers that mean an unknown cell are NaN where they are declared and refused where they are not."""

import numpy as np
import pytest
import rasterio
from affine import Affine
from pyproj import CRS

from survey import Dem, InputError
from survey.io.raster import netcdf_trial

HEIGHTS = 100.0 + np.arange(600.0).reshape(20, 30) / 4.0
PLACE = Affine(10.0, 0.0, 500_000.0, 0.0, -10.0, 6_700_200.0)


def written(path, values, dtype="float32", **profile):
    settings = {"count": 1, "height": 20, "width": 30, "dtype": dtype, **profile}
    with rasterio.open(path, "w", driver="GTiff", crs="EPSG:32608", transform=PLACE, **settings) as target:
        target.write(values.astype(dtype), 1)
    return path


@pytest.mark.parametrize(
    ("mark", "dtype"),
    [
        (-2147483648, "int32"),
        (2147483647, "int32"),
        (65535, "uint16"),
        (4294967295, "uint32"),
        (32767, "int16"),
        (9999, "int16"),
        (9999, "float32"),
        (65535, "float32"),
    ],
)
def test_a_mark_that_is_not_declared_is_refused(tmp_path, mark, dtype):
    values = np.where(HEIGHTS > 240.0, float(mark), HEIGHTS)
    with pytest.raises(InputError, match="not declared as nodata"):
        Dem.read(written(tmp_path / "dem.tif", values, dtype))
    dem = Dem.read(written(tmp_path / "dem.tif", values, dtype, nodata=mark))
    assert np.array_equal(np.isnan(dem.elevation), values == mark)


def test_scaled_numbers_may_be_those_that_are_no_heights_in_metres(tmp_path):
    path = written(tmp_path / "dem.tif", np.where(HEIGHTS > 240.0, 9999.0, HEIGHTS + 9700.0), "int16")
    with rasterio.open(path, "r+") as target:
        target.scales = [0.1]
    assert Dem.read(path).elevation.max() == pytest.approx(999.9)


def netcdf(path, values=HEIGHTS, **attributes):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    axes = {
        "y": ("y", 6_700_195.0 - 10.0 * np.arange(20), {"standard_name": "projection_y_coordinate"}),
        "x": ("x", 500_005.0 + 10.0 * np.arange(30), {"standard_name": "projection_x_coordinate"}),
    }
    z = (("y", "x"), values.astype(np.float32), {"units": "m", "grid_mapping": "crs", **attributes})
    crs = ((), 0, CRS("EPSG:32608").to_cf())
    dataset = xarray.Dataset({"z": z, "crs": crs}, axes)
    dataset.to_netcdf(path, engine="h5netcdf", encoding={"z": {"_FillValue": None}})
    return path


@pytest.mark.parametrize(
    "stated",
    [{"valid_range": np.array([0.0, 1000.0], np.float32)}, {"valid_max": np.float32(1000.0)}],
    ids=["valid_range", "valid_max"],
)
def test_numbers_beyond_the_valid_range_are_unknown(tmp_path, stated):
    values = np.where(HEIGHTS > 240.0, 5555.0, HEIGHTS)
    dem = Dem.read(netcdf(tmp_path / "dem.nc", values, **stated))
    assert np.array_equal(np.isnan(dem.elevation), values == 5555.0)
    assert np.nanmin(dem.elevation) == 100.0


def test_depths_are_refused(tmp_path):
    with pytest.raises(InputError, match="counts downwards"):
        Dem.read(netcdf(tmp_path / "dem.nc", positive="down"))
    written(tmp_path / "dem.tif", HEIGHTS)
    with rasterio.open(tmp_path / "dem.tif", "r+") as target:
        target.crs = "EPSG:32608+5715"
    with pytest.raises(InputError, match="downwards"):
        Dem.read(tmp_path / "dem.tif")


def test_memory_of_the_process_itself_does_not_count_as_that_of_the_file(tmp_path, monkeypatch):
    monkeypatch.setattr(netcdf_trial, "_LARGEST_KIB", 400_000)
    # The peak of a process passes to the processes that it starts.
    assert np.ones(75_000_000).sum() == 75e6
    assert Dem.read(netcdf(tmp_path / "dem.nc", HEIGHTS)).shape == HEIGHTS.shape

"""Rasters that count otherwise than in plain metres are converted or refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from affine import Affine
from pyproj import CRS
from rasterio.enums import ColorInterp
from rasterio.windows import Window

from survey import Dem, InputError
from survey.interchange.conversion import convert
from survey.io.raster import netcdf_trial, open_raster, read_raster, read_window

UTM = "EPSG:32608"
STORED = np.arange(1, 21).reshape(4, 5) * 10


def geotiff(path: Path, stored: Any = STORED, dtype: str = "float32", bands: int = 1, **kw: Any) -> Path:
    tags = {name: kw.pop(name) for name in ("scales", "offsets", "units", "colorinterp") if name in kw}
    shape = dict(zip(("height", "width"), np.shape(stored), strict=True))
    place = Affine(10.0, 0.0, 0.0, 0.0, -10.0, 40.0)
    with rasterio.open(
        path, "w", "GTiff", count=bands, dtype=dtype, crs=UTM, transform=place, **shape, **kw
    ) as file:
        for name, values in tags.items():
            setattr(file, name, values)
        for band in range(1, bands + 1):
            file.write(np.asarray(stored).astype(dtype), band)
    return path


def packed_netcdf(path: Path, x_unit: str = "m") -> Path:
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    axis = {"units": x_unit}
    heights = ("y", "x"), 100.0 + 0.5 * STORED, {"units": "m", "grid_mapping": "crs"}
    dataset = xarray.Dataset(
        {"z": heights, "crs": ((), 0, CRS(UTM).to_cf())},
        {
            "x": ("x", 5.0 + 10.0 * np.arange(5), {"standard_name": "projection_x_coordinate", **axis}),
            "y": ("y", 35.0 - 10.0 * np.arange(4), {"standard_name": "projection_y_coordinate", **axis}),
        },
    )
    packing = {"z": {"dtype": "int16", "scale_factor": 0.1, "add_offset": 50.0, "_FillValue": -32768}}
    dataset.to_netcdf(path, engine="h5netcdf", encoding=packing)
    return path


def test_scale_and_offset_of_a_geotiff_are_applied(tmp_path: Path) -> None:
    file = geotiff(tmp_path / "a.tif", dtype="int16", scales=(0.1,), offsets=(500.0,))
    np.testing.assert_allclose(Dem.read(file).elevation, 500.0 + 0.1 * STORED, rtol=1e-15)


def test_blocks_and_whole_rasters_are_equal(tmp_path: Path) -> None:
    file = geotiff(tmp_path / "a.tif", scales=(0.1,), offsets=(7.0,), units=("ft",))
    with open_raster(file) as source:
        block = read_window(source, 1, Window(1, 1, 2, 2))
    np.testing.assert_array_equal(block, read_raster(file).values[1:3, 1:3])
    np.testing.assert_allclose(block, (7.0 + 0.1 * STORED[1:3, 1:3]) * 0.3048, rtol=1e-14)


def test_a_packed_netcdf_is_read_and_exported_with_its_true_values(tmp_path: Path) -> None:
    convert(packed_netcdf(tmp_path / "a.nc"), tmp_path / "out.tif", "raster")
    np.testing.assert_allclose(Dem.read(tmp_path / "out.tif").elevation, 100.0 + 0.5 * STORED, rtol=1e-6)


@pytest.mark.parametrize(
    ("unit", "metres"),
    [
        ("m", 1.0),
        ("cm", 0.01),
        ("dm", 0.1),
        ("km", 1000.0),
        ("ft", 0.3048),
        ("Foot", 0.3048),
        ("US survey foot", 1200.0 / 3937.0),
    ],
)
def test_units_of_length_become_metres(unit: str, metres: float, tmp_path: Path) -> None:
    found = read_raster(geotiff(tmp_path / "a.tif", units=(unit,))).values
    np.testing.assert_allclose(found, STORED * metres, rtol=1e-15)


def test_nodata_is_compared_before_scaling(tmp_path: Path) -> None:
    stored = STORED.copy()
    stored[0, 0] = -1
    file = geotiff(tmp_path / "a.tif", stored, "int16", nodata=-1, scales=(0.1,))
    assert np.isnan(Dem.read(file).elevation[0, 0])


@pytest.mark.parametrize("unit", ["K", "degree", "hPa", "fathom"])
def test_other_units_are_refused(unit: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"counts in '{unit}'"):
        Dem.read(geotiff(tmp_path / "a.tif", units=(unit,)))


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ({"dtype": "uint8", "bands": 3, "photometric": "RGB"}, "red band"),
        ({"dtype": "uint8", "photometric": "palette"}, "palette band"),
        ({"colorinterp": (ColorInterp.alpha,)}, "alpha band"),
        ({"stored": np.eye(4), "dtype": "uint8", "nbits": 1, "photometric": "MINISBLACK"}, "mask"),
        ({"stored": np.eye(4), "dtype": "uint8"}, "mask"),
        ({"stored": 255 * np.eye(4), "dtype": "uint8"}, "bytes of the values 0 and 255"),
        ({"scales": (0.0,)}, "scale 0"),
    ],
)
def test_pictures_and_masks_are_no_elevations(kind: dict[str, Any], words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        Dem.read(geotiff(tmp_path / "a.tif", **kind))


def test_masks_of_bytes_are_read_where_a_mask_is_asked_for(tmp_path: Path) -> None:
    file = geotiff(tmp_path / "a.tif", np.eye(4), "uint8")
    np.testing.assert_array_equal(Dem.read(file, mask=True).elevation, np.eye(4))


@pytest.mark.parametrize("mark", [-9999.0, -32768.0, -3.4028235e38, 9.96921e36])
def test_marks_of_unknown_cells_that_are_not_declared_are_refused(mark: float, tmp_path: Path) -> None:
    stored = STORED.astype(float)
    stored[1, 1] = mark
    with pytest.raises(InputError, match="not declared as nodata"):
        Dem.read(geotiff(tmp_path / "a.tif", stored))
    known = geotiff(tmp_path / "b.tif", stored, nodata=mark)
    assert np.isnan(Dem.read(known).elevation[1, 1])


def test_coordinates_in_kilometres_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="coordinate x in 'km'"):
        Dem.read(packed_netcdf(tmp_path / "a.nc", "km"))


def test_a_netcdf_that_takes_too_much_memory_on_trial_is_refused(tmp_path: Path, monkeypatch: Any) -> None:
    file = packed_netcdf(tmp_path / "a.nc")
    Dem.read(file)
    monkeypatch.setattr(netcdf_trial, "_LARGEST_KIB", 1000)
    with pytest.raises(InputError, match=r"a\.nc is damaged \(its header claims more memory"):
        Dem.read(file)

"""Conversion of rasters in windows."""

import sys
from pathlib import Path

import numpy as np
import pytest
import rasterio

from survey import Dem, Grid, InputError
from survey.core.errors import CapacityError
from survey.interchange.conversion import convert
from survey.io.raster import large, write_raster

GRID = Grid((500_005.0, 6_500_005.0, 500_475.0, 6_500_355.0), 10.0, "EPSG:32608")


@pytest.fixture
def bands(rng: np.random.Generator) -> dict[str, np.ndarray]:
    heights = rng.normal(100.0, 5.0, GRID.shape)
    heights[3:5, 7:9] = np.nan
    return {"elevation": heights, "standard_deviation": rng.uniform(0.1, 0.2, GRID.shape)}


@pytest.fixture(autouse=True)
def large_from_a_hundred_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["survey.interchange.conversion"], "LARGEST_CELLS", 100)
    monkeypatch.setattr(large, "_WINDOW_CELLS", 512)


def test_a_large_raster_is_written_with_all_bands_in_windows(
    bands: dict[str, np.ndarray], tmp_path: Path
) -> None:
    dem = Dem.on(GRID, bands["elevation"], "EGM2008 height")
    write_raster(tmp_path / "a.tif", bands, dem.transform, dem.crs, dem.vertical_datum)
    with rasterio.open(tmp_path / "a.tif") as written:
        assert written.units == ("m", "m")
    convert(tmp_path / "a.tif", tmp_path / "b.tif", "raster")
    for k, values in enumerate(bands.values(), 1):
        found = Dem.read(tmp_path / "b.tif", band=k)
        np.testing.assert_array_equal(found.elevation, values.astype(np.float32))
    assert found.vertical_datum == dem.vertical_datum
    with rasterio.open(tmp_path / "b.tif") as made:
        assert made.descriptions == tuple(bands)
        assert made.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.tif", "b.tif"]


def test_a_large_raster_is_written_as_ascii_grid(bands: dict[str, np.ndarray], tmp_path: Path) -> None:
    Dem.on(GRID, bands["elevation"]).write(tmp_path / "a.tif")
    convert(tmp_path / "a.tif", tmp_path / "b.asc", "raster")
    found = Dem.read(tmp_path / "b.asc").elevation
    np.testing.assert_array_equal(found, bands["elevation"].astype(np.float32))


@pytest.mark.exhaustive
def test_a_file_that_may_exceed_4_gb_is_bigtiff(tmp_path: Path) -> None:
    profile = {"driver": "GTiff", "height": 22_400, "width": 22_400, "count": 1, "dtype": "float32"}
    tiles = {"tiled": True, "blockxsize": 512, "blockysize": 512, "sparse_ok": True, "nodata": -9999.0}
    place = {"crs": "EPSG:32608", "transform": rasterio.Affine(1.0, 0.0, 500_000.0, 0.0, -1.0, 6_500_000.0)}
    rasterio.open(tmp_path / "a.tif", "w", **profile, **tiles, **place).close()
    large._copy(tmp_path / "a.tif", tmp_path / "b.tif", large._LARGE_COG_OPTIONS)
    with (tmp_path / "b.tif").open("rb") as file:
        assert file.read(4) == b"II+\0"


def test_what_is_written_in_one_part_is_refused(bands: dict[str, np.ndarray], tmp_path: Path) -> None:
    dem = Dem.on(GRID, bands["elevation"])
    write_raster(tmp_path / "a.tif", bands, dem.transform, dem.crs)
    with pytest.raises(CapacityError, match="NetCDF is written in one part"):
        convert(tmp_path / "a.tif", tmp_path / "b.nc", "raster")
    with pytest.raises(InputError, match="one band"):
        convert(tmp_path / "a.tif", tmp_path / "b.asc", "raster")
    assert [file.name for file in tmp_path.iterdir()] == ["a.tif"]

"""A GeoTIFF whose CRS was changed by a flipped bit is refused."""

from pathlib import Path

import numpy as np
import pytest
import rasterio

from survey import Dem, Grid, InputError

BOUNDS = (500_000.0, 6_700_000.0, 500_040.0, 6_700_040.0)


@pytest.mark.parametrize("bit", range(16))
def test_a_flipped_bit_of_the_code_is_refused(tmp_path: Path, bit: int) -> None:
    grid = Grid(BOUNDS, 5.0, "EPSG:32608")
    path = tmp_path / "dem.tif"
    Dem.on(grid, np.arange(81.0).reshape(9, 9)).write(path)
    content = bytearray(path.read_bytes())
    content[content.index((32608).to_bytes(2, "little")) + bit // 8] ^= 1 << bit % 8
    path.write_bytes(bytes(content))
    with pytest.raises(InputError):
        Dem.read(path)


@pytest.mark.parametrize(
    "crs", ["EPSG:32608", "EPSG:3413", "EPSG:2056", "EPSG:3857", "EPSG:25832", "ESRI:102025"]
)
@pytest.mark.parametrize("datum", ["", "EGM96 height"])
def test_a_crs_comes_back(tmp_path: Path, crs: str, datum: str) -> None:
    dem = Dem.on(Grid(BOUNDS, 5.0, crs), np.zeros((9, 9)), datum)
    dem.write(tmp_path / "dem.tif")
    with rasterio.open(tmp_path / "dem.tif") as source:
        assert source.tags()["FIRNLINE_CRS"] == crs
    assert Dem.read(tmp_path / "dem.tif").crs.equals(dem.crs, ignore_axis_order=True)

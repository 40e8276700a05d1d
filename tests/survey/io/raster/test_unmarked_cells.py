"""Cells that hold a number for nodata which no file declares are refused; real ground is not."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from affine import Affine

from survey import Dem, InputError


def glacier(path: Path, filled: float, *, n_cells: int = 12, **kw: Any) -> Path:
    """Write 30 x 30 cells of 10 m between 800 and 890 m, the first of them filled with a number."""
    heights = 800.0 + np.add.outer(np.arange(30.0), 2.0 * np.arange(30.0))
    heights.ravel()[:n_cells] = filled
    place = Affine(10.0, 0.0, 500_000.0, 0.0, -10.0, 6_700_300.0)
    options = {"crs": "EPSG:32608", "transform": place, "dtype": "float32"} | kw
    with rasterio.open(path, "w", "GTiff", width=30, height=30, count=1, **options) as file:
        file.write(heights.astype(options["dtype"]), 1)
    return path


@pytest.mark.parametrize("number", [0.0, -1.0, -99.0, -999.0, -10_000.0, -9999.9, 10_000.0])
def test_a_repeated_number_far_from_all_others_is_refused(tmp_path: Path, number: float) -> None:
    with pytest.raises(InputError, match=rf"a\.tif holds 12 cells of exactly {number:g} m.*make it nodata"):
        Dem.read(glacier(tmp_path / "a.tif", number))


def test_whole_metres_and_degrees_are_checked_too(tmp_path: Path) -> None:
    whole = glacier(tmp_path / "a.tif", 0.0, dtype="int16")
    degrees = Affine(2e-4, 0.0, -135.0, 0.0, -1e-4, 60.0)
    for file in (whole, glacier(tmp_path / "b.tif", 0.0, crs="EPSG:4326", transform=degrees)):
        with pytest.raises(InputError, match="cells of exactly 0 m"):
            Dem.read(file)


def test_a_declared_number_passes(tmp_path: Path) -> None:
    dem = Dem.read(glacier(tmp_path / "a.tif", 0.0, nodata=0.0))
    assert np.isnan(dem.elevation).sum() == 12


def test_a_lake_a_pit_of_one_cell_and_cells_of_kilometres_pass(tmp_path: Path) -> None:
    coarse = Affine(2000.0, 0.0, 500_000.0, 0.0, -2000.0, 6_700_300.0)
    assert Dem.read(glacier(tmp_path / "lake.tif", 750.0)).elevation.min() == 750.0
    assert Dem.read(glacier(tmp_path / "pit.tif", 0.0, n_cells=1)).elevation.min() == 0.0
    assert Dem.read(glacier(tmp_path / "coarse.tif", 0.0, transform=coarse)).elevation.min() == 0.0


@pytest.mark.parametrize(("number", "n_cells"), [(0.0, 450), (700.0, 450), (880.0, 450), (780.0, 300)])
def test_one_height_in_many_cells_beside_a_jump_is_named(
    tmp_path: Path, number: float, n_cells: int, caplog: pytest.LogCaptureFixture
) -> None:
    coarse = Affine(900.0, 0.0, 500_000.0, 0.0, -900.0, 6_700_300.0)
    file = glacier(tmp_path / "a.tif", number, n_cells=n_cells, transform=coarse)
    assert (Dem.read(file).elevation == number).sum() >= n_cells
    assert f"a.tif holds exactly {number:g} m in {100 * n_cells // 900}% of its cells" in caplog.text
    assert f"gdal_edit.py -a_nodata {number:g}" in caplog.text


def test_water_that_meets_its_shore_is_not_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for name, level in (("sea.tif", 827.0), ("even.tif", 2000.0)):
        file = glacier(tmp_path / name, 0.0, n_cells=0)
        with rasterio.open(file, "r+") as raster:
            raster.write(np.maximum(raster.read(1), level), 1)
        Dem.read(file)
    assert caplog.text == ""


@pytest.mark.parametrize(
    ("factor", "words"), [(1000.0, "about 824,500"), (-1000.0, "about -824,500"), (15.0, "about 12,368")]
)
def test_elevations_beyond_all_ground_are_refused(tmp_path: Path, factor: float, words: str) -> None:
    elevation = factor * (810.0 + np.arange(30.0).reshape(5, 6))
    file = tmp_path / "dem.tif"
    profile = {"height": 5, "width": 6, "count": 1, "dtype": "int32", "crs": "EPSG:32608"}
    with rasterio.open(
        file, "w", driver="GTiff", transform=Affine(5, 0, 5e5, 0, -5, 67e5), **profile
    ) as raster:
        raster.write(elevation.astype("int32"), 1)
    with pytest.raises(InputError, match=rf"{words}.* state the unit or the scale of its numbers"):
        Dem.read(file)
    with rasterio.open(file, "r+") as raster:
        raster.scales = [1.0 / factor]
    assert Dem.read(file).elevation[0, 0] == pytest.approx(810.0)

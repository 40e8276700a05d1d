"""Rasters of categories with their names."""

from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine
from pyproj import CRS

from survey.core.errors import InputError
from survey.io.raster.writing import read_codes, write_categories

PLACE = Affine(10.0, 0.0, 500_000.0, 0.0, -10.0, 6_700_000.0)
UTM = CRS.from_epsg(32608)


def test_codes_and_names_come_back(tmp_path: Path) -> None:
    codes = np.array([[0, 1, 2], [2, 1, 0]], dtype=np.uint8)
    write_categories(
        tmp_path / "cover.tif", codes, ("ice", "snow", "rock & debris"), transform=PLACE, crs=UTM
    )
    found = read_codes(tmp_path / "cover.tif")
    np.testing.assert_array_equal(found.values, codes)
    assert (found.transform, found.crs.to_epsg()) == (PLACE, 32608)
    names = (tmp_path / "cover.tif.aux.xml").read_text(encoding="utf-8")
    assert "<Category>rock &amp; debris</Category>" in names


def raster_of(file: Path, values: np.ndarray, **facts: object) -> Path:
    height, width = values.shape
    profile = {"driver": "GTiff", "height": height, "width": width, "count": 1, "dtype": values.dtype.name}
    with rasterio.open(file, "w", **profile, transform=PLACE, **facts) as target:
        target.write(values, 1)
    return file


def test_the_code_of_no_category_is_that_of_the_file(tmp_path: Path) -> None:
    file = raster_of(tmp_path / "a.tif", np.ones((2, 2), np.int16), crs="EPSG:32608", nodata=-1)
    assert read_codes(file).unknown == -1


def test_decimals_are_no_codes(tmp_path: Path) -> None:
    file = raster_of(tmp_path / "a.tif", np.ones((2, 2), np.float32), crs="EPSG:32608")
    with pytest.raises(InputError, match="holds numbers with decimals"):
        read_codes(file)


def test_a_raster_of_classes_needs_a_crs(tmp_path: Path) -> None:
    file = raster_of(tmp_path / "a.tif", np.ones((2, 2), np.uint8))
    with pytest.raises(InputError, match="carries no coordinate reference system"):
        read_codes(file)

"""Large rasters are refused by their headers, or read where they are needed."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine

from survey import Dem, InputError
from survey.core.errors import CapacityError
from survey.io.raster import LARGEST_CELLS, open_raster, raster_facts, read_raster, sigma_band

UTM = "EPSG:32608"


def sparse(path: Path, side: int = 12_600) -> Path:
    """Write a raster of 158 million cells of which one block exists, in some 30 kB."""
    profile = {"height": side, "width": side, "count": 1, "dtype": "float32", "nodata": -1.0, "crs": UTM}
    options = {"sparse_ok": True, "tiled": True, "compress": "deflate"}
    place = Affine(1.0, 0.0, 0.0, 0.0, -1.0, float(side))
    with rasterio.open(path, "w", driver="GTiff", transform=place, **profile, **options) as target:
        rows = np.arange(256.0, dtype=np.float32)[:, None]
        target.write(rows + np.zeros((1, 256), dtype=np.float32), 1, window=((512, 768), (512, 768)))
    return path


def test_a_large_sparse_raster_is_refused_by_its_header(tmp_path: Path) -> None:
    file = sparse(tmp_path / "a.tif")
    assert file.stat().st_size < 200_000
    tracemalloc.start()
    with pytest.raises(CapacityError, match=f"{LARGEST_CELLS:,} can be read at once"):
        Dem.read(file)
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()
    assert raster_facts(file).shape == (12_600, 12_600)


def test_of_a_large_raster_the_cells_over_an_area_are_read(tmp_path: Path) -> None:
    file = sparse(tmp_path / "a.tif")
    west, north = 600.0, 12_600.0 - 600.0
    dem = Dem.read(file, bounds=(west, north - 10.0, west + 20.0, north))
    assert dem.shape == (12, 22)
    assert dem.bounds == (west - 1.0, north - 11.0, west + 21.0, north + 1.0)
    # Row 600 of the raster is row 88 of the block.
    assert dem.at([[west + 0.5, north - 0.5]]) == [88.0]


def test_a_window_equals_the_same_cells_of_the_whole(tmp_path: Path) -> None:
    file = sparse(tmp_path / "a.tif", 1200)
    bounds = (600.3, 500.2, 640.9, 560.7)
    whole, part = Dem.read(file), Dem.read(file, bounds=bounds)
    xy = np.random.default_rng(0).uniform(bounds[:2], bounds[2:], (100, 2))
    # The origin of the cells differs, and with it the last digit of their distances.
    np.testing.assert_allclose(part.at(xy), whole.at(xy), rtol=1e-13)


def test_bounds_beside_the_raster_are_refused(tmp_path: Path) -> None:
    file = sparse(tmp_path / "a.tif", 1200)
    for bounds in ((-50.0, 0.0, -10.0, 20.0), (0.0, 5000.0, 10.0, 5010.0)):
        with pytest.raises(InputError, match="lies elsewhere"):
            read_raster(file, bounds=bounds)


def test_lack_of_memory_is_no_damage(tmp_path: Path) -> None:
    file = sparse(tmp_path / "a.tif", 1200)
    with pytest.raises(CapacityError, match="memory"), open_raster(file):
        raise MemoryError


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.img", "a"])
def test_other_suffixes_name_the_known_ones(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"x")
    with pytest.raises(InputError, match=r"\.tif"):
        read_raster(tmp_path / name)


def test_coordinates_beyond_the_earth_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="none on Earth"):
        Dem(np.zeros((2, 2)), Affine(1.0, 0.0, 1e300, 0.0, -1.0, 0.0), UTM)


def south_up(path: Path, elevation: np.ndarray, transform: Affine) -> Path:
    rows, columns = elevation.shape
    turned = transform @ Affine.translation(0, rows) @ Affine.scale(1.0, -1.0)
    profile = {"height": rows, "width": columns, "count": 1, "dtype": "float64"}
    with rasterio.open(path, "w", driver="GTiff", crs="EPSG:32608", transform=turned, **profile) as file:
        file.write(elevation[::-1], 1)
    return path


def test_a_raster_whose_first_row_is_the_southern_one_is_read_from_north_to_south(tmp_path: Path) -> None:
    elevation = 800.0 + np.arange(42.0).reshape(6, 7)
    north_up = Affine(5.0, 0.0, 500_000.0, 0.0, -5.0, 6_700_030.0)
    file = south_up(tmp_path / "south.tif", elevation, north_up)
    dem = Dem.read(file)
    assert dem.transform.almost_equals(north_up)
    np.testing.assert_array_equal(dem.elevation, elevation)
    window = Dem.read(file, bounds=(500_012.0, 6_700_012.0, 500_014.0, 6_700_014.0))
    assert window.shape[0] < 6
    np.testing.assert_array_equal(window.at([[500_013.0, 6_700_013.0]]), dem.at([[500_013.0, 6_700_013.0]]))
    with pytest.raises(InputError, match="reaches from 500000, 6700000 to 500035, 6700030"):
        Dem.read(file, bounds=(0.0, 0.0, 5.0, 5.0))


def test_a_raster_without_a_georeference_is_not_taken_for_one_from_south_to_north(tmp_path: Path) -> None:
    file = tmp_path / "none.tif"
    with (
        pytest.warns(rasterio.errors.NotGeoreferencedWarning),
        rasterio.open(
            file, "w", driver="GTiff", height=4, width=4, count=1, dtype="float64", crs="EPSG:32608"
        ) as raster,
    ):
        raster.write(np.arange(16.0).reshape(4, 4), 1)
    with pytest.raises(InputError, match="no georeference"):
        Dem.read(file)


@pytest.mark.parametrize(
    ("name", "band"),
    [
        ("sigma", 2),
        ("Standard deviation", 2),
        ("elevation_error", 2),
        (None, 2),
        ("slope", None),
        ("StdDev", 2),
        ("sigma_m", 2),
        ("terrain", None),
        ("device", None),
        ("n_points", None),
    ],
)
def test_a_second_band_is_a_standard_deviation_unless_its_name_says_otherwise(
    tmp_path: Path, name: str | None, band: int | None
) -> None:
    profile = {"height": 4, "width": 4, "count": 2, "dtype": "float32", "crs": UTM}
    place = Affine(1.0, 0.0, 0.0, 0.0, -1.0, 4.0)
    with rasterio.open(tmp_path / "a.tif", "w", driver="GTiff", transform=place, **profile) as target:
        target.write(np.ones((2, 4, 4), dtype=np.float32))
        target.set_band_description(1, "elevation")
        if name is not None:
            target.set_band_description(2, name)
    assert sigma_band(tmp_path / "a.tif") == band

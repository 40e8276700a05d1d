"""Elevation rasters in degrees: the CRS that is chosen, heights after the warp, voids, datum, and what is logged."""

import logging
from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine
from pyproj import Transformer

from survey import Dem
from survey.core.errors import InputError

SECOND = 1.0 / 3600.0


def ground(longitude: np.ndarray, latitude: np.ndarray) -> np.ndarray:
    """Hills of 140 m relief, some 700 m apart."""
    east = np.deg2rad(longitude) * np.cos(np.deg2rad(latitude))
    return (
        500.0
        + 40.0 * np.sin(np.deg2rad(latitude) * 6_371_000.0 * 2.0 * np.pi / 700.0)
        + 30.0 * np.cos(east * 6_371_000.0 * 2.0 * np.pi / 800.0)
    )


def degrees_raster(
    path: Path,
    middle: tuple[float, float],
    cell: tuple[float, float] = (SECOND, SECOND),
    *,
    shape: tuple[int, int] = (80, 80),
    crs: str | None = "EPSG:4326",
    void: bool = False,
    dtype: str = "float32",
) -> Path:
    transform = Affine(
        cell[0], 0.0, middle[0] - shape[1] / 2 * cell[0], 0.0, -cell[1], middle[1] + shape[0] / 2 * cell[1]
    )
    columns, rows = np.meshgrid(np.arange(shape[1]) + 0.5, np.arange(shape[0]) + 0.5)
    longitude, latitude = transform @ (columns, rows)
    heights = ground(longitude, latitude).astype(dtype)
    if void:
        heights[30:45, 35:60] = -9999
    profile = {"driver": "GTiff", "count": 1, "dtype": dtype, "nodata": -9999, "crs": crs}
    with rasterio.open(path, "w", height=shape[0], width=shape[1], transform=transform, **profile) as target:
        target.write(heights, 1)
    return path


def error_of(dem: Dem, middle_deg: float) -> np.ndarray:
    """Return warped heights less those of the ground at the same places [m]."""
    longitude, latitude = Transformer.from_crs(dem.crs, "EPSG:4326", always_xy=True).transform(*dem.xy.T)
    longitude = (np.asarray(longitude) - middle_deg + 180.0) % 360.0 - 180.0 + middle_deg
    return dem.elevation - ground(longitude, np.asarray(latitude)).reshape(dem.shape)


@pytest.mark.parametrize(
    ("middle", "cell", "epsg", "rms_m"),
    [
        ((-134.5, 58.4), (1.5 * SECOND, SECOND), 32608, 0.3),  # Copernicus GLO-30 at this latitude
        ((10.5, 46.8), (SECOND, SECOND), 32632, 0.3),  # SRTM, 1 arc-second
        ((10.5, 46.8), (3.0 * SECOND, 3.0 * SECOND), 32632, 1.0),  # SRTM, 3 arc-seconds
        ((170.1, -43.5), (SECOND, SECOND), 32759, 0.3),
        ((-138.001, 60.5), (2.0 * SECOND, SECOND), 32607, 0.5),  # cells in two zones, the middle in 7
        ((-137.999, 60.5), (2.0 * SECOND, SECOND), 32608, 0.5),
        ((30.0, 84.5), (5.0 * SECOND, SECOND), 3413, 0.3),
        ((160.0, -80.5), (5.0 * SECOND, SECOND), 3031, 0.7),
        ((225.5, 58.4), (1.5 * SECOND, SECOND), 32608, 0.5),  # longitudes from 0 to 360
        ((180.0, -17.0), (SECOND, SECOND), 32701, 0.3),  # across 180 degrees
    ],
)
def test_heights_are_those_of_the_ground_in_the_chosen_zone(tmp_path, middle, cell, epsg, rms_m):
    dem = Dem.read(degrees_raster(tmp_path / "a.tif", middle, cell))
    assert dem.crs.to_epsg() == epsg
    error = error_of(dem, middle[0])
    assert np.sqrt(np.nanmean(error**2)) < rms_m
    assert np.isfinite(error).sum() * dem.step_m**2 > 0.95 * 80 * 80 * cell[0] * cell[
        1
    ] * 111_000.0**2 * np.cos(np.deg2rad(middle[1]))


def test_cubic_interpolation_is_taken_unless_cells_are_much_coarser(tmp_path, caplog):
    with caplog.at_level(logging.WARNING):
        dem = Dem.read(degrees_raster(tmp_path / "square.tif", (10.5, 46.8)))
        Dem.read(degrees_raster(tmp_path / "narrow.tif", (20.0, 72.0)))
    assert dem.step_m == 26.0  # 21 by 31 m
    first, second = (record.getMessage() for record in caplog.records)
    assert first == (
        f"{tmp_path / 'square.tif'} is in degrees (WGS 84); it is warped to WGS 84 / UTM zone 32N, cells of 26 m, "
        "cubic interpolation."
    )
    # 9.6 m by 31 m: square cells of 17 m would alias the narrow ones.
    assert "cells of 17 m, bilinear interpolation" in second


def test_voids_stay_voids_and_do_not_reach_further(tmp_path):
    source = degrees_raster(tmp_path / "a.tif", (-134.5, 58.4), (1.5 * SECOND, SECOND), void=True)
    dem = Dem.read(source)
    to_degrees = Transformer.from_crs(dem.crs, "EPSG:4326", always_xy=True)
    with rasterio.open(source) as raster:
        column, row = ~raster.transform @ np.array(to_degrees.transform(*dem.xy.T))
    in_void = (column > 35) & (column < 60) & (row > 30) & (row < 45)
    beside = (column > 34) & (column < 61) & (row > 29) & (row < 46)
    inside = (column > 0) & (column < 80) & (row > 0) & (row < 80)
    known = np.isfinite(dem.elevation).ravel()
    assert not known[in_void].any()
    assert known[inside & ~beside].all()
    assert np.nanmax(np.abs(error_of(dem, -134.5))) < 4.0  # no height is invented beside a void


@pytest.mark.parametrize(
    ("crs", "name", "datum"),
    [
        ("EPSG:4326+5773", "WGS 84 / UTM zone 8N", "EGM96 height"),
        ("EPSG:9518", "WGS 84 / UTM zone 8N", "EGM2008 height"),  # as Copernicus states it
        ("EPSG:4269", "NAD83 / UTM zone 8N", ""),
        ("EPSG:4979", "WGS 84 / UTM zone 8N", "ellipsoidal height"),
    ],
)
def test_geodetic_and_vertical_datum_are_those_of_the_file(tmp_path, crs, name, datum):
    source = degrees_raster(tmp_path / "a.tif", (-134.5, 58.4), (1.5 * SECOND, SECOND), crs=crs)
    dem = Dem.read(source)
    assert (dem.crs.name, dem.vertical_datum) == (name, datum)
    assert np.sqrt(np.nanmean(error_of(dem, -134.5) ** 2)) < 1.0


def test_a_window_has_the_cells_of_the_complete_raster(tmp_path):
    source = degrees_raster(tmp_path / "a.tif", (10.5, 46.8))
    complete = Dem.read(source)
    xmin, ymin, xmax, ymax = complete.bounds
    part = Dem.read(source, bounds=(xmin + 500.0, ymin + 600.0, xmax - 700.0, ymax - 800.0))
    assert part.step_m == complete.step_m
    assert part.shape < complete.shape
    same = complete.window(part.bounds)
    np.testing.assert_allclose(part.elevation, same.elevation, atol=0.15)


def test_a_named_projected_crs_is_the_target(tmp_path):
    source = degrees_raster(tmp_path / "a.tif", (10.5, 46.8))
    dem = Dem.read(source, crs="EPSG:31254", bounds=None)
    assert dem.crs.to_epsg() == 31254
    without = degrees_raster(tmp_path / "b.tif", (10.5, 46.8), crs=None)
    assert Dem.read(without, crs="EPSG:4326").crs.to_epsg() == 32632


def test_a_mask_in_degrees_has_its_values_only(tmp_path):
    path = tmp_path / "mask.tif"
    cells = np.zeros((40, 40), dtype=np.uint8)
    cells[10:20, 10:20] = 1
    place = Affine(SECOND, 0.0, 10.5, 0.0, -SECOND, 46.8)
    with rasterio.open(path, "w", driver="GTiff", height=40, width=40, count=1, dtype="uint8", crs="EPSG:4326", transform=place) as target:  # fmt: skip
        target.write(cells, 1)
    mask = Dem.read(path, mask=True)
    values = mask.elevation[np.isfinite(mask.elevation)]
    assert set(np.unique(values)) == {0.0, 1.0}
    assert values.mean() == pytest.approx(100 / 1600, rel=0.1)


def test_bounds_elsewhere_are_refused(tmp_path):
    source = degrees_raster(tmp_path / "a.tif", (10.5, 46.8))
    with pytest.raises(InputError, match="lies elsewhere"):
        Dem.read(source, crs="EPSG:32632", bounds=(0.0, 0.0, 1000.0, 1000.0))

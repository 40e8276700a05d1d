"""Levels of the terrain: means of cells, windows beyond the edge, rasters larger than memory."""

from pathlib import Path

import numpy as np
import pytest

from desk.terrain import pyramid as module
from desk.terrain.pyramid import ElevationPyramid, block_means
from desk.terrain.shading import DEVIATION, ELEVATION, SLOPE
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.grid import Grid


@pytest.fixture
def large(tmp_path: Path) -> Path:
    """Raster of 300 × 520 cells."""
    grid = Grid((0.0, 0.0, 2 * 519.0, 2 * 299.0), 2.0, "EPSG:3413")
    rng = np.random.default_rng(4)
    Dem.on(grid, rng.normal(100.0, 5.0, grid.shape)).write(tmp_path / "large.tif")
    return tmp_path / "large.tif"


def test_levels_read_from_the_file_equal_those_in_memory(large, monkeypatch):
    with ElevationPyramid(large) as whole:
        expected = [whole.window(k, -2, 3, 40, 50) for k in range(3)]
        assert whole.base == 0
        assert whole.coarsest == 2
    monkeypatch.setattr(module, "_MOST_CELLS_IN_MEMORY", 12_000)
    monkeypatch.setattr(module, "_STRIP_CELLS", 3_000)
    with ElevationPyramid(large) as cut:
        assert cut.base == 2
        for k in range(3):
            np.testing.assert_allclose(cut.window(k, -2, 3, 40, 50), expected[k], rtol=1e-12)


def test_a_level_has_the_mean_of_the_raster(large):
    with ElevationPyramid(large) as pyramid:
        assert pyramid.level(1).mean() == pytest.approx(pyramid.level(0).mean())
        assert pyramid.level(1).shape == (150, 260)


def test_windows_beyond_the_raster_are_unknown(large):
    with ElevationPyramid(large) as pyramid:
        assert np.isnan(pyramid.window(0, 1000, 0, 4, 4)).all()
        assert np.isnan(pyramid.window(0, -4, -4, 4, 4)).all()


def test_a_part_has_few_enough_cells_and_its_place(large):
    with ElevationPyramid(large) as pyramid:
        part = pyramid.over((100.0, 50.0, 700.0, 300.0), 3_000)
        assert part.heights.size <= 3_000
        assert part.west <= 100.0 < part.west + part.cell_m
        assert part.north - part.heights.shape[0] * part.cell_m <= 50.0
        outside = pyramid.over((-900.0, 0.0, -800.0, 10.0), 3_000)
        assert outside.heights.shape == (6, 1)


def test_means_of_uneven_sizes_leave_unknown_cells_out():
    values = np.array([[1.0, np.nan, 4.0], [3.0, np.nan, 6.0], [np.nan, np.nan, 8.0]])
    np.testing.assert_array_equal(block_means(values, 2), [[2.0, 5.0], [np.nan, 8.0]])


def test_a_raster_without_a_crs_is_refused(tmp_path):
    (tmp_path / "bare.asc").write_text("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2\n3 4\n")
    with pytest.raises(InputError, match="no coordinate reference system"):
        ElevationPyramid(tmp_path / "bare.asc")


def test_the_colours_are_those_of_the_figures():
    from cmcrameri import cm

    from survey.figures import style

    shares = np.linspace(0.0, 1.0, 256)
    for table, colours in (
        (ELEVATION, style.ELEVATION),
        (DEVIATION, style.DEVIATION),
        (SLOPE, cm.lajolla_r),
    ):
        assert np.abs(table - colours(shares)[:, :3] * 255.0).max() < 5.0

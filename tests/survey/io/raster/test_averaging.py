"""Averages of rasters in strips of rows."""

from pathlib import Path

import numpy as np
import pytest

from survey import Dem, Grid
from survey.io.raster import large
from survey.io.raster.large import read_averaged

GRID = Grid((500_005.0, 6_500_005.0, 500_475.0, 6_500_355.0), 10.0, "EPSG:32608")


@pytest.fixture
def file(tmp_path: Path, rng: np.random.Generator) -> Path:
    heights = rng.normal(100.0, 5.0, GRID.shape).astype(np.float32).astype(np.float64)
    heights[:6, :6] = np.nan
    Dem.on(GRID, heights).write(tmp_path / "a.tif")
    return tmp_path / "a.tif"


def test_the_average_of_a_square_is_that_of_its_cells(file: Path) -> None:
    (found,) = read_averaged(file, 4)
    dem = Dem.read(file)
    for row, column in ((3, 4), (7, 9)):
        west, north = found.transform @ (column, row)
        inside = (np.abs(dem.x - west - 20.0) < 20.0), (np.abs(dem.y - north + 20.0) < 20.0)
        assert inside[0].sum() == inside[1].sum() == 4
        assert found.values[row, column] == pytest.approx(dem.elevation[np.ix_(inside[1], inside[0])].mean())
    assert found.transform.a == 40.0
    assert (np.isnan(found.values[0, 0]), np.isfinite(found.values[2, 2])) == (True, True)


def test_squares_of_two_rasters_with_the_same_cells_are_the_same(file: Path, tmp_path: Path) -> None:
    dem = Dem.read(file)
    part = Dem.on(
        Grid((500_065.0, 6_500_005.0, 500_475.0, 6_500_285.0), 10.0, GRID.crs), dem.elevation[7:, 6:]
    )
    part.write(tmp_path / "b.tif")
    (whole,), (cut,) = read_averaged(file, 4), read_averaged(tmp_path / "b.tif", 4)
    shift = (np.array(cut.transform @ (0, 0)) - whole.transform @ (0, 0)) / 40.0
    assert shift == pytest.approx(np.round(shift))
    column, row = round(shift[0]), round(-shift[1])
    np.testing.assert_allclose(cut.values[1:, 1:], whole.values[row + 1 :, column + 1 :])


def test_strips_of_rows_do_not_change_the_averages(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (at_once,) = read_averaged(file, 3)
    monkeypatch.setattr(large, "_CELLS_AT_ONCE", 300)
    (in_strips,) = read_averaged(file, 3)
    np.testing.assert_array_equal(at_once.values, in_strips.values)

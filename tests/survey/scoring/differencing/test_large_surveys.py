"""Changes of surveys that are averaged first."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from survey import Dem, Grid, Reconstruction
from survey.io.raster import write_raster
from survey.scoring.differencing import change_files
from survey.scoring.differencing.change_files import average_survey, averaged_step_m
from survey.scoring.differencing.difference import change

GRID = Grid((500_001.0, 6_500_001.0, 500_399.0, 6_500_399.0), 2.0, "EPSG:32608")
ICE = shapely.Point(500_200.0, 6_500_200.0).buffer(90.0)


@pytest.fixture
def surveys(tmp_path: Path, rng: np.random.Generator) -> list[Path]:
    """Return two surveys with standard deviations, between which the ice sank by 3 m."""
    files = []
    sunk = shapely.contains_xy(ICE, *GRID.xy.T).reshape(GRID.shape) * 3.0
    for name, loss in (("later", sunk), ("earlier", 0.0 * sunk)):
        dem = Dem.on(GRID, 100.0 - loss + 0.2 * rng.standard_normal(GRID.shape))
        bands = {"elevation": dem.elevation, "standard_deviation": np.full(GRID.shape, 0.2)}
        write_raster(tmp_path / f"{name}.tif", bands, dem.transform, dem.crs)
        files.append(tmp_path / f"{name}.tif")
    return files


def test_small_surveys_are_compared_cell_by_cell(surveys: list[Path]) -> None:
    assert averaged_step_m(surveys) is None


def test_the_volume_between_averaged_surveys_is_that_between_their_cells(
    surveys: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(change_files, "LARGEST_CELLS", 10_000)
    monkeypatch.setattr(change_files, "_AVERAGED_CELLS", 5_000)
    step_m = averaged_step_m(surveys)
    assert step_m is not None
    later, earlier = (average_survey(file, step_m) for file in surveys)
    assert isinstance(later, Reconstruction)
    assert later.mean.step_m == 6.0
    averaged = change(later, earlier, {"ice": ICE}).volumes[0]
    exact = change(*(Dem.read(file) for file in surveys), {"ice": ICE}).volumes[0]
    assert averaged.volume_m3 == pytest.approx(exact.volume_m3, rel=0.02)
    assert abs(averaged.mean_m + 3.0) < 0.1

"""Means: what the surface is expected to be."""

import numpy as np
import pytest

from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.reconstruction.gp.mean import DemMean, FunctionMean

GRID = Grid((0.0, 0.0, 300.0, 300.0), 75.0, "EPSG:32608")
PLACES = np.array([[10.0, 20.0], [150.0, 160.0]])


@pytest.mark.parametrize("interpolation", ["bilinear", "delaunay"])
def test_a_plane_is_read_exactly(interpolation: str) -> None:
    east, north = np.meshgrid(GRID.x, GRID.y)
    mean = DemMean(Dem.on(GRID, 0.1 * east - 0.2 * north), interpolation)
    np.testing.assert_allclose(mean.at(PLACES), 0.1 * PLACES[:, 0] - 0.2 * PLACES[:, 1], atol=1e-9)
    np.testing.assert_allclose(mean.gradient(PLACES), [[0.1, -0.2]] * 2, atol=1e-9)


def test_a_prior_with_a_hole_is_refused_where_it_is_needed() -> None:
    heights = np.zeros(GRID.shape)
    heights[2, 2] = np.nan
    mean = DemMean(Dem.on(GRID, heights))
    assert mean.at(PLACES[:1]).tolist() == [0.0]
    with pytest.raises(InputError, match=r"does not cover 1 of 2 places.*\(150\.0, 160\.0\)"):
        mean.at(PLACES)


def test_a_function_must_give_a_finite_height_for_every_place() -> None:
    with pytest.raises(InputError, match="2 places"):
        FunctionMean(lambda xy: np.full(len(xy), np.nan)).at(PLACES)
    with pytest.raises(InputError, match="2 places"):
        FunctionMean(lambda _: np.zeros(5)).at(PLACES)


def test_the_slope_beside_a_void_is_that_of_the_side_with_heights():
    grid = Grid((0.0, 0.0, 40.0, 40.0), 10.0, "EPSG:32608")
    heights = 0.3 * grid.xy[:, 0].reshape(grid.shape)
    heights[:, 0] = np.nan
    dem = Dem.on(grid, heights)
    known = dem.xy[np.isfinite(dem.elevation).ravel()]
    np.testing.assert_allclose(DemMean(dem).gradient(known), np.tile([0.3, 0.0], (len(known), 1)), atol=1e-9)

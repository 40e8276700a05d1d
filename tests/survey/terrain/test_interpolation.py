"""The satellite's view, the smooth surface through it, and the real sample."""

import numpy as np
import pytest
from pyproj import CRS, Transformer

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.terrain import random_dem, satellite_copy
from survey.terrain.real import real_sample, sample_site
from survey.terrain.satellite import smooth_interpolation


def plane(grid: Grid) -> Dem:
    return Dem.on(grid, 100.0 + 0.1 * grid.x[None, :] - 0.2 * grid.y[:, None], "EGM96 height")


def test_satellite_sees_the_mean_of_each_cell_between_the_outer_nodes() -> None:
    copy = satellite_copy(
        plane(Grid((0.0, 0.0, 600.0, 600.0), 1.0)), rng=np.random.default_rng(1), sigma_m=0.0
    )
    assert copy.shape == (8, 8)
    assert copy.bounds == (0.0, 0.0, 600.0, 600.0)
    assert copy.vertical_datum == "EGM96 height"
    # The mean of a plane is its height at the cell's centre.
    np.testing.assert_allclose(copy.elevation, plane(copy.grid()).elevation, rtol=1e-12)


def test_satellite_takes_the_cells_edges_when_those_divide() -> None:
    lidar = plane(Grid((0.5, 0.5, 599.5, 599.5), 1.0))
    copy = satellite_copy(lidar, rng=np.random.default_rng(1), sigma_m=0.0)
    assert copy.bounds == (0.0, 0.0, 600.0, 600.0)
    np.testing.assert_allclose(copy.elevation, lidar.block_mean(75.0).elevation, rtol=1e-12)


def test_satellite_noise_is_white_and_remembered() -> None:
    flat = Dem.on(Grid((0.0, 0.0, 3200.0, 3200.0), 20.0), np.zeros((161, 161)))
    copy = satellite_copy(flat, rng=np.random.default_rng(7), cell_m=40.0, sigma_m=2.0)
    assert copy.sigma_m == 2.0
    assert copy.window((0.0, 0.0, 400.0, 400.0)).sigma_m == 2.0
    assert np.isnan(copy.slope().sigma_m)
    z = copy.elevation
    # 6400 draws: the sd has a standard error of 2 / sqrt(2 * 6400) = 0.018, a lag correlation 0.0125.
    assert z.std() == pytest.approx(2.0, abs=4 * 0.018)
    assert abs((z[:, 1:] * z[:, :-1]).mean() / 4.0) < 4 * 0.0125


def test_satellite_cell_is_empty_when_less_than_half_is_known() -> None:
    grid = Grid((0.0, 0.0, 20.0, 20.0), 1.0)
    z = np.ones(grid.shape)
    z[:, grid.x > 14.0] = np.nan  # 4.5 of the eastern 10 m are known
    z[grid.y < 4.0, :] = np.nan  # 6.5 of the southern 10 m are known
    copy = satellite_copy(Dem.on(grid, z), rng=np.random.default_rng(1), cell_m=10.0, sigma_m=0.0)
    np.testing.assert_array_equal(copy.elevation, [[1.0, np.nan], [1.0, np.nan]])


def test_satellite_refusals() -> None:
    dem = plane(Grid((0.0, 0.0, 600.0, 600.0), 10.0))
    rng = np.random.default_rng(1)
    for wrong, words in (
        ({"cell_m": 80.0}, "no whole number"),
        ({"cell_m": 600.0}, "no whole number"),
        ({"cell_m": 5.0}, "finer"),
        ({"sigma_m": -1.0}, "noise"),
    ):
        with pytest.raises(InputError, match=words):
            satellite_copy(dem, rng=rng, **wrong)


@pytest.fixture(scope="module")
def cells() -> Dem:
    return random_dem("matern-3/2", Grid((0.0, 0.0, 750.0, 750.0), 75.0), np.random.default_rng(9))


def test_interpolation_keeps_the_mean_of_every_cell(cells: Dem) -> None:
    left, bottom, right, top = cells.bounds
    n = 75  # The midpoint rule is off by h²/24 z'': 1/24 m² times the curvature, below 0.02 /m here.
    fine = smooth_interpolation(cells, Grid((left + 0.5, bottom + 0.5, right - 0.5, top - 0.5), 1.0))
    means = fine.elevation.reshape(cells.shape[0], n, cells.shape[1], n).mean(axis=(1, 3))
    np.testing.assert_allclose(means, cells.elevation, atol=2 * 0.02 / 24)


def test_interpolation_has_a_continuous_second_derivative(cells: Dem) -> None:
    """Across the cells' edges the second difference jumps no more than within them."""
    step_m = 0.5
    row = smooth_interpolation(cells, Grid((0.0, 300.0, 700.0, 301.0), step_m)).elevation[0]
    second = np.diff(row, 2) / step_m**2
    third = np.abs(np.diff(second)) / step_m
    # A jump J of the second derivative would show as J / step; a cubic's third derivative is bounded
    # by differences of neighbouring cells: |z'''| < 100 max|Δ⁴z| / d³, far below.
    bound = 100.0 * np.abs(np.diff(cells.elevation, axis=1)).max() / 75.0**3
    assert third.max() < bound


def test_interpolation_reproduces_cubics() -> None:
    """Cell means of a cubic give the cubic back everywhere, the edges included."""

    def antiderivative(x: FloatArray) -> FloatArray:
        quartic: FloatArray = x**4 / 4 - 2.0 * x**2 + x
        return quartic

    edges = np.arange(0.0, 7.0)
    means = np.diff(antiderivative(edges))
    coarse = Dem.on(Grid((0.5, 0.5, 5.5, 5.5), 1.0), np.tile(means, (6, 1)))
    grid = Grid((0.0, 0.0, 6.0, 6.0), 0.25)
    expected = np.tile(grid.x**3 - 4.0 * grid.x + 1.0, (grid.shape[0], 1))
    # Values up to 193 through a banded solve: 1e-13 relative.
    np.testing.assert_allclose(smooth_interpolation(coarse, grid).elevation, expected, atol=1e-9)


def test_interpolation_refusals(cells: Dem) -> None:
    holed = cells.elevation.copy()
    holed[3, 3] = np.nan
    inside = Grid((100.0, 100.0, 200.0, 200.0), 10.0)
    for dem, grid, words in (
        (Dem(holed, cells.transform, cells.crs), inside, "hold no height"),
        (cells.window((0.0, 0.0, 225.0, 750.0)), inside, "at least 5"),
        (cells, Grid((0.0, 0.0, 800.0, 100.0), 10.0), "reaches beyond"),
        (cells, Grid((100.0, 100.0, 200.0, 200.0), 10.0, CRS(32616)), "different systems"),
    ):
        with pytest.raises(InputError, match=words):
            smooth_interpolation(dem, grid)


def test_real_sample_puts_its_summit_on_cross_mountain() -> None:
    """The highest ground is a known summit, so the stored latitudes are read the right way."""
    dem = real_sample()
    assert dem.step_m == 75.0
    assert dem.crs.to_epsg() == 32616
    row, column = np.unravel_index(np.nanargmax(dem.elevation), dem.shape)
    # Cross Mountain, Tennessee: 36.19833° N, 84.23056° W, 1077 m (published coordinates).
    east, north = Transformer.from_crs(4326, 32616, always_xy=True).transform(-84.23056, 36.19833)
    # Half a cell of the source, half one of ours, and a second of arc in the summit's coordinates.
    assert np.hypot(dem.x[column] - east, dem.y[row] - north) < 47.0 + 53.0 + 31.0
    # Averaging between cells lowers a top by a few metres.
    assert 1065.0 < dem.elevation[row, column] <= 1077.0


def test_sample_site_is_600_m_wide_with_25_m_relief() -> None:
    prior, bounds = sample_site()
    assert (bounds[2] - bounds[0], bounds[3] - bounds[1]) == (600.0, 600.0)
    assert prior.vertical_datum == "EGM96 height"
    window = prior.window(bounds)
    assert window.shape == (8, 8)
    assert window.relief_m == pytest.approx(25.0, abs=1.0)
    fine = smooth_interpolation(prior, Grid(bounds, 5.0, prior.crs))
    assert fine.shape == (121, 121)
    with pytest.raises(InputError, match="reaches beyond"):
        sample_site(row=2)

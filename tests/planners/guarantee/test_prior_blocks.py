import numpy as np
import pytest
import shapely

from planners.prediction.kernel_posterior import Block, PriorBlocks
from survey import Dem, Grid, SurveyArea
from survey.core.errors import InputError
from survey.reconstruction.gp.kernels import Matern32, SquaredExponential
from tests.planners.guarantee.smooth_site import AREA, CRS, coarse, smooth_terrain


def test_a_tilt_of_the_prior_does_not_change_the_likelihood():
    prior = coarse(smooth_terrain())
    east, north = np.meshgrid(prior.x, prior.y)
    tilted = Dem(prior.elevation + 0.2 * east - 0.1 * north + 7.0, prior.transform, prior.crs)
    level, steep = (
        PriorBlocks.of(AREA, dem).fits(Matern32(1.0, 100.0), [1e-3])[0] for dem in (prior, tilted)
    )
    assert steep.variance_m2 == pytest.approx(level.variance_m2, rel=1e-6)
    assert steep.log_likelihood == pytest.approx(level.log_likelihood, rel=1e-6)


def test_the_likelihood_is_that_of_means_over_the_resolution(rng):
    row, column = (index.ravel() for index in np.indices((3, 4)))
    height = rng.standard_normal(12)
    blocks = PriorBlocks([Block(row, column, height)], 20.0, 2.0)
    kernel = SquaredExponential(1.0, 60.0)
    share = 40.0 * ((np.arange(4) + 0.5) / 4 - 0.5)
    offsets = np.stack(np.meshgrid(share, share), axis=-1).reshape(-1, 2)
    places = 20.0 * np.column_stack([column, -row])[:, None, :] + offsets
    covariance = kernel.covariance(places.reshape(-1, 2), places.reshape(-1, 2))
    matrix = covariance.reshape(12, 16, 12, 16).mean(axis=(1, 3)) + (0.01 + 1e-8) * np.eye(12)
    inverse, ones = np.linalg.inv(matrix), np.ones(12)
    centred = height - (ones @ inverse @ height) / (ones @ inverse @ ones)
    variance = centred @ inverse @ centred / 11
    log = -0.5 * (np.linalg.slogdet(matrix)[1] + np.log(ones @ inverse @ ones) + 11 * np.log(variance))
    found = blocks.fits(kernel, [0.01])[0]
    assert found.variance_m2 == pytest.approx(variance, rel=1e-6)
    assert found.log_likelihood == pytest.approx(log, rel=1e-6)


def test_cells_off_the_polygon_do_not_count(rng):
    heights = rng.standard_normal((40, 40))
    dem = Dem.on(Grid((5.0, 5.0, 395.0, 395.0), 10.0, CRS), heights)
    strip = SurveyArea(shapely.box(0.0, 0.0, 400.0, 100.0), CRS)
    changed = heights.copy()
    changed[:25] += 1000.0
    other = Dem.on(Grid((5.0, 5.0, 395.0, 395.0), 10.0, CRS), changed)
    one, two = (PriorBlocks.of(strip, prior) for prior in (dem, other))
    assert [b.height_m.tolist() for b in one.blocks] == [b.height_m.tolist() for b in two.blocks]


def test_a_million_cells_are_read_as_a_few_blocks():
    dem = Dem.on(Grid((0.0, 0.0, 9990.0, 9990.0), 10.0, CRS), np.arange(1e6).reshape(1000, 1000) % 97.0)
    blocks = PriorBlocks.of(SurveyArea.rectangle((0.0, 0.0, 9990.0, 9990.0), CRS), dem)
    assert len(blocks.blocks) == 6
    assert max(len(block.row) for block in blocks.blocks) <= 100


def test_a_prior_of_few_cells_is_refused():
    cells = Dem.on(Grid((75.0, 75.0, 225.0, 225.0), 150.0, CRS), np.zeros((2, 2)))
    with pytest.raises(InputError, match="4 known cells"):
        PriorBlocks.of(AREA, cells)


def test_the_slope_is_that_of_the_plane_through_the_cells():
    flat = PriorBlocks.of(AREA, coarse(smooth_terrain()))
    grid = Grid((25.0, 25.0, 275.0, 275.0), 50.0, CRS)
    east, north = np.meshgrid(np.arange(6.0), np.arange(6.0))
    inclined = PriorBlocks.of(AREA, Dem.on(grid, 50.0 * (0.3 * east - 0.4 * north)))
    assert inclined.slope == pytest.approx(0.5)
    assert flat.slope < 0.1

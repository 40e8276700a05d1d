import numpy as np
import pytest

from planners.guarantee.kernel_posterior import (
    KernelPosterior,
    WeightedKernel,
    cautious_posterior,
    localized_noise_m,
    posterior_from_prior,
    posterior_from_survey,
)
from survey import Dem, Grid
from survey.reconstruction.gp.covariance.kernels import SquaredExponential
from survey.reconstruction.gp.selection.cells import Cell
from survey.terrain.conditional import CoarseCells
from tests.planners.guarantee.smooth_site import CRS, SMOOTH, coarse, lines, smooth_terrain


def test_errors_of_place_count_by_the_slope():
    kernel = SquaredExponential(25.0, 50.0)
    # Each slope has the variance v / l²; two of them, and no noise of height.
    assert localized_noise_m(0.0, 2.0, kernel) == pytest.approx(np.sqrt(2 * 4.0 * 25.0 / 2500.0), rel=1e-3)
    assert localized_noise_m(0.3, 0.0, kernel) == pytest.approx(0.3)


def test_the_prior_gives_the_length_scale():
    cells = CoarseCells(coarse(smooth_terrain()), 0.5)
    posterior = posterior_from_prior(cells, noise_m=0.1)
    assert sum(one.weight for one in posterior.kernels) == pytest.approx(1.0)
    # 36 cells of one field give the scale to within a factor of two.
    assert 40.0 < posterior.slope_length_m < 160.0


def test_the_survey_gives_family_and_noise(rng):
    terrain, xy = smooth_terrain(), lines(4)
    posterior = posterior_from_survey(xy, terrain.at(xy) + 0.1 * rng.standard_normal(len(xy)), noise_m=0.1)
    assert posterior.likeliest.cell.family == "squared-exponential"
    assert posterior.likeliest.noise_m == pytest.approx(0.1, rel=0.25)


def test_a_prior_is_read_as_roughly_as_it_allows():
    cells = CoarseCells(coarse(smooth_terrain()), 0.5)
    cautious = cautious_posterior(cells, noise_m=0.1)
    stated = cautious_posterior(cells, noise_m=0.1, assumed="squared-exponential")
    assert {one.cell.family for one in stated.kernels} == {"squared-exponential"}
    assert len({one.cell.family for one in cautious.kernels}) == 1
    assert cautious.growth <= posterior_from_prior(cells, noise_m=0.1).growth <= stated.growth


def test_a_family_keeps_the_weight_of_all_its_cells():
    smooth = [SMOOTH._replace(variance_m2=v, weight=0.3) for v in (20.0, 25.0)]
    rough = [
        WeightedKernel(Cell.of("whittle", length, -12.0), 25.0, 0.1, 0.1)
        for length in (100.0, 200.0, 300.0, 400.0)
    ]
    posterior = KernelPosterior.of_families([*smooth, *rough])
    assert [one.cell.family for one in posterior.kernels] == ["squared-exponential", "whittle"]
    assert [one.weight for one in posterior.kernels] == pytest.approx([0.6, 0.4])


def test_cells_of_a_grid_share_their_covariances_by_lag(rng):
    heights = rng.standard_normal((5, 6))
    heights[0, 0] = heights[2, 3] = np.nan
    cells = CoarseCells(Dem.on(Grid((25.0, 25.0, 275.0, 225.0), 50.0, CRS), heights), 1.0)
    kernel = SquaredExponential(9.0, 60.0, anisotropy=2.0, angle_deg=30.0)
    n, per_cell, _ = cells.places.shape
    places = cells.places.reshape(-1, 2)
    fine = kernel.covariance(places, places).reshape(n, per_cell, n, per_cell)
    # Lags are rounded to a nanometre before equal ones are counted.
    np.testing.assert_allclose(cells.covariance(kernel), fine.mean(axis=(1, 3)), rtol=1e-9)

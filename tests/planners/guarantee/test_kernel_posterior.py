import numpy as np
import pytest

from planners.prediction.assumptions import roughness_elsewhere
from planners.prediction.kernel_posterior import (
    PriorBlocks,
    localized_noise_m,
    posterior_from_prior,
    posterior_from_survey,
)
from survey import Dem, Grid, SurveyArea
from survey.reconstruction.gp.kernels import SquaredExponential
from tests.planners.guarantee.smooth_site import AREA, CRS, coarse, lines, smooth_terrain


@pytest.fixture(scope="module")
def blocks():
    return PriorBlocks.of(AREA, coarse(smooth_terrain()))


def test_errors_of_place_count_by_the_slope():
    kernel = SquaredExponential(25.0, 50.0)
    # Each slope has the variance v / l²; two of them, and no noise of height.
    assert localized_noise_m(0.0, 2.0, kernel) == pytest.approx(np.sqrt(2 * 4.0 * 25.0 / 2500.0), rel=1e-3)
    assert localized_noise_m(0.3, 0.0, kernel) == pytest.approx(0.3)


def test_the_prior_gives_the_length_scale(blocks):
    posterior = posterior_from_prior(blocks, noise_m=0.1, assumed="squared-exponential")
    assert sum(one.weight for one in posterior.kernels) == pytest.approx(1.0)
    # 36 cells of one field give the scale to within a factor of two.
    assert 40.0 < posterior.slope_length_m < 160.0


def test_the_survey_gives_family_and_noise(rng):
    terrain, xy = smooth_terrain(), lines(4)
    posterior = posterior_from_survey(xy, terrain.at(xy) + 0.1 * rng.standard_normal(len(xy)), noise_m=0.1)
    assert posterior.likeliest.cell.family == "squared-exponential"
    assert posterior.likeliest.noise_m == pytest.approx(0.1, rel=0.25)


def test_the_class_of_surface_says_how_rough_the_ground_is(blocks):
    growth = {
        surface: posterior_from_prior(blocks, noise_m=0.1, surface=surface).growth
        for surface in ("snow", "unknown", "bedrock")
    }
    assert growth["snow"] > growth["unknown"] > growth["bedrock"]
    ice = posterior_from_prior(blocks, noise_m=0.1, surface="bare-ice")
    stated = posterior_from_prior(blocks, noise_m=0.1, surface="bare-ice", micro_relief_m=0.5)
    assert {one.unseen_m2 for one in ice.kernels} == {0.3**2}
    assert {one.unseen_m2 for one in stated.kernels} == {0.5**2}
    assert stated.likeliest.noise_m == pytest.approx(np.hypot(0.1, 0.5), rel=1e-6)


def test_a_worse_prior_leaves_more_open_and_the_ground_no_smoother(blocks):
    good, bad, worst = (
        posterior_from_prior(blocks, noise_m=0.1, prior_sigma_m=sigma_m) for sigma_m in (0.5, 10.0, 1e4)
    )
    for better, worse in ((good, bad), (bad, worst)):
        assert better.open_spread <= worse.open_spread
        for one, other in zip(better.kernels, worse.kernels, strict=True):
            assert other.cell == one.cell
            assert other.variance_m2 >= one.variance_m2
    assert good.spread == worst.spread
    # Cells that say nothing leave the roughness as open as it is from landscape to landscape.
    assert worst.open_spread > 0.8


def test_smooth_cells_of_a_prior_that_may_be_wrong_do_not_show_smooth_ground():
    cells = np.add.outer(np.sin(np.arange(6.0)), np.cos(np.arange(6.0)))
    blocks = PriorBlocks.of(AREA, Dem.on(Grid((25.0, 25.0, 275.0, 275.0), 50.0, CRS), 0.3 * cells))
    posterior = posterior_from_prior(blocks, noise_m=0.1, prior_sigma_m=30.0)
    half_cell = np.array([25.0, 0.0])
    for one in posterior.kernels:
        lost = one.variance_m2 - float(one.kernel.covariance_of_lag(half_cell))
        assert np.sqrt(2.0 * lost) == pytest.approx(
            np.exp(roughness_elsewhere(25.0, blocks.slope).mean), rel=0.05
        )


def test_cells_that_show_errors_alone_leave_the_roughness_of_other_landscapes(rng):
    heights = 0.5 * rng.standard_normal((5, 5))
    prior = Dem.on(Grid((30.0, 30.0, 270.0, 270.0), 60.0, CRS), heights)
    posterior = posterior_from_prior(PriorBlocks.of(AREA, prior), noise_m=0.1)
    informed = posterior_from_prior(PriorBlocks.of(AREA, coarse(smooth_terrain())), noise_m=0.1)
    assert posterior.open_spread > 1.5 * informed.open_spread


def test_few_coarse_cells_take_the_roughness_of_ground_as_steep(rng):
    def roughness_m(slope, n):
        cells = np.add.outer(slope * 60.0 * np.arange(float(n)), np.zeros(n)) + noise[:n, :n]
        grid = Grid((30.0, 30.0, 60.0 * n - 30.0, 60.0 * n - 30.0), 60.0, CRS)
        area = SurveyArea.rectangle((0.0, 0.0, 60.0 * n, 60.0 * n), CRS)
        posterior = posterior_from_prior(PriorBlocks.of(area, Dem.on(grid, cells)), noise_m=0.1)
        lost = [
            one.variance_m2 - float(one.kernel.covariance_of_lag(np.array([30.0, 0.0])))
            for one in posterior.kernels
        ]
        return np.sqrt(2.0 * np.mean(lost)), posterior.open_spread

    noise = 2.0 * rng.standard_normal((10, 10))
    (gentle_m, _), (steep_m, open_spread) = roughness_m(0.05, 5), roughness_m(0.8, 5)
    assert steep_m > 1.2 * gentle_m
    (many_gentle_m, _), (many_steep_m, many_open) = roughness_m(0.05, 10), roughness_m(0.8, 10)
    # A hundred cells leave less to the slope, and less open, than twenty-five.
    assert many_steep_m / many_gentle_m < steep_m / gentle_m
    assert many_open < open_spread

"""Guarantees: probabilities that simulation confirms, refusals that name what is reachable, surveys that stop in time."""

from dataclasses import replace

import numpy as np
import pytest

from planners.ground.transit import FreeGround
from planners.guarantee.adaptive import first_swaths, survey_adaptively
from planners.guarantee.adaptive_state import AdaptiveConfig
from planners.guarantee.gaps import gaps_filled
from planners.guarantee.guarantee import guarantee
from planners.guarantee.kernel_posterior import (
    KernelPosterior,
    WeightedKernel,
    cautious_posterior,
    localized_noise_m,
    posterior_from_prior,
    posterior_from_survey,
)
from planners.guarantee.prediction import LimitPredictor
from planners.guarantee.requirement import MapRequirement, reachable_class
from planners.guarantee.search import fewest
from planners.swaths.heading import across_marked_grain
from survey import Dem, Grid, SurveyArea
from survey.core.errors import ConfigError, InputError
from survey.core.streams import stream
from survey.reconstruction.gp.covariance.kernels import SquaredExponential
from survey.reconstruction.gp.selection.kernel_search import Cell, FoundKernel, mapped
from survey.terrain import random_dem, satellite_copy
from survey.terrain.conditional import CoarseCells

CRS = "EPSG:32608"
SIDE_M = 300.0
AREA = SurveyArea.rectangle((0.0, 0.0, SIDE_M, SIDE_M), CRS)
SMOOTH = WeightedKernel(Cell.of("squared-exponential", 80.0, -12.0), 25.0, 0.1, 1.0)


def smooth_terrain(seed: int = 3) -> Dem:
    grid = Grid((0.0, 0.0, SIDE_M, SIDE_M), 5.0, CRS)
    return random_dem("squared_exponential", grid, stream(seed), 12.0, length_scale_m=80.0)


def coarse(terrain: Dem) -> Dem:
    return satellite_copy(terrain, rng=stream(4), cell_m=50.0, sigma_m=0.5)


def lines(n: int) -> np.ndarray:
    along = np.arange(0.0, SIDE_M + 1.0, 10.0)
    offsets = (np.arange(n) + 0.5) * SIDE_M / n
    return np.array([(x, y) for y in offsets for x in along])


def test_the_chance_of_a_limit_is_that_of_drawn_errors(rng):
    # Errors drawn from the posterior covariance itself, which the moments stand for.
    predictor = LimitPredictor(AREA, limit_m=0.5, step_m=10.0)
    xy, nodes, kernel = lines(3), predictor.nodes, SMOOTH.kernel
    among = kernel.covariance(xy, xy) + SMOOTH.noise_m**2 * np.eye(len(xy))
    joint = np.vstack([xy, nodes])
    root = np.linalg.cholesky(kernel.covariance(joint, joint) + 1e-8 * np.eye(len(joint)))
    field = root @ rng.standard_normal((len(joint), 400))
    heights = field[: len(xy)] + SMOOTH.noise_m * rng.standard_normal((len(xy), 400))
    weights = np.linalg.solve(among, kernel.covariance(xy, nodes)).T
    rmse = np.sqrt(np.mean((weights @ heights - field[len(xy) :]) ** 2, axis=0))
    predicted = predictor.of(xy, KernelPosterior((SMOOTH,)))
    # 400 draws know a share to 0.025; the unknown constant and thinned samples add a little.
    assert predicted.probability == pytest.approx(np.mean(rmse <= 0.5), abs=0.1)
    assert predicted.rmse_m == pytest.approx(rmse.mean(), rel=0.1)


def test_more_swaths_make_the_limit_more_probable():
    predictor = LimitPredictor(AREA, limit_m=0.4572, step_m=10.0)
    chances = [predictor.of(lines(n), KernelPosterior((SMOOTH,))).probability for n in (1, 2, 4, 8)]
    assert chances == sorted(chances)
    assert chances[0] < 0.01
    assert chances[-1] > 0.99


def test_errors_of_place_count_by_the_slope():
    kernel = SquaredExponential(25.0, 50.0)
    # Each slope has the variance v / l²; two of them, and no noise of height.
    assert localized_noise_m(0.0, 2.0, kernel) == pytest.approx(np.sqrt(2 * 4.0 * 25.0 / 2500.0), rel=1e-3)
    assert localized_noise_m(0.3, 0.0, kernel) == pytest.approx(0.3)


def test_the_prior_gives_the_length_scale():
    cells = CoarseCells(coarse(smooth_terrain()), 0.5)
    posterior = posterior_from_prior(cells, noise_m=0.1)
    assert sum(one.weight for one in posterior.kernels) == pytest.approx(1.0)
    # 36 cells of one field tell the scale to within a factor of two.
    assert 40.0 < posterior.slope_length_m < 160.0


def test_the_survey_gives_family_and_noise(rng):
    terrain, xy = smooth_terrain(), lines(4)
    posterior = posterior_from_survey(xy, terrain.at(xy) + 0.1 * rng.standard_normal(len(xy)), noise_m=0.1)
    assert posterior.likeliest.cell.family == "squared-exponential"
    assert posterior.likeliest.noise_m == pytest.approx(0.1, rel=0.25)


def test_relief_finer_than_the_samples_is_an_error_of_the_map(rng):
    terrain, xy = smooth_terrain(), lines(6)
    sensor = terrain.at(xy) + 0.1 * rng.standard_normal(len(xy))
    bumps = 0.3 * rng.standard_normal(len(xy))
    predictor = LimitPredictor(AREA, limit_m=0.5, step_m=10.0)
    even, bumpy = (posterior_from_survey(xy, heights, noise_m=0.1) for heights in (sensor, sensor + bumps))
    assert predictor.of(xy, even).rmse_m < 0.15
    # The bumps themselves, known to some 20 %, and as much again for what they hide of the rest.
    assert 0.24 < predictor.of(xy, bumpy).rmse_m < 0.3 * np.sqrt(2.0)


def test_a_prior_is_read_as_roughly_as_it_allows():
    cells = CoarseCells(coarse(smooth_terrain()), 0.5)
    cautious = cautious_posterior(cells, noise_m=0.1)
    stated = cautious_posterior(cells, noise_m=0.1, assumed="squared-exponential")
    assert {one.cell.family for one in stated.kernels} == {"squared-exponential"}
    assert len({one.cell.family for one in cautious.kernels}) == 1
    assert cautious.growth <= posterior_from_prior(cells, noise_m=0.1).growth <= stated.growth


def test_further_lines_are_laid_where_they_save_the_most():
    driven = [50.0, 250.0]
    laid = [offset for offset, _ in gaps_filled(driven, 600.0, 4, 4.0)]
    # Strips of 200 and 350 m: one line halves the first, three divide the second.
    assert np.sum(np.array(laid) < 250.0) == 1
    strips = np.diff(sorted(driven + laid))
    assert strips.max() <= 1.4 * strips.min()
    # The outermost lies 0.35 spacings from the border.
    assert 600.0 - max(laid) == pytest.approx(0.35 * strips[-1])


def test_a_gap_barely_wider_than_the_others_is_left_for_new_ground():
    driven = [20.0, 80.0, 140.0, 200.0]
    # Rough terrain: lines at 57 m in the ground that is new, none between those driven 60 m apart.
    assert min(offset for offset, _ in gaps_filled(driven, 600.0, 7, 3.0)) > 200.0


def test_the_fewest_that_are_enough_are_found_from_anywhere():
    for wanted in (1, 2, 9, 30):
        for first in (-1, 1, 8, 30):
            assert fewest(lambda n, wanted=wanted: n >= wanted, first=first, most=30) == wanted
    assert fewest(lambda n: n > 30, first=3, most=30) is None


def test_an_adaptive_survey_stops_when_its_guarantee_holds():
    terrain = smooth_terrain()
    rng = stream(9)
    posterior = posterior_from_prior(CoarseCells(coarse(terrain), 0.5), noise_m=0.1)
    config = AdaptiveConfig(limit_m=0.3048, noise_m=0.1)
    heights = []

    def measure(xy):
        heights.append(terrain.at(xy) + 0.1 * rng.standard_normal(len(xy)))
        return heights[-1]

    survey = survey_adaptively(AREA, posterior, config, measure)
    assert survey.holds
    assert survey.route is not None
    assert survey.predicted.probability >= 0.9
    assert 2 <= len(survey.route.swaths) <= 8
    nodes = Grid((10.0, 10.0, 290.0, 290.0), 20.0, CRS).xy
    best = survey.posterior.likeliest
    mean, _ = mapped(
        survey.samples, np.concatenate(heights)[:, None], [FoundKernel(best.cell, best.variance_m2)], nodes
    )
    assert np.sqrt(np.mean((mean[:, 0] - terrain.at(nodes)) ** 2)) <= config.limit_m


def test_swaths_of_a_survey_run_across_a_marked_grain():
    grid = Grid((0.0, 0.0, SIDE_M, SIDE_M), 50.0, CRS)
    ridges = Dem.on(grid, np.outer(5.0 * np.sin(np.arange(7.0)), np.ones(7)))
    ground = FreeGround(AREA.free)
    assert across_marked_grain(ground, ridges) == 90.0
    assert across_marked_grain(ground, coarse(smooth_terrain())) == 0.0
    config = AdaptiveConfig(limit_m=0.3, heading_deg=90.0)
    for swath in first_swaths(AREA, KernelPosterior((SMOOTH,)), config).swaths:
        (east, north) = np.abs(swath.axis[1] - swath.axis[0])
        assert east < 1e-9
        assert north > 200.0


def test_a_survey_is_not_given_up_while_the_prior_leaves_some_probability():
    terrain, rng = smooth_terrain(), stream(9)
    # As likely as not the terrain is so rough that no thirty swaths would do.
    fear = WeightedKernel(Cell.of("whittle", 80.0, -12.0), 400.0, 0.1, 0.5)
    posterior = KernelPosterior((SMOOTH._replace(weight=0.5), fear))
    survey = survey_adaptively(
        AREA,
        posterior,
        AdaptiveConfig(limit_m=0.3048, noise_m=0.1),
        lambda xy: terrain.at(xy) + 0.1 * rng.standard_normal(len(xy)),
    )
    assert survey.holds
    assert survey.route is not None
    assert len(survey.route.swaths) <= 8


def test_an_adaptive_survey_says_when_no_survey_is_enough():
    terrain, rng = smooth_terrain(), stream(9)
    posterior = posterior_from_prior(CoarseCells(coarse(terrain), 0.5), noise_m=2.0)
    config = AdaptiveConfig(limit_m=0.02, noise_m=2.0)
    survey = survey_adaptively(
        AREA, posterior, config, lambda xy: terrain.at(xy) + 2.0 * rng.standard_normal(len(xy))
    )
    assert not survey.holds
    assert survey.route is None


def test_a_guarantee_holds_on_simulated_terrain_and_states_its_assumptions():
    wanted = MapRequirement(0.4572, noise_m=0.1, n_simulations=30, prior_sigma_m=0.5)
    made = guarantee(AREA, coarse(smooth_terrain()), wanted)
    assert made.holds
    assert made.simulated_share >= 0.9
    assert made.reachable_m <= 0.4572
    assert "length scale" in made.assumptions
    assert "does not exclude" in made.assumptions
    stated = guarantee(AREA, coarse(smooth_terrain()), replace(wanted, assumed="squared-exponential"))
    assert stated.holds
    assert stated.route.length_m <= made.route.length_m
    assert "as stated" in stated.assumptions


def test_guaranteed_swaths_run_across_a_marked_grain():
    grid = Grid((0.0, 0.0, SIDE_M, SIDE_M), 50.0, CRS)
    ridges = Dem.on(grid, np.outer(5.0 * np.sin(np.arange(7.0)), np.ones(7)))
    made = guarantee(AREA, ridges, MapRequirement(1.0, noise_m=0.1, n_simulations=10, prior_sigma_m=0.5))
    for swath in made.route.swaths:
        (east, north) = np.abs(swath.axis[1] - swath.axis[0])
        assert east < 1e-9
        assert north > 150.0


def test_what_is_reachable_is_named_by_its_class():
    assert "0.3048 m" in str(reachable_class(0.25))
    assert reachable_class(0.5) is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"probability": 1.0}, "between 0 and 1"),
        ({"noise_m": -1.0}, "noise_m is -1.0"),
        ({"limit_m": 0.0}, "limit_m"),
        ({"assumed": "fractal"}, "no family of covariances"),
    ],
)
def test_wishes_out_of_range_are_refused(change, words):
    with pytest.raises(ConfigError, match=words):
        replace(MapRequirement(0.4572), **change)


def test_a_prior_that_is_too_coarse_is_refused():
    cells = Dem.on(Grid((75.0, 75.0, 225.0, 225.0), 150.0, CRS), np.zeros((2, 2)))
    with pytest.raises(InputError, match="4 known cells"):
        guarantee(AREA, cells, MapRequirement(0.4572))


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


def test_a_family_keeps_the_weight_of_all_its_cells():
    smooth = [SMOOTH._replace(variance_m2=v, weight=0.3) for v in (20.0, 25.0)]
    rough = [
        WeightedKernel(Cell.of("whittle", length, -12.0), 25.0, 0.1, 0.1)
        for length in (100.0, 200.0, 300.0, 400.0)
    ]
    posterior = KernelPosterior.of_families([*smooth, *rough])
    assert [one.cell.family for one in posterior.kernels] == ["squared-exponential", "whittle"]
    assert [one.weight for one in posterior.kernels] == pytest.approx([0.6, 0.4])

from dataclasses import replace

import numpy as np
import pytest
import shapely

from planners.guarantee.adaptive import (
    AdaptiveConfig,
    AdaptiveState,
    first_swaths,
    next_swath,
    survey_adaptively,
)
from planners.guarantee.requirement import MapRequirement
from planners.guarantee.survey_lines import SurveyLines
from planners.prediction.error_model import ErrorModel
from planners.prediction.kernel_posterior import (
    KernelPosterior,
    PriorBlocks,
    WeightedKernel,
    posterior_from_prior,
)
from planners.routes.shortest_paths import FreeGround
from planners.swaths.heading import across_marked_grain
from survey import Dem, Grid, InputError, Route, SurveyArea
from survey.core.streams import stream
from survey.reconstruction.gp.kernel_search import Cell, FoundKernel, map_surveys
from tests.planners.guarantee.smooth_site import AREA, CRS, SIDE_M, SMOOTH, coarse, smooth_terrain


def test_an_adaptive_survey_stops_when_its_guarantee_holds():
    terrain = smooth_terrain()
    rng = stream(9)
    posterior = posterior_from_prior(PriorBlocks.of(AREA, coarse(terrain)), noise_m=0.1)
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
    mean, _ = map_surveys(
        survey.samples, np.concatenate(heights)[:, None], [FoundKernel(best.cell, best.variance_m2)], nodes
    )
    assert np.sqrt(np.mean((mean[:, 0] - terrain.at(nodes)) ** 2)) <= config.limit_m


def test_swaths_of_a_survey_run_across_a_marked_grain():
    grid = Grid((0.0, 0.0, SIDE_M, SIDE_M), 50.0, CRS)
    ridges = Dem.on(grid, np.outer(5.0 * np.sin(np.arange(7.0)), np.ones(7)))
    ground = FreeGround(AREA.free)
    assert across_marked_grain(ground.polygon, ridges) == 90.0
    assert across_marked_grain(ground.polygon, coarse(smooth_terrain())) == 0.0
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
    posterior = posterior_from_prior(PriorBlocks.of(AREA, coarse(terrain)), noise_m=2.0)
    config = AdaptiveConfig(limit_m=0.02, noise_m=2.0)
    survey = survey_adaptively(
        AREA, posterior, config, lambda xy: terrain.at(xy) + 2.0 * rng.standard_normal(len(xy))
    )
    assert not survey.holds
    assert survey.route is None


def test_the_same_samples_give_the_same_answer_and_pieces_of_a_line_count_once():
    terrain, rng = smooth_terrain(), stream(9)
    holed = SurveyArea(AREA.polygon.difference(shapely.box(100.0, 20.0, 200.0, 280.0)), CRS)
    config = AdaptiveConfig(limit_m=0.3048, noise_m=0.1, heading_deg=0.0)
    driven = first_swaths(holed, KernelPosterior((SMOOTH,)), config)
    assert len(driven.swaths) > config.n_first
    xy = driven.sample(10.0).xy
    heights = terrain.at(xy) + 0.1 * rng.standard_normal(len(xy))
    first, again = (next_swath(holed, driven, xy, heights, config) for _ in range(2))
    assert first.predicted == again.predicted
    assert first.route is not None
    np.testing.assert_array_equal(first.route.legs[-1].xy, again.route.legs[-1].xy)
    assert len(SurveyLines(holed, 0.0).offsets_of(driven, 1.0)) == config.n_first


def test_a_next_swath_that_leaves_the_free_ground_is_refused(monkeypatch: pytest.MonkeyPatch):
    terrain, rng = smooth_terrain(), stream(9)
    holed = SurveyArea(AREA.polygon.difference(shapely.box(100.0, 20.0, 200.0, 280.0)), CRS)
    config = AdaptiveConfig(limit_m=0.3048, noise_m=0.1, heading_deg=0.0)
    driven = first_swaths(holed, KernelPosterior((SMOOTH,)), config)
    xy = driven.sample(10.0).xy
    heights = terrain.at(xy) + 0.1 * rng.standard_normal(len(xy))
    across = [np.array([[50.0, 150.0], [250.0, 150.0]])]
    monkeypatch.setattr(SurveyLines, "swath", lambda *_: across)
    with pytest.raises(InputError, match="outside the area or in a no-go zone"):
        next_swath(holed, driven, xy, heights, config)


def test_swaths_are_not_planned_denser_for_what_later_ones_will_show():
    certain = KernelPosterior((SMOOTH._replace(weight=1.0),))
    states = [
        AdaptiveState(AREA, replace(certain, open_spread=spread), AdaptiveConfig(limit_m=0.3048, noise_m=0.1))
        for spread in (0.0, 0.6)
    ]
    for state in states:
        state.is_fitted = True
    planned = [state.further(0.9) for state in states]
    assert planned[0] == planned[1]
    # Whether the survey may stop depends on it.
    sure, doubtful = (state.predicted_with(planned[0]) for state in states)
    assert doubtful.probability < sure.probability


def test_an_adaptive_survey_is_predicted_as_every_other_plan():
    prior = coarse(smooth_terrain())
    wanted = MapRequirement(0.6, prior_sigma_m=0.5)
    model, config = ErrorModel.from_prior(AREA, prior, wanted), AdaptiveConfig.of_prior(wanted, AREA, prior)
    state = AdaptiveState(AREA, model.posterior, config)
    lines = state.further(0.9)
    for line in lines:
        state.drive(line, lambda xy: np.full(len(xy), np.nan))
    route = Route(tuple(state.legs), AREA.crs, "adaptive")
    expected = model.distribution(route)
    assert state.predicted_with([]).rmse_m == pytest.approx(expected.rmse_m, rel=0.02)
    assert state.predicted_with([]).probability == pytest.approx(expected.probability(0.6), abs=0.02)
    alone = AdaptiveState(AREA, model.posterior, replace(config, cells=None)).further(0.9)
    assert len(lines) <= len(alone)


def test_the_first_swaths_of_an_adaptive_survey_cross_the_main_body():
    # The edge where the survey starts is the tip of a tongue, 20 m wide there and 300 m wide at its root.
    tongue = SurveyArea(shapely.Polygon([(140, 0), (160, 0), (300, 300), (0, 300)]), CRS)
    route = first_swaths(tongue, KernelPosterior((SMOOTH,)), AdaptiveConfig(limit_m=0.3, heading_deg=0.0))
    assert all(leg.length_m > 150.0 for leg in route.swaths)

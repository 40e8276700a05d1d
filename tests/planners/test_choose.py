import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import BestConfig, LawnmowerConfig, plan
from planners.patterns.best import INSET_SHARE, choose
from planners.prediction.error_model import ErrorModel
from planners.swaths.reference_lines import narrowest_heading
from survey import ConfigError, InputError, SurveyArea
from survey.core.config import validated
from survey.reconstruction.gp.kernels import Matern32, Matern52, SquaredExponential

CRS = "EPSG:32608"
SITE = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), CRS)


def model(kernel, noise_m, area=SITE):
    return ErrorModel.of(
        area, kernel, noise_m=noise_m, sample_step_m=20.0, cell_m=max(area.bounds[2:]) / 15.0
    )


def inset_lawnmowers(area):
    """Return inset lawnmowers of 1, 2, … swaths."""
    heading = narrowest_heading(area.free)
    configs = (LawnmowerConfig(swaths=n, heading_deg=heading, inset_share=INSET_SHARE) for n in range(1, 20))
    return [plan(area, None, config) for config in configs]


@given(
    family=st.sampled_from([SquaredExponential, Matern52, Matern32]),
    scale_m=st.floats(40.0, 300.0),
    noise_m=st.floats(0.0, 1.0),
    swaths=st.integers(1, 6),
    height_m=st.floats(200.0, 600.0),
)
@settings(max_examples=6)
def test_the_choice_is_never_worse_than_the_inset_lawnmower(family, scale_m, noise_m, swaths, height_m):
    area = SurveyArea.rectangle((0.0, 0.0, 600.0, height_m), CRS)
    errors = model(family(30.0, scale_m), noise_m, area)
    budget_m = plan(area, None, LawnmowerConfig(swaths=swaths)).length_m
    rival = [route for route in inset_lawnmowers(area) if route.length_m <= budget_m][-1]
    assert choose(area, BestConfig(swaths=swaths), errors).rmse_m <= errors.rmse_m(rival, 700)


def test_the_choice_respects_the_budget_of_the_plain_lawnmower():
    errors = model(SquaredExponential(30.0, 120.0), 0.1)
    plain = plan(SITE, None, LawnmowerConfig(swaths=5))
    assert choose(SITE, BestConfig(swaths=5), errors).route.length_m <= plain.length_m
    assert choose(SITE, BestConfig(spacing_m=120.0), errors).route.length_m <= plain.length_m
    assert choose(SITE, BestConfig(budget_m=2000.0), errors).route.length_m <= 2000.0


def test_a_wanted_error_is_predicted_by_a_route_no_longer_than_the_inset_lawnmower_s():
    errors = model(SquaredExponential(30.0, 120.0), 0.1)
    choice = choose(SITE, BestConfig(rmse_m=0.4572), errors)
    rival = next(route for route in inset_lawnmowers(SITE) if errors.rmse_m(route, 700) <= 0.4572)
    assert choice.rmse_m <= 0.4572
    assert choice.route.length_m <= rival.length_m


def test_swaths_run_across_the_grain():
    # Heights are alike for 240 m from south to north and for 80 m from west to east.
    grained = SquaredExponential(30.0, 240.0, anisotropy=3.0, angle_deg=90.0)
    choice = choose(SITE, BestConfig(swaths=4), model(grained, 0.1))
    assert choice.config.heading_deg == 0.0
    turned = SquaredExponential(30.0, 240.0, anisotropy=3.0, angle_deg=0.0)
    assert choose(SITE, BestConfig(swaths=4), model(turned, 0.1)).config.heading_deg == 90.0


def test_smooth_ground_without_noise_is_wound_about():
    assert (
        choose(SITE, BestConfig(swaths=4), model(SquaredExponential(30.0, 120.0), 0.0)).config.pattern
        == "wavy"
    )


def test_a_heading_that_is_given_is_used():
    config = BestConfig(swaths=3, heading_deg=90.0)
    assert choose(SITE, config, model(SquaredExponential(30.0, 120.0), 0.1)).config.heading_deg == 90.0


def test_plan_returns_the_chosen_route():
    kernel = SquaredExponential(30.0, 120.0)
    route = plan(SITE, None, BestConfig(budget_m=2500.0), kernel=kernel)
    assert route.length_m <= 2500.0
    assert route.prediction["rmse_m"] > 0.0


def test_a_budget_for_no_swath_is_refused():
    with pytest.raises(InputError, match="not even one swath"):
        choose(SITE, BestConfig(budget_m=20.0), model(SquaredExponential(30.0, 120.0), 0.1))


def test_an_error_that_cannot_be_reached_is_refused():
    small = SurveyArea.rectangle((0.0, 0.0, 20.0, 20.0), CRS)
    errors = ErrorModel.of(
        small, SquaredExponential(30.0, 120.0), noise_m=50.0, sample_step_m=5.0, cell_m=5.0
    )
    with pytest.raises(InputError, match="m wanted"):
        choose(small, BestConfig(rmse_m=0.01), errors)


def test_the_choice_stays_on_concave_ground_with_a_hole():
    bay = shapely.Polygon(
        [(0, 0), (600, 0), (600, 600), (380, 600), (330, 200), (250, 250), (250, 600), (0, 500)]
    )
    area = SurveyArea(bay, CRS, no_go=(shapely.box(80.0, 80.0, 180.0, 160.0),), starts=[[20.0, 20.0]])
    choice = choose(
        area, BestConfig(budget_m=3000.0, heading_deg=90.0), model(SquaredExponential(30.0, 120.0), 0.1, area)
    )
    assert area.free.covers(choice.route.line)
    assert choice.route.length_m <= 3000.0
    assert choice.route.path()[0].tolist() == [20.0, 20.0]


def test_exactly_one_goal_is_accepted():
    for wrong in ({}, {"swaths": 3, "rmse_m": 0.4}):
        with pytest.raises(ConfigError, match="one of swaths"):
            validated(BestConfig, wrong, "planner")

import numpy as np
import pytest
import shapely

from planners import VarianceDrivenConfig, plan
from planners.patterns.variance_driven import variance_driven
from planners.prediction.error_model import ErrorModel
from survey import ConfigError, InputError, SurveyArea
from survey.core.config import validated
from survey.reconstruction.gp.kernels import SquaredExponential

CRS = "EPSG:32608"
SITE = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), CRS)
KERNEL = SquaredExponential(30.0, 150.0)


def model(area=SITE, noise_m=0.1):
    return ErrorModel.of(area, KERNEL, noise_m=noise_m, sample_step_m=20.0, cell_m=60.0)


def test_the_budget_is_respected_and_used():
    (leg,) = variance_driven(SITE, VarianceDrivenConfig(budget_m=1500.0, n_places=6), model())
    # The last place that did not fit is at most a diagonal of the lattice of 100 m away, there and back.
    assert 1500.0 - 2.0 * 141.5 <= leg.length_m <= 1500.0


def test_the_wanted_error_is_predicted():
    route = plan(SITE, None, VarianceDrivenConfig(rmse_m=1.0, n_places=6), kernel=KERNEL, sample_step_m=20.0)
    assert route.prediction["rmse_m"] <= 1.05


def test_more_metres_never_predict_a_worse_map():
    errors = []
    for budget_m in (600.0, 1200.0, 1800.0):
        legs = variance_driven(SITE, VarianceDrivenConfig(budget_m=budget_m, n_places=6), model())
        errors.append(model().variance(legs[0].xy).mean())
    assert errors == sorted(errors, reverse=True)


def test_it_begins_where_the_rover_stands():
    area = SurveyArea(SITE.polygon, CRS, starts=[[580.0, 300.0]])
    (leg,) = variance_driven(area, VarianceDrivenConfig(budget_m=800.0, n_places=6), model(area))
    assert leg.xy[0].tolist() == [580.0, 300.0]


def test_it_begins_at_the_wanted_corner():
    (leg,) = variance_driven(
        SITE, VarianceDrivenConfig(budget_m=800.0, n_places=6, start="north-east"), model()
    )
    assert leg.xy[0].tolist() == [550.0, 550.0]


def test_no_metre_leaves_the_free_ground():
    area = SurveyArea(SITE.polygon, CRS, no_go=(shapely.box(200.0, 0.0, 260.0, 450.0),))
    (leg,) = variance_driven(area, VarianceDrivenConfig(budget_m=2500.0, n_places=7), model(area))
    assert area.free.covers(shapely.linestrings(leg.xy))
    assert (leg.xy[:, 0] > 260.0).any()


def test_no_place_is_visited_twice():
    (leg,) = variance_driven(SITE, VarianceDrivenConfig(budget_m=1800.0, n_places=5), model())
    assert len(np.unique(leg.xy, axis=0)) == len(leg.xy)


def test_an_error_beyond_all_places_is_refused():
    with pytest.raises(InputError, match="candidate places is predicted to err"):
        variance_driven(SITE, VarianceDrivenConfig(rmse_m=0.01, n_places=3), model(noise_m=1.0))


def test_a_budget_that_fits_nothing_is_refused():
    with pytest.raises(InputError, match="no waypoint fits"):
        variance_driven(SITE, VarianceDrivenConfig(budget_m=5.0, n_places=6), model())


def test_exactly_one_goal_is_accepted():
    with pytest.raises(ConfigError, match="either budget_m or rmse_m"):
        validated(VarianceDrivenConfig, {}, "planner")

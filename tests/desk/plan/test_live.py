"""Live planning: provisional while the covariance is fitted, exact afterwards, refusals in a sentence."""

import pytest

from desk.plan.document import PlanDocument
from desk.plan.summary import error_layer
from survey.core.errors import ConfigError, InputError
from tests.desk.conftest import SOUTH, SQUARE, WEST


def moved(document: PlanDocument, metres: float) -> PlanDocument:
    corner = (SQUARE[2][0] + metres, SQUARE[2][1])
    return document.model_copy(update={"areas": (((SQUARE[0], SQUARE[1], corner, SQUARE[3]),),)})


def test_the_first_plan_has_no_error_until_the_covariance_is_fitted(workspace):
    planner, document = workspace.planner, workspace.store.document
    first = planner.quick(document)
    assert first.is_provisional
    assert "rmse_m" not in first.plan.route.prediction
    exact = planner.exact(document)
    assert not exact.is_provisional
    assert exact.plan.route.prediction["rmse_m"] > 0.0
    assert not planner.quick(document).is_provisional


def test_a_moved_corner_is_planned_with_the_covariance_at_hand(workspace):
    planner, document = workspace.planner, workspace.store.document
    before = planner.exact(document)
    quick = planner.quick(moved(document, 60.0))
    assert quick.is_provisional
    assert quick.plan.model.posterior is before.plan.model.posterior
    assert quick.plan.route.prediction["rmse_m"] > 0.0


def test_settings_do_not_make_a_plan_provisional(workspace):
    planner, document = workspace.planner, workspace.store.document
    planner.exact(document)
    more = document.model_copy(update={"planner": {"pattern": "lawnmower", "swaths": 7}})
    live = planner.quick(more)
    assert not live.is_provisional
    assert len(live.plan.route.swaths) == 7


def test_the_error_map_lies_on_the_area_and_falls_with_more_swaths(workspace):
    planner, document = workspace.planner, workspace.store.document
    few = error_layer(planner.exact(document).plan, "fine")
    many = error_layer(
        planner.exact(document.model_copy(update={"planner": {"pattern": "lawnmower", "swaths": 12}})).plan,
        "fine",
    )
    assert many["rmse_m"] < few["rmse_m"] <= few["p95_m"] <= few["worst_m"]
    xmin, _ymin, _xmax, ymax = few["bounds"]
    assert xmin == pytest.approx(SQUARE[0][0], abs=10)
    assert ymax == pytest.approx(SQUARE[2][1], abs=10)
    assert few["image"].startswith("data:image/png;base64,")


@pytest.mark.parametrize(
    ("changes", "error", "text"),
    [
        ({"areas": ()}, InputError, "no area is drawn"),
        ({"starts": ((WEST, SOUTH),)}, InputError, "outside the area"),
        ({"planner": {"pattern": "lawnmower", "swaths": 0}}, ConfigError, "swaths"),
        ({"planner": {"pattern": "unknown"}}, ConfigError, "pattern"),
        ({"planner": {"pattern": "lawnmower", "swaths": 3, "spacing_m": 5}}, ConfigError, "either"),
        ({"fleet": {"rovers": 3}}, InputError, "start"),
        ({"areas": ((((0.0, 0.0), (9.0, 0.0), (9.0, 9.0)),),)}, InputError, "elsewhere"),
        ({"planner": {"pattern": "lawnmower", "spacing_m": 1e-6}}, InputError, "swaths"),
    ],
)
def test_refusals_are_those_of_the_command(workspace, changes, error, text):
    document = workspace.store.document.model_copy(update=changes)
    with pytest.raises(error, match=text):
        workspace.planner.quick(document)


def test_the_coarse_error_map_is_near_the_fine_one(workspace):
    plan = workspace.planner.exact(workspace.store.document).plan
    coarse, fine = error_layer(plan, "coarse"), error_layer(plan, "fine")
    assert coarse["rmse_m"] == pytest.approx(fine["rmse_m"], rel=0.1)
    assert coarse["worst_m"] == pytest.approx(fine["worst_m"], rel=0.25)


def test_a_moved_corner_is_planned_with_the_elevations_at_hand_and_then_with_its_own(workspace):
    planner = workspace.planner
    low, high = (WEST + 350.0, SOUTH + 350.0), (WEST + 550.0, SOUTH + 550.0)
    square = (low, (high[0], low[1]), high, (low[0], high[1]))
    document = workspace.store.document.model_copy(update={"areas": ((square,),)})
    planner.exact(document)
    before = planner.prior(document.survey_area(workspace.crs))
    for metres, reaches in ((45.0, True), (135.0, False)):
        corner = (high[0] + metres, high[1])
        changed = document.model_copy(update={"areas": (((square[0], square[1], corner, square[3]),),)})
        quick = planner.quick(changed)
        assert (quick.plan.prior is before) == reaches
        own = planner.prior(changed.survey_area(workspace.crs))
        assert own.bounds != before.bounds
        assert planner.exact(changed).plan.prior.bounds == own.bounds
        planner.prior(document.survey_area(workspace.crs))
        planner.exact(document)

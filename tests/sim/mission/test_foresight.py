"""Prediction of the map error of a mission, with the errors that its path shares."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

import planners
from firnline.actions.interface import NotMetError
from firnline.actions.joint_planning import survey_options
from planners import RandomWanderConfig
from sim.config.world import IceAssumptions, IceConfig, RandomTerrain, SatelliteConfig
from sim.mission.foresight import PredictedSurvey, cheapest, error_model_of, predict_survey, surveys_within
from sim.world.site import World
from survey import ConfigError, Dem, Grid, InputError, SurveyArea
from tests.sim.small_missions import mission_with

AREA = SurveyArea.rectangle((0.0, 0.0, 200.0, 200.0), "EPSG:32608")


def world(area: SurveyArea = AREA) -> World:
    grid = Grid((-60.0, -60.0, 260.0, 260.0), 40.0, area.crs)
    x, y = np.meshgrid(grid.x, grid.y)
    rng = np.random.default_rng(1)
    cells = 4.0 * np.sin(x / 60.0) * np.cos(y / 45.0) + 0.5 * rng.standard_normal(grid.shape)
    return World(Dem.on(grid, cells), Dem.on(grid, cells), area)


def test_stakes_lower_the_predicted_error_and_more_so_that_of_the_mean_height():
    plain, staked = (predict_survey(mission_with(stakes=n), world(), limit_m=0.4) for n in (0, 2))
    assert staked.rmse_m < plain.rmse_m
    assert staked.site_mean_m < plain.site_mean_m
    assert staked.chance >= plain.chance
    assert cheapest([plain, staked]) == plain


def test_a_driven_mission_is_predicted_by_the_model_of_every_plan():
    """What the path adds is its level and what differs from place to place; the relief is that of the samples alone."""
    mission = mission_with(stakes=2)
    model = error_model_of(mission, world())
    found = predict_survey(mission, world(), limit_m=0.4, model=model)
    rough = replace(model, posterior=replace(model.posterior, open_spread=1.0))
    assert found == predict_survey(mission, world(), limit_m=0.4)
    headline = model.beside_level(planners.plan(AREA, world().prior, mission.planner))
    # Landmarks lie up to tens of metres beside the line on which the headline has its samples.
    assert 0.5 * headline.rmse_m < found.rmse_m < np.hypot(headline.rmse_m, 2.0 * found.site_mean_m)
    likely = predict_survey(mission, world(), limit_m=1.5 * found.rmse_m, model=model).chance
    assert predict_survey(mission, world(), limit_m=1.5 * found.rmse_m, model=rough).chance < likely


def test_progress_is_told_and_every_prediction_is_kept():
    told, tried = [], []
    wanted = {"limit_m": 10.0, "probability": 0.5, "most_swaths": 2}
    list(
        surveys_within(
            mission_with(), world(), **wanted, progress=lambda *each: told.append(each), tried=tried
        )
    )
    assert len(told) == len(tried) == 3
    assert told[0] == ("predicting surveys", 0, 9)


def test_the_fewest_swaths_are_found_for_each_number_of_stakes():
    found = list(surveys_within(mission_with(), world(), limit_m=10.0, probability=0.5, most_swaths=2))
    assert [(survey.swaths, survey.stakes) for survey in found] == [(2, 0), (2, 2), (2, 4)]
    assert str(found[1]).startswith("2 swaths with 2 stakes: ")


def test_the_prediction_on_moving_ice_counts_the_uncertain_motion_and_stakes_reduce_it():
    ice = IceConfig(pose_interval_s=60.0, stake_surveys=4)
    known = IceAssumptions(velocity_sigma_m_per_day=0.0, lowering_sigma_m_per_day=0.0)
    slow = {"speed_m_s": 0.02}
    at_rest = mission_with(stakes=2).model_copy(
        update={"rover": mission_with().rover.model_copy(update=slow)}
    )
    motions = (ice.model_copy(update={"assumed": known}), ice, ice.model_copy(update={"stake_surveys": 0}))
    errors = [
        predict_survey(at_rest.model_copy(update={"ice": one}), world(), limit_m=0.4).rmse_m
        for one in motions
    ]
    assert errors[0] <= errors[1] < errors[2]


@pytest.mark.long
def test_crossing_lines_and_another_order_are_tried_on_moving_ice():
    moving = mission_with().model_copy(update={"ice": IceConfig()})
    found = list(surveys_within(moving, world(), limit_m=50.0, probability=0.1, most_swaths=2))
    assert [(one.swaths, one.stakes, one.tie_lines) for one in found[:2]] == [(2, 0, 0), (2, 0, 2)]
    assert str(found[1]).startswith("2 swaths and 2 lines across: ")
    assert found[2].order == "alternate"
    assert str(found[2]).startswith("2 swaths, every second swath first: ")


def test_a_concave_area_of_any_size_is_predicted_and_lines_are_counted_apart_from_pieces():
    bay = shapely.Polygon(
        [(0, 0), (193, 0), (193, 171), (120, 171), (120, 33), (71, 33), (71, 171), (0, 171)]
    )
    (found,) = list(
        surveys_within(
            mission_with(), world(SurveyArea(bay, AREA.crs)), limit_m=10.0, probability=0.5, most_swaths=2
        )
    )[:1]
    assert found.swaths == 2
    assert found.pieces > 2
    assert str(found).startswith(f"2 lines in {found.pieces} pieces: ")


def test_a_prior_elsewhere_is_refused():
    far = SurveyArea.rectangle((5000.0, 0.0, 5200.0, 200.0), AREA.crs)
    with pytest.raises(InputError, match="no height on the area"):
        list(surveys_within(mission_with(), world(far), limit_m=0.4))


def test_patterns_without_a_number_of_swaths_to_vary_are_refused():
    wander = mission_with().model_copy(update={"planner": RandomWanderConfig(swaths=2)})
    with pytest.raises(ConfigError, match="lawnmower and wavy, not random-wander"):
        list(surveys_within(wander, world(), limit_m=1.0))


def test_the_lines_begin_with_the_survey_with_the_least_to_drive():
    site = RandomTerrain(source="random", size_m=200.0, relief_m=8.0, length_scale_m=80.0, step_m=2.0)
    asked = mission_with().model_copy(update={"terrain": site, "satellite": SatelliteConfig(cell_m=25.0)})
    printed = "\n".join(survey_options(asked, 10.0, 0.5).lines())
    assert printed.startswith("least to drive: 2 swaths: ")
    assert "not included       times without vision" in printed
    assert "(level " in printed


def test_a_class_that_no_survey_reaches_is_not_met(monkeypatch):
    site = RandomTerrain(source="random", size_m=200.0, relief_m=8.0, length_scale_m=80.0, step_m=2.0)
    asked = mission_with().model_copy(update={"terrain": site, "satellite": SatelliteConfig(cell_m=25.0)})
    # The search itself tries 24 surveys, which takes a minute.
    best = PredictedSurvey(8, 4, 0.21, 0.08, 0.0, 2100.0, 8)
    monkeypatch.setattr(
        "sim.mission.foresight.surveys_within", lambda *_, tried, **__: iter(tried.append(best) or ())
    )
    with pytest.raises(NotMetError, match="the best of them is 8 swaths with 4 stakes") as ending:
        survey_options(asked, 0.001, 0.5)
    assert ending.value.exit_code == 5

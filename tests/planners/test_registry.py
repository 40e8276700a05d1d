import pytest
from pydantic import TypeAdapter

import planners
from planners import LawnmowerConfig
from planners.config import PatternConfig
from planners.registry import PLANNERS, PlannerConfig, pattern_names, planner_config, planner_of, steering_of
from survey import ConfigError, SurveyArea

SITE = SurveyArea.rectangle((0.0, 0.0, 300.0, 300.0), "EPSG:32608")


def test_names_are_distinct_and_those_of_the_configurations():
    names = pattern_names()
    assert len(set(names)) == len(names) == len(PLANNERS)
    assert names == tuple(entry.config.model_fields["pattern"].default for entry in PLANNERS)


def test_every_configuration_of_the_package_is_registered():
    def leaves(kind):
        below = kind.__subclasses__()
        return {kind} if "pattern" in kind.model_fields else {leaf for each in below for leaf in leaves(each)}

    assert leaves(PatternConfig) == {entry.config for entry in PLANNERS}


@pytest.mark.parametrize("entry", PLANNERS, ids=lambda entry: entry.name)
def test_a_mission_reads_every_registered_pattern(entry):
    size = {"budget_m": 900.0} if "budget_m" in entry.config.model_fields else {"swaths": 2}
    assert type(planner_config({"pattern": entry.name, **size}, "the test")) is entry.config
    assert type(TypeAdapter(PlannerConfig).validate_python({"pattern": entry.name, **size})) is entry.config


def test_a_name_instead_of_a_configuration_is_a_type_error_that_says_what_was_expected():
    with pytest.raises(
        TypeError, match=r"a str for 'config'; a LawnmowerConfig, .*BestConfig.* was expected"
    ):
        planners.plan(SITE, None, "lawnmower")
    with pytest.raises(TypeError, match=r"'lawnmower' \(str\); one of LawnmowerConfig, .* was expected"):
        planner_of("lawnmower")


def test_unknown_patterns_and_settings_are_refused_by_name():
    with pytest.raises(ConfigError, match="the planner 'spiral' is not known; one of lawnmower, wavy"):
        planner_config({"pattern": "spiral"}, "the options")
    with pytest.raises(ConfigError, match="did you mean swaths"):
        planner_config({"pattern": "lawnmower", "swath": 3}, "the options")


def test_only_patterns_that_say_so_are_steered_or_need_a_kernel():
    assert steering_of(LawnmowerConfig(swaths=2)) is None
    assert steering_of(planners.RandomWanderConfig(swaths=2)) is not None
    assert planner_of(planners.WavyConfig(swaths=2)).needs_kernel(planners.WavyConfig(swaths=2))
    given = planners.WavyConfig(swaths=2, wavelength_m=90.0)
    assert not planner_of(given).needs_kernel(given)


def test_fleets_are_refused_by_patterns_of_one_rover():
    area = SurveyArea(SITE.polygon, SITE.crs, starts=[[1.0, 1.0]])
    with pytest.raises(ConfigError, match="choose one of lawnmower, wavy, best"):
        planners.plan(
            area, None, planners.RandomWanderConfig(swaths=2), fleet=planners.Fleet(return_to_start=True)
        )

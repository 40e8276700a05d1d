import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import LawnmowerConfig, Rover, plan
from planners.swaths.reference_lines import narrowest_heading
from survey import ConfigError, Dem, Grid, InputError, SurveyArea
from survey.core.config import validated

CRS = "EPSG:32608"
SITE = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), CRS)


def test_four_swaths_lie_at_odd_eighths_and_run_edge_to_edge():
    route = plan(SITE, None, LawnmowerConfig(swaths=4))
    expected = [
        [[0.0, 75.0], [600.0, 75.0]],
        [[600.0, 225.0], [0.0, 225.0]],
        [[0.0, 375.0], [600.0, 375.0]],
        [[600.0, 525.0], [0.0, 525.0]],
    ]
    assert [swath.xy.tolist() for swath in route.swaths] == expected
    assert route.spacing_m == 150.0
    assert route.length_m == 4 * 600.0 + 3 * 150.0
    assert route.prediction["length_m"] == pytest.approx(route.ground_length_m)
    assert route.prediction["n_turns"] == 6


@pytest.mark.parametrize("n", [1, 2, 3, 7, 10])
def test_length_is_that_of_swaths_and_connectors(n):
    route = plan(SITE, None, LawnmowerConfig(swaths=n), rover=Rover(speed_m_s=2.0, turn_s=5.0))
    assert route.length_m == pytest.approx(600.0 * n + 600.0 * (n - 1) / n, rel=1e-12)
    assert route.prediction["time_s"] == pytest.approx(
        route.ground_length_m / 2.0 + 2 * (n - 1) * 5.0, rel=1e-12
    )


def test_connectors_are_driven_as_transits_between_the_swaths():
    kinds = [leg.kind for leg in plan(SITE, None, LawnmowerConfig(swaths=3)).legs]
    assert kinds == ["swath", "transit", "swath", "transit", "swath"]


def test_a_spacing_gives_the_fewest_swaths_that_are_no_wider_apart():
    assert len(plan(SITE, None, LawnmowerConfig(spacing_m=150.0)).swaths) == 4
    assert len(plan(SITE, None, LawnmowerConfig(spacing_m=149.0)).swaths) == 5
    assert plan(SITE, None, LawnmowerConfig(spacing_m=149.0)).spacing_m == 120.0


@pytest.mark.parametrize(
    ("corner", "first"),
    [
        ("south-west", [0.0, 150.0]),
        ("south-east", [600.0, 150.0]),
        ("north-west", [0.0, 450.0]),
        ("north-east", [600.0, 450.0]),
    ],
)
def test_the_first_swath_begins_at_the_wanted_corner(corner, first):
    route = plan(SITE, None, LawnmowerConfig(swaths=2, start=corner))
    assert route.swaths[0].xy[0].tolist() == first


def test_a_route_leads_from_the_rover_s_start_to_the_nearest_corner():
    area = SurveyArea(SITE.polygon, CRS, starts=[[590.0, 10.0]])
    route = plan(area, None, LawnmowerConfig(swaths=2))
    assert route.legs[0].kind == "transit"
    assert route.path()[:2].tolist() == [[590.0, 10.0], [600.0, 150.0]]


def test_swaths_run_along_the_longer_side():
    tall = SurveyArea.rectangle((0.0, 0.0, 200.0, 600.0), CRS)
    assert narrowest_heading(tall.free) == 90.0
    assert narrowest_heading(SITE.free) == 0.0
    assert [leg.length_m for leg in plan(tall, None, LawnmowerConfig(swaths=2)).swaths] == [600.0, 600.0]


def test_inset_ends_and_outer_lines_keep_off_the_border():
    route = plan(SITE, None, LawnmowerConfig(swaths=3, outer_share=0.25, inset_share=0.5))
    # Three lines, 600 m = 2 D + 2 · 0.25 D, so D = 240 m.
    assert route.spacing_m == 240.0
    assert [swath.xy.tolist() for swath in route.swaths] == [
        [[120.0, 60.0], [480.0, 60.0]],
        [[480.0, 300.0], [120.0, 300.0]],
        [[120.0, 540.0], [480.0, 540.0]],
    ]


@given(
    heading_deg=st.floats(0.0, 180.0),
    n=st.integers(1, 12),
    sides=st.tuples(st.floats(50.0, 900.0), st.floats(50.0, 900.0)),
    turn_deg=st.floats(-180.0, 180.0),
)
@settings(max_examples=60)
def test_swaths_stay_on_any_rectangle(heading_deg, n, sides, turn_deg):
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * sides
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    area = SurveyArea(shapely.Polygon(corners @ [[c, s], [-s, c]] + [5e5, 6e6]), CRS)
    route = plan(area, None, LawnmowerConfig(swaths=n, heading_deg=heading_deg))
    # Ends lie on slanted borders as well as doubles allow at a northing of 6000 km: a nanometre each.
    assert area.polygon.buffer(1e-6).covers(route.line)


def test_exactly_one_of_swaths_and_spacing_is_accepted():
    with pytest.raises(ConfigError, match="either swaths or spacing_m"):
        validated(LawnmowerConfig, {}, "planner")
    with pytest.raises(ConfigError, match="either swaths or spacing_m"):
        validated(LawnmowerConfig, {"swaths": 2, "spacing_m": 10.0}, "planner")


@pytest.mark.parametrize("wrong", [{"swaths": 0}, {"spacing_m": 0.0}, {"swaths": 2, "width": 3.0}])
def test_settings_that_make_no_sense_are_refused(wrong):
    with pytest.raises(ConfigError):
        validated(LawnmowerConfig, wrong, "planner")


def test_a_prior_in_another_system_is_refused():
    prior = Dem.on(Grid((0.0, 0.0, 600.0, 600.0), 75.0, "EPSG:32633"), np.zeros((9, 9)))
    with pytest.raises(InputError, match="different systems"):
        plan(SITE, prior, LawnmowerConfig(swaths=4))

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import LawnmowerConfig, PiecewiseContinuousConfig, RandomWanderConfig, plan
from planners.registry import steering_of
from planners.steered_paths import Band, rollout
from planners.steering import Attitude, SteeringState, attitude_sensor
from survey import ConfigError, Dem, Grid, InputError, Leg, Route, SurveyArea
from survey.core.config import validated

CRS = "EPSG:32608"
SITE = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), CRS)
GRID = Grid((0.0, 0.0, 600.0, 600.0), 10.0, CRS)


def terrain(height):
    x, y = np.meshgrid(GRID.x, GRID.y)
    return Dem.on(GRID, height(x, y) + np.zeros_like(x))


def driven(config, dems, seeds):
    reference = plan(SITE, None, config)
    rngs = [np.random.default_rng(seed) for seed in seeds]
    return rollout(SITE, reference, steering_of(config), attitude_sensor(dems), rngs)


def headings_deg(leg):
    moves = np.diff(leg.xy, axis=0)
    return np.degrees(np.arctan2(moves[:, 1], moves[:, 0]))


def test_the_plan_holds_the_reference_swaths():
    route = plan(SITE, None, PiecewiseContinuousConfig(swaths=2))
    assert route.path().tolist() == plan(SITE, None, LawnmowerConfig(swaths=2)).path().tolist()
    assert route.pattern == "piecewise-continuous"


def test_only_steered_patterns_have_a_steering():
    assert steering_of(LawnmowerConfig(swaths=2)) is None
    assert steering_of(RandomWanderConfig(swaths=2)).step_m == 10.0


@pytest.mark.parametrize(("flag", "expected_deg"), [(1, 45.0), (0, -45.0)])
def test_ascent_and_descent_on_ground_that_rises_to_the_left(flag, expected_deg):
    steering = steering_of(PiecewiseContinuousConfig(swaths=2))
    attitude = Attitude(np.array([0.1]), np.zeros(1), np.zeros(1))
    heading = steering.steer(attitude, SteeringState(0.0, np.array([flag])))
    assert np.degrees(heading) == pytest.approx([expected_deg])


def test_slopes_are_the_same_whatever_way_the_rover_faces():
    # The plane z = 0.3 x − 0.2 y, sensed while facing in four directions.
    dem = terrain(lambda x, y: 0.3 * x - 0.2 * y)
    facing = np.radians([0.0, 70.0, 180.0, -130.0])
    sense = attitude_sensor([dem] * 4)
    attitude = sense(np.full((4, 2), 300.0), facing)
    east, north = attitude.slope_along(np.zeros(4)), attitude.slope_along(np.full(4, np.pi / 2))
    # Half a metre of difference on a bilinear plane is exact to rounding.
    assert east == pytest.approx(np.full(4, 0.3), abs=1e-9)
    assert north == pytest.approx(np.full(4, -0.2), abs=1e-9)


def test_level_ground_is_crossed_along_the_swath():
    route = driven(PiecewiseContinuousConfig(swaths=3), terrain(lambda x, _y: 0.0 * x), [1])[0]
    assert route.length_m == plan(SITE, None, LawnmowerConfig(swaths=3)).length_m


def test_steps_are_ten_metres_at_45_degrees_or_straight():
    dem = terrain(lambda x, y: 5.0 * np.sin(x / 40.0) * np.cos(y / 30.0))
    leg = driven(PiecewiseContinuousConfig(swaths=3, band_share=0.5), dem, [3])[0].swaths[0]
    steps = np.hypot(*np.diff(leg.xy, axis=0).T)
    inside = np.abs(leg.xy[1:, 1] - 100.0) < 99.0
    whole = inside & (leg.xy[1:, 0] < 599.0)
    assert steps[whole] == pytest.approx(np.full(whole.sum(), 10.0))
    off_line = np.abs(np.abs(headings_deg(leg)[whole]) - 45.0) < 1e-6
    straight = np.abs(headings_deg(leg)[whole]) < 1e-6
    assert (off_line | straight).all()
    assert off_line.any()


@pytest.mark.parametrize("config", [PiecewiseContinuousConfig(swaths=4), RandomWanderConfig(swaths=4)])
def test_deviation_stays_within_half_a_spacing_and_swaths_are_crossed_whole(config):
    dem = terrain(lambda x, y: 5.0 * np.sin(x / 40.0) * np.cos(y / 30.0))
    for route in driven(config, [dem] * 5, range(5)):
        for leg in route.swaths:
            assert np.abs(leg.xy[:, 1] - leg.axis[0, 1]).max() <= 75.0 + 1e-9
            assert leg.xy[0].tolist() == leg.axis[0].tolist()
            assert leg.xy[-1, 0] == leg.axis[-1, 0]


def test_a_smaller_band_is_respected():
    config = RandomWanderConfig(swaths=2, band_share=0.1)
    for route in driven(config, [terrain(lambda x, _y: x)] * 3, range(3)):
        assert max(np.abs(leg.xy[:, 1] - leg.axis[0, 1]).max() for leg in route.swaths) <= 30.0 + 1e-9


def test_a_rover_drives_the_same_alone_and_among_others():
    dems = [terrain(lambda x, y, k=k: 4.0 * np.sin(x / (30.0 + 5 * k)) * np.sin(y / 50.0)) for k in range(4)]
    together = driven(PiecewiseContinuousConfig(swaths=3), dems, [10, 11, 12, 13])
    for dem, seed, route in zip(dems, [10, 11, 12, 13], together, strict=True):
        assert (
            driven(PiecewiseContinuousConfig(swaths=3), dem, [seed])[0].path().tolist()
            == route.path().tolist()
        )


def test_the_wander_is_blind():
    config = RandomWanderConfig(swaths=3)
    hill, hollow = (
        terrain(lambda x, y, s=s: s * 5.0 * np.sin(x / 40.0) * np.cos(y / 30.0)) for s in (1.0, -1.0)
    )
    assert driven(config, hill, [5])[0].path().tolist() == driven(config, hollow, [5])[0].path().tolist()


def test_rules_switch_as_often_as_asked():
    steering = steering_of(PiecewiseContinuousConfig(swaths=2, toggle_probability=0.1))
    state, rng, n_flips = SteeringState(0.0, np.zeros(4000, dtype=np.int64)), np.random.default_rng(0), 0
    after = steering.after_step(state, rng.random(4000))
    n_flips = int((after.mode != state.mode).sum())
    # Binomial: 400 ± 19, five standard deviations are 95.
    assert abs(n_flips - 400) < 95


def test_the_wander_draws_every_candidate_alike():
    steering = steering_of(RandomWanderConfig(swaths=2, toggle_probability=0.5))
    modes = steering.begin(0.0, np.random.default_rng(0).random(6000)).mode
    after = steering.after_step(SteeringState(0.0, modes), np.random.default_rng(1).random(6000)).mode
    # Binomial: 2000 ± 37, five standard deviations are 183.
    assert np.abs(np.bincount(modes, minlength=3) - 2000).max() < 183
    assert np.abs(np.bincount(after, minlength=3) - 2000).max() < 183


@given(seed=st.integers(0, 2**31), swaths=st.integers(1, 7), heading_deg=st.floats(0.0, 180.0))
@settings(max_examples=25)
def test_no_metre_leaves_ground_with_holes_and_bays(seed, swaths, heading_deg):
    outline = shapely.Polygon([(0, 0), (600, 0), (560, 380), (300, 220), (40, 400)])
    area = SurveyArea(outline, CRS, no_go=(shapely.box(220.0, 60.0, 300.0, 130.0),))
    config = RandomWanderConfig(swaths=swaths, heading_deg=heading_deg)
    sense = attitude_sensor(terrain(lambda x, _y: x))
    reference = plan(area, None, config)
    route = rollout(area, reference, steering_of(config), sense, [np.random.default_rng(seed)])[0]
    # Ends on slanted borders are right to rounding at hundreds of metres, far below a micrometre.
    assert area.free.buffer(2e-6).covers(route.line)


def test_the_band_narrows_beside_a_hole():
    area = SurveyArea(SITE.polygon, CRS, no_go=(shapely.box(200.0, 120.0, 300.0, 200.0),))
    band = Band.about(np.array([[0.0, 100.0], [600.0, 100.0]]), 60.0, area.free, 10.0)
    left = np.interp([100.0, 185.0, 195.0, 250.0, 305.0, 320.0], band.knots_m, band.left_m)
    assert left == pytest.approx([60.0, 60.0, 20.0, 20.0, 20.0, 60.0], abs=1e-6)
    assert band.right_m == pytest.approx(np.full(len(band.knots_m), 60.0))


def test_dems_on_different_grids_are_refused():
    other = Dem.on(Grid((0.0, 0.0, 600.0, 600.0), 20.0, CRS), np.zeros((31, 31)))
    with pytest.raises(InputError, match="different grids"):
        attitude_sensor([terrain(lambda x, _y: x), other])


def test_headings_that_do_not_advance_are_refused():
    with pytest.raises(ConfigError, match="80 degrees"):
        validated(PiecewiseContinuousConfig, {"swaths": 2, "candidates_deg": [-90.0, 0.0, 90.0]}, "planner")


def test_a_route_without_spacing_cannot_be_steered():
    route = Route((Leg("swath", [[0.0, 0.0], [600.0, 0.0]]),), CRS, "line")
    steering = steering_of(RandomWanderConfig(swaths=1))
    with pytest.raises(InputError, match="spacing"):
        rollout(SITE, route, steering, attitude_sensor(terrain(lambda x, _y: x)), [np.random.default_rng(0)])

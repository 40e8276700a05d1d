"""What rovers can stand, how many there are and how they turn, through the one entry `plan`."""

import logging

import numpy as np
import pytest
import shapely
from shapely import LineString

from planners import (
    BestConfig,
    Fleet,
    LawnmowerConfig,
    PiecewiseContinuousConfig,
    Rover,
    VarianceDrivenConfig,
    WavyConfig,
    plan,
)
from planners.registry import steering_of
from planners.routes.traversability import drivable
from planners.steered_paths import rollout
from planners.steering import attitude_sensor
from survey import ConfigError, Dem, Grid, InputError, SurveyArea
from survey.reconstruction.gp.kernels import SquaredExponential

CRS = "EPSG:32608"
KERNEL = SquaredExponential(30.0, 150.0)
GRID = Grid((-40.0, -40.0, 640.0, 640.0), 10.0, CRS)
X, Y = GRID.xy[:, 0].reshape(GRID.shape), GRID.xy[:, 1].reshape(GRID.shape)
HILL = Dem.on(GRID, 60.0 * np.exp(-((X - 300.0) ** 2 + (Y - 350.0) ** 2) / (2.0 * 60.0**2)))
"""Up to 31 degrees steep at 60 m from its top, nearly level from 200 m on."""
SITE = SurveyArea(shapely.box(0.0, 0.0, 600.0, 600.0), CRS, starts=[[10.0, 10.0]])


def assert_gentle(route, limit_deg: float) -> None:
    slopes = HILL.slope()
    driven = shapely.get_coordinates(shapely.segmentize([LineString(leg.xy) for leg in route.legs], 2.0))
    assert slopes.at(driven).max() <= limit_deg


@pytest.mark.parametrize(
    "config",
    [
        LawnmowerConfig(spacing_m=60.0),
        WavyConfig(spacing_m=60.0),
        LawnmowerConfig(spacing_m=60.0, tie_lines=2),
        BestConfig(budget_m=2000.0, heading_deg=0.0),
        VarianceDrivenConfig(budget_m=1500.0, n_places=6),
        PiecewiseContinuousConfig(swaths=5),
    ],
    ids=lambda config: config.pattern,
)
def test_no_metre_is_too_steep_for_the_rover(config):
    rover = Rover(max_pitch_deg=20.0, max_roll_deg=15.0)
    route = plan(SITE, HILL, config, rover=rover, kernel=KERNEL, sample_step_m=30.0)
    assert_gentle(route, 15.0)
    site = drivable(SITE, rover, HILL)
    assert route.prediction["left_out_share"] == pytest.approx(site.left_out_share(SITE))
    # A ring of steep ground and the top that it cuts off, all of it within 3 standard deviations of the hill.
    assert 0.05 < site.left_out_share(SITE) < np.pi * 180.0**2 / SITE.free.area


def test_a_rover_that_steers_itself_keeps_to_its_ground():
    rover, config = Rover(max_pitch_deg=15.0), PiecewiseContinuousConfig(swaths=5)
    route = plan(SITE, HILL, config, rover=rover)
    ground = drivable(SITE, rover, HILL).within(SITE)
    rngs = [np.random.default_rng(seed) for seed in range(3)]
    steering = steering_of(config)
    assert steering is not None
    for driven in rollout(ground, route, steering, attitude_sensor([HILL] * 3), rngs):
        assert driven.length_m > route.length_m
        assert_gentle(driven, 15.0)


def test_what_is_left_out_is_said_with_share_place_and_reason(caplog):
    with caplog.at_level(logging.WARNING, logger="planners"):
        plan(SITE, HILL, LawnmowerConfig(swaths=4), rover=Rover(max_pitch_deg=15.0))
    assert len(caplog.records) == 1
    assert "% of the area is left out" in caplog.text
    assert "(too steep)" in caplog.text
    assert "(cut off)" in caplog.text


def test_an_island_without_a_start_is_left_out_and_one_with_a_rover_is_not(caplog):
    outline = shapely.MultiPolygon(
        [shapely.box(0.0, 0.0, 300.0, 300.0), shapely.box(400.0, 0.0, 600.0, 300.0)]
    )
    with caplog.at_level(logging.WARNING, logger="planners"):
        alone = plan(SurveyArea(outline, CRS), None, LawnmowerConfig(spacing_m=50.0, heading_deg=90.0))
    assert alone.line.bounds[2] < 301.0
    assert "40.0 % of the area is left out: 59999 m² around (500.0, 150.0) (cut off)" in caplog.text
    starts = [[10.0, 10.0], [410.0, 10.0]]
    config = LawnmowerConfig(spacing_m=50.0, heading_deg=90.0)
    both = plan(SurveyArea(outline, CRS, starts=starts), None, config, fleet=Fleet(rovers=2))
    assert both.prediction["left_out_share"] == 0.0
    assert {leg.rover for leg in both.legs if leg.xy[0, 0] > 350.0} == {1}
    assert len(both.swaths) == 6 + 4


def test_limits_without_heights_and_starts_on_steep_ground_are_refused():
    with pytest.raises(InputError, match="need heights; give a prior DEM"):
        plan(SITE, None, LawnmowerConfig(swaths=4), rover=Rover(max_roll_deg=20.0))
    steep = SurveyArea(SITE.polygon, CRS, starts=[[300.0, 290.0]])
    with pytest.raises(
        InputError, match=r"the start \(300.0, 290.0\) is on ground .* \(too steep\); move it"
    ):
        plan(steep, HILL, LawnmowerConfig(swaths=4), rover=Rover(max_pitch_deg=15.0))
    with pytest.raises(InputError, match="no ground is left to drive on"):
        plan(SITE, Dem.on(GRID, X), LawnmowerConfig(swaths=4), rover=Rover(max_pitch_deg=20.0))


def test_several_rovers_share_the_swaths_and_come_home():
    config = LawnmowerConfig(swaths=12)
    alone = plan(SITE, None, config, fleet=Fleet(return_to_start=True))
    route = plan(SITE, None, config, fleet=Fleet(rovers=3))
    assert route.n_rovers == 3
    assert len(route.swaths) == len(alone.swaths) == 12
    for rover in range(3):
        path = route.path(rover)
        assert path[0].tolist() == path[-1].tolist() == [10.0, 10.0]
    assert alone.prediction["time_s"] / 3.0 <= route.prediction["time_s"] <= alone.prediction["time_s"]


def test_starts_must_fit_the_fleet():
    two = SurveyArea(SITE.polygon, CRS, starts=[[10.0, 10.0], [590.0, 10.0]])
    route = plan(two, None, LawnmowerConfig(swaths=6), fleet=Fleet(rovers=2))
    assert [route.path(rover)[0].tolist() for rover in (0, 1)] == two.starts.tolist()
    with pytest.raises(InputError, match="2 starts for 3 rovers"):
        plan(two, None, LawnmowerConfig(swaths=6), fleet=Fleet(rovers=3))
    nowhere = SurveyArea(SITE.polygon, CRS)
    for crew in ({"fleet": Fleet(return_to_start=True)}, {"rover": Rover(battery_j=1e7)}):
        with pytest.raises(InputError, match="mark a start"):
            plan(nowhere, None, LawnmowerConfig(swaths=6), **crew)


def test_a_battery_is_recharged_at_the_start_and_its_time_counted():
    endless = Rover(turn_s=0.0)
    tired = Rover(turn_s=0.0, battery_j=3_000.0 * endless.flat_j_per_m, recharge_s=3600.0)
    config = LawnmowerConfig(swaths=8)
    route = plan(SITE, None, config, rover=tired)
    n = route.prediction["n_recharges"]
    assert n >= np.ceil(route.length_m / 3000.0) - 1
    assert route.prediction["time_s"] == pytest.approx(route.ground_length_m + n * 3600.0)


def test_a_single_rover_finishes_where_it_is_asked_to():
    route = plan(SITE, None, LawnmowerConfig(swaths=4), fleet=Fleet(end_m=(590.0, 300.0)))
    assert route.path()[-1].tolist() == [590.0, 300.0]
    with pytest.raises(ValueError, match="end_m is for a single rover"):
        Fleet(rovers=2, end_m=(0.0, 0.0))


def test_rovers_that_keep_apart_wait_and_the_wait_is_in_the_time():
    fleet = Fleet(rovers=3, separation_m=20.0)
    route = plan(SITE, None, LawnmowerConfig(swaths=9), fleet=fleet)
    waits = [route.prediction[f"wait_s_rover_{rover}"] for rover in range(3)]
    assert waits[0] == 0.0
    assert route.prediction["time_s"] >= max(waits)


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize(
    "config", [LawnmowerConfig(spacing_m=25.0), WavyConfig(spacing_m=40.0, wavelength_m=90.0)]
)
def test_a_rover_that_cannot_pivot_drives_no_bend_sharper_than_its_radius(config, reverse):
    radius_m = 8.0
    outline = shapely.Polygon([(0, 0), (400, 0), (420, 300), (200, 340), (0, 300)])
    area = SurveyArea(outline, CRS, no_go=(shapely.box(150.0, 120.0, 220.0, 180.0),))
    route = plan(area, None, config, rover=Rover(turn_radius_m=radius_m, reverse=reverse))
    assert area.free.covers(route.line)
    path = route.path()
    moves = np.diff(path, axis=0)
    bend = np.diff(np.unwrap(np.arctan2(moves[:, 1], moves[:, 0])))
    step = np.hypot(*moves.T)
    turning = np.abs(bend) < np.radians(150.0)  # the others are cusps of a rover that reverses
    assert reverse or turning.all()
    # A polyline of chords bends by mean step / radius at each waypoint; waves are drawn with 16 chords.
    limit = 0.5 * (step[:-1] + step[1:]) / radius_m
    assert (np.abs(bend) <= 1.05 * limit + 0.02)[turning].all()


def test_patterns_that_bend_at_will_are_refused_to_rovers_that_cannot():
    for config in (PiecewiseContinuousConfig(swaths=2), VarianceDrivenConfig(budget_m=900.0)):
        for crew in ({"rover": Rover(turn_radius_m=3.0)}, {"fleet": Fleet(rovers=2)}):
            with pytest.raises(ConfigError, match="is for one rover that pivots"):
                plan(SITE, None, config, kernel=KERNEL, **crew)


def test_swaths_run_up_the_slope_where_that_is_wanted():
    tilted = Dem.on(GRID, 0.1 * X + 0.1 * Y)
    route = plan(SITE, tilted, LawnmowerConfig(swaths=5, heading_rule="slope"))
    axis = route.swaths[2].axis
    assert np.degrees(np.arctan2(*(axis[1] - axis[0])[::-1])) % 180.0 == pytest.approx(45.0, abs=1e-6)


def test_progress_is_reported_to_the_end():
    calls = []
    plan(SITE, None, BestConfig(swaths=2, heading_deg=0.0), kernel=KERNEL, sample_step_m=30.0,
         progress=lambda what, done, total: calls.append((what, done, total)))  # fmt: skip
    assert [done for _, done, _ in calls] == list(range(1, len(calls) + 1))
    assert calls[-1][1] == calls[-1][2]

"""Which pieces of a line are driven, joined around a notch or left out, on sites with known answers."""

import numpy as np
import pytest
import shapely

from planners import Fleet, LawnmowerConfig, PiecewiseContinuousConfig, Rover, WavyConfig, plan
from planners.routes.shortest_paths import FreeGround
from planners.swaths.heading import undivided_heading
from planners.swaths.reference_lines import shortest_m, swaths_text
from planners.swaths.worth_driving import worth_driving
from survey import SurveyArea

CRS = "EPSG:32608"
FIELD = shapely.box(0.0, 0.0, 600.0, 300.0)
THREE = LawnmowerConfig(swaths=3, heading_deg=0.0)
"""Lines at 50, 150 and 250 m; a swath takes half of 100 m and four turns of 4 m: 66 m."""


def planned(ground, config=THREE, **crew):
    area = SurveyArea(ground, CRS)
    route = plan(area, None, config, **crew)
    assert all(area.free.covers(shapely.LineString(leg.xy)) for leg in route.legs)
    return route


def test_a_notch_that_is_short_to_go_around_does_not_end_a_swath():
    # 20 m down, 20 m across and 20 m up again: less than the 66 m that another piece takes.
    route = planned(FIELD - shapely.box(290.0, 230.0, 310.0, 300.0))
    assert swaths_text(route) == "3 swaths"
    around = max(route.swaths, key=lambda leg: len(leg.xy))
    assert around.length_m == pytest.approx(580.0 + 60.0, abs=0.1)
    np.testing.assert_allclose(np.sort(around.axis, axis=0), [[0.0, 250.0], [600.0, 250.0]])


@pytest.mark.parametrize("ground", [FIELD, FIELD - shapely.box(290.0, 200.0, 310.0, 300.0)])
def test_a_deep_notch_ends_a_swath_and_a_rover_with_a_turning_radius_bends_around_none(ground):
    deep = planned(FIELD - shapely.box(290.0, 200.0, 310.0, 300.0))
    assert swaths_text(deep) == "3 lines in 4 pieces"
    shallow = planned(FIELD - shapely.box(290.0, 230.0, 310.0, 300.0), rover=Rover(turn_radius_m=5.0))
    assert swaths_text(shallow) == "3 lines in 4 pieces"


def test_a_piece_shorter_than_what_it_takes_is_left_out_unless_all_are_wanted():
    # Behind a deep notch of 20 m the line at 250 m has another 40 m.
    ground = FIELD - shapely.box(540.0, 150.5, 560.0, 300.0)
    assert sorted(leg.length_m for leg in planned(ground).swaths) == pytest.approx([540.0, 600.0, 600.0])
    every = THREE.model_copy(update={"shortest_m": 0.0})
    assert sorted(leg.length_m for leg in planned(ground, every).swaths) == pytest.approx(
        [40.0, 540.0, 600.0, 600.0]
    )


@pytest.mark.parametrize(("gap_m", "n_kept"), [(20.0, 0), (120.0, 3)])
def test_an_arm_across_the_lines_keeps_short_pieces_where_no_swath_is_near(gap_m, n_kept):
    # Six lines cross the arm, 30 m wide; 41 m are worth driving, and 61.5 m around a swath need no further one.
    ground = (
        FIELD
        | shapely.box(600.0, 0.0, 630.0 + gap_m, 20.0)
        | shapely.box(600.0 + gap_m, 0.0, 630.0 + gap_m, 300.0)
    )
    route = planned(ground, LawnmowerConfig(spacing_m=50.0, heading_deg=0.0))
    assert sum(leg.xy[:, 0].max() > 600.0 + gap_m for leg in route.swaths) == n_kept
    assert route.n_lines == 6


@pytest.mark.parametrize("n", [1, 2, 5, 8])
@pytest.mark.parametrize(
    "outline",
    [
        [(0, 0), (600, 0), (300, 450)],
        [(0, 0), (500, 40), (900, 30), (950, 90), (480, 210), (100, 160)],
        [(0, 0), (600, 0), (600, 600), (350, 600), (350, 200), (250, 200), (250, 600), (0, 600)],
    ],
)
def test_the_number_of_swaths_that_is_asked_for_is_the_number_of_lines(outline, n):
    for crew in ({}, {"rover": Rover(turn_radius_m=3.0)}):
        route = planned(shapely.Polygon(outline), LawnmowerConfig(swaths=n), **crew)
        assert route.n_lines == n
    assert planned(shapely.Polygon(outline), WavyConfig(swaths=n, wavelength_m=150.0)).n_lines == n


def test_outer_lines_move_in_from_a_tip():
    least_m = shortest_m(LawnmowerConfig(swaths=4), 100.0, Rover().turn_m)
    tip = shapely.Polygon([(0, 0), (600, 0), (300, 400)])
    lengths = [leg.length_m for leg in planned(tip, LawnmowerConfig(swaths=8, heading_deg=0.0)).swaths]
    assert least_m == 66.0
    assert len(lengths) == 8
    assert min(lengths) > 50.0


def test_the_swath_of_a_pocket_is_a_piece_of_the_line_beside_it():
    # The upper strip of the field goes on to the right as a shelf that its line, at 250 m, misses.
    area = SurveyArea(FIELD | shapely.box(600.0, 260.0, 900.0, 300.0), CRS, starts=[(1.0, 1.0)])
    returning = Fleet(return_to_start=True)
    route = plan(area, None, THREE, fleet=returning)
    assert route.n_lines == 3
    assert max(leg.xy[:, 0].max() for leg in route.swaths) == pytest.approx(900.0, abs=1.0)


def test_swaths_that_are_steered_about_stay_straight_at_a_notch():
    ground = FIELD - shapely.box(290.0, 230.0, 310.0, 300.0)
    route = planned(ground, PiecewiseContinuousConfig(swaths=3, heading_deg=0.0))
    assert [len(leg.xy) for leg in route.swaths] == [2, 2, 2, 2]


def test_swaths_run_beside_long_zones_where_the_area_is_as_narrow_either_way():
    slits = [shapely.box(x, 100.0, x + 2.0, 500.0) for x in (120.0, 220.0, 420.0)]
    ground = shapely.box(0.0, 0.0, 600.0, 600.0) - shapely.union_all(slits)
    config = LawnmowerConfig(swaths=6)
    assert undivided_heading(FreeGround(ground), config) == 90.0
    assert swaths_text(planned(ground, config)) == "6 swaths"


def test_several_rovers_share_what_is_worth_driving():
    ground = FIELD - shapely.box(540.0, 150.5, 560.0, 300.0)
    area = SurveyArea(ground, CRS, starts=[(1.0, 1.0)])
    route = plan(area, None, THREE, fleet=Fleet(rovers=2))
    assert sorted(leg.length_m for leg in route.swaths) == pytest.approx([540.0, 600.0, 600.0])


def test_nothing_is_left_out_without_a_shortest_length():
    assert worth_driving([], FreeGround(FIELD), 10.0) == []

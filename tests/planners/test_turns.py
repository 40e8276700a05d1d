"""Turns of bounded curvature: known lengths, ends that are met, ground that is kept."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString

from planners.routes.rover import Turning
from planners.routes.shortest_paths import FreeGround
from planners.routes.tours import connect
from planners.routes.turns import (
    Turns,
    dubins_words,
    moved,
    reeds_shepp_words,
    traced,
    turn_length_m,
    word_length,
)
from planners.swaths.decomposition import swaths_on
from planners.swaths.reference_lines import shortened
from survey.core.errors import ConfigError, InputError

poses = st.tuples(st.floats(-6, 6), st.floats(-6, 6), st.floats(-4, 4))


@settings(max_examples=150)
@given(poses, poses, st.floats(0.5, 3.0))
def test_every_word_leads_to_the_goal(start, goal, radius_m) -> None:  # type: ignore[no-untyped-def]
    words = dubins_words(start, goal, radius_m)
    assert all(length >= 0.0 for word in words for _, length in word)
    for word in words + reeds_shepp_words(start, goal, radius_m):
        here = start
        for steering, length in word:
            here = moved(here, steering, length, radius_m)
        assert np.hypot(here[0] - goal[0], here[1] - goal[1]) < 1e-5
        assert abs(np.sin(0.5 * (here[2] - goal[2]))) < 1e-5


@settings(max_examples=100)
@given(poses, poses)
def test_reversing_never_lengthens_and_works_both_ways(start, goal) -> None:  # type: ignore[no-untyped-def]
    there = word_length(reeds_shepp_words(start, goal, 1.0)[0])
    back = word_length(reeds_shepp_words(goal, start, 1.0)[0])
    assert there == pytest.approx(back, abs=1e-6)
    assert there <= word_length(dubins_words(start, goal, 1.0)[0]) + 1e-9
    assert there >= np.hypot(goal[0] - start[0], goal[1] - start[1]) - 1e-9


@pytest.mark.parametrize(
    ("goal", "reverse", "length_m"),
    [
        ((10.0, 0.0, 0.0), False, 10.0),
        ((0.0, 4.0, np.pi), False, 2.0 * np.pi),  # a half circle
        ((0.0, 14.0, np.pi), False, 2.0 * np.pi + 10.0),  # two quarters and a straight
        ((-10.0, 0.0, 0.0), True, 10.0),  # straight back
        # Turning on the spot takes three cusped arcs of 60 degrees when reversing is allowed.
        ((0.0, 0.0, np.pi), True, 2.0 * np.pi),
    ],
)
def test_known_lengths(goal: tuple[float, float, float], reverse: bool, length_m: float) -> None:
    turning = Turning(turn_radius_m=2.0, reverse=reverse)
    assert turn_length_m((0.0, 0.0, 0.0), goal, turning) == pytest.approx(length_m, abs=1e-9)


def test_narrow_swaths_take_a_loop_that_no_shorter_curve_can_replace() -> None:
    # Two parallel tracks 1 apart with unit radius: right, long left, right (Dubins' CCC).
    half = np.arccos((1.0 + 0.5) / 2.0)
    expected = 2.0 * half + (np.pi + 2.0 * half)
    assert turn_length_m((0, 0, 0), (0, 1, np.pi), Turning(turn_radius_m=1.0)) == pytest.approx(
        expected, abs=1e-9
    )


def test_traced_arcs_keep_the_radius() -> None:
    word = dubins_words((0, 0, 0), (3, 7, 2.0), 2.0)[0]
    points = traced((0, 0, 0), word, 2.0)
    moves = np.diff(points, axis=0)
    bend = np.abs(np.diff(np.unwrap(np.arctan2(moves[:, 1], moves[:, 0]))))
    step = np.hypot(*moves.T)
    # A chord of an arc bends by its own angle: at most mean step / radius at each waypoint.
    assert (bend <= 0.5 * (step[:-1] + step[1:]) / 2.0 * 1.001 + 1e-9).all()


@pytest.mark.parametrize("reverse", [False, True])
def test_curved_surveys_stay_on_the_ground(reverse: bool) -> None:
    ground = FreeGround(shapely.box(0.0, 0.0, 120.0, 100.0) - shapely.box(55.0, 40.0, 75.0, 60.0))
    turning = Turning(turn_radius_m=4.0, reverse=reverse)
    swaths = [shortened(swath, 9.0) for swath in swaths_on(ground, 10.0, 90.0)]
    legs = connect(swaths, ground, start=(2.0, 2.0), turning=turning)
    assert all(ground.covers(LineString(leg.xy)) for leg in legs)
    assert any(len(leg.xy) > 5 for leg in legs if leg.kind == "transit")


def test_a_turn_round_an_obstacle_is_chained() -> None:
    ground = FreeGround(shapely.box(0.0, 0.0, 100.0, 100.0) - shapely.box(40.0, 20.0, 60.0, 100.0))
    turns = Turns(ground, Turning(turn_radius_m=3.0))
    points = turns.between((20.0, 80.0, np.pi / 2), (80.0, 80.0, np.pi / 2))
    assert ground.covers(LineString(points))


def test_a_turn_without_room_is_refused_with_the_fix() -> None:
    ground = FreeGround(shapely.box(0.0, 0.0, 100.0, 6.0))
    with pytest.raises(InputError, match="no turn of radius 8 m"):
        Turns(ground, Turning(turn_radius_m=8.0)).between((50.0, 2.0, 0.0), (50.0, 4.0, np.pi))
    with pytest.raises(ConfigError, match="pivots on the spot"):
        turn_length_m((0, 0, 0), (1, 0, 0), Turning())

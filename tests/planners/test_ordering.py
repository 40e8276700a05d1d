from itertools import pairwise

import numpy as np
import pytest
import shapely

from planners.routes.shortest_paths import FreeGround
from planners.routes.tours import Tours, connect
from survey import InputError

FIELD = FreeGround(shapely.box(0.0, 0.0, 100.0, 100.0))
LINES = [np.array([[x, 10.0], [x, 90.0]]) for x in (10.0, 30.0, 50.0, 70.0)]


def length_m(legs, kind):
    return sum(leg.length_m for leg in legs if leg.kind == kind)


def test_shuffled_swaths_are_swept_back_and_forth():
    legs = connect([LINES[i] for i in (2, 0, 3, 1)], FIELD)
    assert length_m(legs, "swath") == pytest.approx(320.0)
    assert length_m(legs, "transit") == pytest.approx(60.0)


def test_a_route_begins_and_ends_where_it_has_to():
    legs = connect(LINES, FIELD, start=(90.0, 10.0), end=(0.0, 0.0))
    assert legs[0].xy[0].tolist() == [90.0, 10.0]
    assert legs[-1].xy[-1].tolist() == [0.0, 0.0]
    assert all(np.array_equal(a.xy[-1], b.xy[0]) for a, b in pairwise(legs))


def test_transits_go_around_obstacles():
    ground = FreeGround(shapely.box(0.0, 0.0, 100.0, 100.0) - shapely.box(35.0, 20.0, 45.0, 100.0))
    legs = connect([LINES[1][::-1], LINES[2]], ground)
    assert all(ground.covers(shapely.linestrings(leg.xy)) for leg in legs)


def test_every_swath_is_driven_once_in_either_direction():
    legs = connect(LINES, FIELD)
    driven = sorted(float(leg.xy[0, 0]) for leg in legs if leg.kind == "swath")
    assert driven == [10.0, 30.0, 50.0, 70.0]


def test_no_swaths_and_starts_outside_are_refused():
    with pytest.raises(InputError, match="no swaths to connect"):
        connect([], FIELD)
    with pytest.raises(InputError, match="outside the free ground"):
        connect(LINES, FIELD, start=(500.0, 0.0))


def test_ground_that_is_cut_off_is_named():
    two = FreeGround(shapely.MultiPolygon([shapely.box(0, 0, 20, 100), shapely.box(40, 0, 60, 100)]))
    with pytest.raises(InputError, match="1 swaths lie on 1 parts of the ground that no way joins"):
        connect([LINES[0], LINES[2]], two)


def test_a_tour_of_some_swaths_visits_those_only():
    tours = Tours(LINES, FIELD, [((0.0, 0.0), (0.0, 0.0))])
    tour = tours.best(np.array([1, 3]))
    assert tour[0] == tours.first_depot
    assert sorted((tour[1:] >> 1).tolist()) == [1, 3]

import numpy as np
import pytest
import shapely

from planners.routes.local_search import (
    boustrophedon,
    improved,
    nearest_next,
    tour_length,
    transit_length,
    transits,
)
from planners.routes.shortest_paths import FreeGround

ENDS = np.array([[x, y] for x in (10.0, 30.0, 50.0, 70.0) for y in (10.0, 90.0)])
DEPOT = np.array([[5.0, 5.0], [5.0, 5.0]])


@pytest.fixture(scope="module")
def table():
    ground = FreeGround(shapely.box(0.0, 0.0, 100.0, 100.0))
    return transits(ground.network(ground.inside(np.vstack([ENDS, DEPOT]))), np.zeros(10))


def test_an_entry_is_the_straight_distance_on_open_ground(table):
    assert transit_length(1, 3, table) == pytest.approx(20.0, abs=1e-4)
    assert transit_length(0, 3, table) == pytest.approx(np.hypot(20.0, 80.0), abs=1e-4)


def test_the_given_order_is_entered_at_the_nearer_ends():
    assert boustrophedon(ENDS, np.arange(4), 8).tolist() == [8, 0, 3, 4, 7]


def test_a_random_order_is_improved_to_a_sweep(table):
    items = np.array([8, 4, 1, 6, 2])
    better = improved(items, table, np.random.default_rng(3).random((200, 3)))
    assert sorted(better >> 1) == [0, 1, 2, 3, 4]
    assert tour_length(better, table) < 0.7 * tour_length(items, table)
    assert tour_length(improved(better, table, np.zeros((0, 3))), table) == pytest.approx(
        tour_length(better, table), abs=1e-3
    )


def test_nearest_next_drives_to_the_nearest_end(table):
    assert nearest_next(np.array([8, 6, 4, 2, 0]), table).tolist() == [8, 0, 3, 4, 7]


def test_free_ends_cost_nothing():
    ground = FreeGround(shapely.box(0.0, 0.0, 100.0, 100.0))
    free = np.r_[np.zeros(8), 1.0, 1.0]
    table = transits(ground.network(ground.inside(np.vstack([ENDS, DEPOT]))), free)
    assert transit_length(8, 7, table) == 0.0

"""Replanning after the loss of a rover: who drives what is left, from where."""

import numpy as np
import pytest
import shapely

from planners.routes.fleet import share
from planners.routes.replanning import Loss, cut_short, remaining_swaths, replanned
from planners.routes.rover import Rover
from planners.routes.shortest_paths import FreeGround
from survey.core.errors import ConfigError, InputError
from survey.data.route import Leg, Route

CRS = "EPSG:32608"
GROUND = FreeGround(shapely.box(0.0, 0.0, 80.0, 100.0))
HOMES = np.array([[0.0, 0.0], [80.0, 0.0]])
LINES = [np.array([[x, 5.0], [x, 95.0]]) for x in (10.0, 30.0, 50.0, 70.0)]


def two_rovers() -> Route:
    return Route(share(LINES, GROUND, HOMES), CRS, "lines")


def swath_m(route: Route) -> float:
    return sum(leg.length_m for leg in route.swaths)


def test_every_metre_of_swath_is_driven_once_after_a_loss():
    route = two_rovers()
    loss = Loss(1, 60.0, 60.0)
    after = replanned(route, loss, GROUND, rover=Rover())
    assert swath_m(after) == pytest.approx(4 * 90.0)
    lost = [leg for leg in after.legs if leg.rover == 1]
    assert sum(leg.length_m for leg in lost) == pytest.approx(60.0)
    np.testing.assert_allclose(after.path(0)[[0, -1]], HOMES[[0, 0]])


def test_a_change_of_route_that_leaves_the_ground_is_refused(monkeypatch: pytest.MonkeyPatch):
    pillar = FreeGround(shapely.box(0.0, 0.0, 80.0, 100.0) - shapely.box(35.0, 0.0, 45.0, 50.0))
    route = Route(share(LINES, pillar, HOMES), CRS, "lines")
    assert replanned(route, Loss(1, 60.0, 60.0), pillar, rover=Rover()).n_rovers == 2
    across = (Leg("swath", [[10.0, 20.0], [70.0, 20.0]]),)
    monkeypatch.setattr("planners.routes.replanning.share", lambda *_, **__: across)
    with pytest.raises(InputError, match="outside the area or in a no-go zone"):
        replanned(route, Loss(1, 60.0, 60.0), pillar, rover=Rover())


def test_the_others_finish_the_leg_they_are_on():
    route = two_rovers()
    after = replanned(route, Loss(1, 60.0, 60.0), GROUND, rover=Rover())
    ends = np.cumsum([leg.length_m for leg in route.legs if leg.rover == 0])
    n = int(np.searchsorted(ends, 60.0)) + 1
    before, now = ([leg for leg in r.legs if leg.rover == 0][:n] for r in (route, after))
    assert before == now


def test_a_rover_that_is_home_drives_out_again():
    route = two_rovers()
    length = sum(leg.length_m for leg in route.legs if leg.rover == 1)
    after = replanned(route, Loss(1, 1000.0, length - 150.0), GROUND, rover=Rover())
    assert after.path(0)[-1] == pytest.approx(HOMES[0])
    assert swath_m(after) == pytest.approx(4 * 90.0)


def test_without_another_rover_the_gap_stays():
    route = two_rovers()
    first = cut_short(route, Loss(0, 30.0, 30.0))
    after = replanned(first, Loss(1, 40.0, 40.0), GROUND, rover=Rover(), lost={0})
    assert after.length_m == pytest.approx(70.0)


def test_a_rover_lost_on_its_way_home_leaves_no_swath():
    route = two_rovers()
    length = sum(leg.length_m for leg in route.legs if leg.rover == 1)
    assert remaining_swaths(route, Loss(1, 500.0, length - 1.0)) == ()
    after = replanned(route, Loss(1, 50.0, length - 1.0), GROUND, rover=Rover())
    assert swath_m(after) == pytest.approx(4 * 90.0)


def test_a_fleet_with_batteries_is_refused():
    with pytest.raises(ConfigError, match="batteries"):
        replanned(two_rovers(), Loss(1, 60.0, 60.0), GROUND, rover=Rover(battery_j=1e9))

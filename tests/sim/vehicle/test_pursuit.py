"""Path following without physics: look-ahead, progress, end of the route, recovery."""

from itertools import pairwise

import numpy as np
import pytest

from sim.config.rover import PhysicsConfig
from sim.vehicle.pursuit import SKID, BackingOff, PurePursuit

PATH = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])


def pursuit(**settings: float) -> PurePursuit:
    return PurePursuit(PATH, 1.0, PhysicsConfig(**settings))


def test_on_the_route_both_tracks_turn_alike():
    left, right = pursuit().track_speeds(np.array([2.0, 0.0]), 0.0)
    assert (left, right) == pytest.approx((1.0, 1.0))


def test_a_point_behind_is_turned_to_on_the_spot():
    config = PhysicsConfig()
    left, right = pursuit().track_speeds(np.array([2.0, 0.0]), np.pi - 0.1)
    assert left + right == pytest.approx(0.0)
    # It faces west by south of the route's direction, so the shorter turn is to the right.
    assert left - right == pytest.approx(SKID * config.track_gauge_m * config.max_turn_rate_rad_s)


def test_the_turn_rate_is_bounded():
    config = PhysicsConfig(max_turn_rate_rad_s=0.3)
    left, right = pursuit(max_turn_rate_rad_s=0.3).track_speeds(np.array([2.0, 0.5]), 0.0)
    assert left - right == pytest.approx(SKID * config.track_gauge_m * 0.3)


def test_progress_never_goes_back():
    follower = pursuit()
    follower.track_speeds(np.array([2.0, 0.0]), 0.0)
    assert follower.progress_m == pytest.approx(2.0)
    follower.track_speeds(np.array([1.0, 0.0]), 0.0)
    assert follower.progress_m == pytest.approx(2.0)


def test_the_end_counts_only_after_the_route():
    closed = PurePursuit(np.vstack([PATH, [[0.0, 0.0]]]), 1.0, PhysicsConfig())
    assert not closed.is_done(np.zeros(2))
    follower = pursuit()
    for x in np.arange(0.0, 10.0, 2.0):
        follower.track_speeds(np.array([x, 0.0]), 0.0)
    for y in np.arange(0.0, 10.1, 2.0):
        follower.track_speeds(np.array([10.0, y]), 0.0)
    assert follower.is_done(np.array([10.0, 9.8]))
    assert not follower.is_done(np.array([10.0, 9.0]))


def test_places_and_headings_along_the_route():
    places, headings = pursuit().at(np.array([5.0, 15.0]))
    np.testing.assert_allclose(places, [[5.0, 0.0], [10.0, 5.0]], atol=0.11)
    np.testing.assert_allclose(headings, [0.0, np.pi / 2.0], atol=1e-9)


def test_a_stuck_rover_backs_off_three_times():
    backing, here = BackingOff(1.0), np.array([3.0, 4.0])
    asked = [backing.track_speeds(0.05 * k, here, (0.6, 0.0)) for k in range(800)]
    backs = [pair == (-0.2, -0.7) for pair in asked]  # it wants to turn right
    assert sum(now and not before for before, now in pairwise(backs)) == 3
    assert asked[-1] == (0.6, 0.0)


def test_a_rover_that_gets_on_is_not_bothered():
    backing = BackingOff(1.0)
    for k in range(400):
        assert backing.track_speeds(0.05 * k, np.array([0.04 * k, 0.0]), (0.8, 1.0)) == (0.8, 1.0)

import numpy as np
import pytest

from planners.routes.fleet import departures
from planners.routes.rover import Mobility
from survey import ConfigError, Leg

ALONG = np.array([[0.0, 0.0], [200.0, 0.0]])


def test_rovers_that_never_meet_depart_at_once():
    legs = [Leg("swath", ALONG), Leg("swath", ALONG + [0.0, 500.0], rover=1)]
    assert departures(legs, Mobility(), 20.0).tolist() == [0.0, 0.0]


def test_a_rover_waits_until_the_crossing_is_clear():
    crossing = np.array([[100.0, -100.0], [100.0, 100.0]])
    waits = departures([Leg("swath", ALONG), Leg("swath", crossing, rover=1)], Mobility(), 20.0)
    assert waits[0] == 0.0
    # The second reaches the crossing 20 m or more behind the first.
    assert 10.0 <= waits[1] <= 40.0


def test_a_rover_waits_until_the_other_has_left_the_shared_line():
    legs = [Leg("swath", ALONG), Leg("swath", ALONG[::-1], rover=1)]
    assert departures(legs, Mobility(), 20.0)[1] > 100.0


def test_a_separation_of_zero_is_refused():
    with pytest.raises(ConfigError, match="greater than 0"):
        departures([Leg("swath", ALONG)], Mobility(), 0.0)

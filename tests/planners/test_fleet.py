"""Several rovers: shares, depots, batteries, separation."""

from itertools import pairwise

import numpy as np
import pytest
import shapely

from planners.routes.fleet import departures, share
from planners.routes.rover import Mobility, effort, predicted
from planners.routes.shortest_paths import FreeGround
from planners.swaths.decomposition import swaths_on
from survey.core.errors import ConfigError, InputError
from survey.data.route import Leg, Route

SITE = FreeGround(shapely.box(0.0, 0.0, 600.0, 600.0))
PLAIN = Mobility(turn_s=0.0)


def longest_s(legs: tuple[Leg, ...]) -> float:
    return predicted(legs, PLAIN)["time_s"]


def test_four_rovers_from_a_corner_are_three_times_as_fast() -> None:
    swaths = swaths_on(SITE, 50.0, 90.0)
    alone = longest_s(share(swaths, SITE, [(0.0, 0.0)]))
    together = longest_s(share(swaths, SITE, [(0.0, 0.0)] * 4))
    # Twelve swaths of 600 m in four rows; the farthest corner is 424 m from the nearest way back.
    assert alone / together > 2.6


def test_depots_share_the_site_by_nearness() -> None:
    swaths = swaths_on(SITE, 150.0, 90.0)
    legs = share(swaths, SITE, [(0.0, 0.0), (600.0, 0.0)])
    east = {leg.rover: leg.xy[:, 0].mean() for leg in legs if leg.kind == "swath"}
    assert east[0] < 300.0 < east[1]
    for rover in (0, 1):
        own = [leg for leg in legs if leg.rover == rover]
        np.testing.assert_array_equal(own[0].xy[0], own[-1].xy[-1])
    assert Route(legs, "EPSG:32608", "lawnmower").n_rovers == 2


def test_a_battery_brings_rovers_home_in_time() -> None:
    swaths = swaths_on(SITE, 100.0, 90.0)
    mobility = Mobility(turn_s=0.0, battery_j=2_800.0 * Mobility().flat_j_per_m)
    legs = share(swaths, SITE, [(0.0, 0.0)], mobility=mobility)
    home = np.array([0.0, 0.0])
    trip_m, trips = 0.0, []
    for leg in legs:
        trip_m += leg.length_m
        if np.array_equal(leg.xy[-1], home):
            trips.append(trip_m)
            trip_m = 0.0
    assert len(trips) > 1
    assert trip_m == 0.0
    assert max(trips) * mobility.flat_j_per_m <= mobility.battery_j
    assert sum(leg.kind == "swath" for leg in legs) == 6
    for before, after in pairwise(legs):
        np.testing.assert_array_equal(before.xy[-1], after.xy[0])


def test_a_battery_too_small_for_a_swath_is_refused_with_numbers() -> None:
    swaths = swaths_on(SITE, 100.0, 90.0)
    with pytest.raises(InputError, match=r"the battery holds 255 kJ"):
        share(swaths, SITE, [(0.0, 0.0)], mobility=Mobility(battery_j=255e3))


def test_more_rovers_than_swaths_stay_at_home() -> None:
    legs = share(swaths_on(SITE, 300.0, 90.0), SITE, [(0.0, 0.0)] * 4)
    assert sum(leg.kind == "swath" for leg in legs) == 2
    assert len({leg.rover for leg in legs}) == 2


def test_rovers_that_would_meet_depart_one_after_the_other() -> None:
    cross = (Leg("swath", [[0.0, 50.0], [100.0, 50.0]], 0), Leg("swath", [[50.0, 0.0], [50.0, 100.0]], 1))
    waits = departures(cross, PLAIN, 10.0)
    assert waits[0] == 0.0
    # Both pass (50, 50) after 50 s; 10 m apart means at least 10 s later, the diagonal counted 14.
    assert 10.0 <= waits[1] <= 20.0
    apart = (Leg("swath", [[0.0, 0.0], [100.0, 0.0]], 0), Leg("swath", [[0.0, 50.0], [100.0, 50.0]], 1))
    np.testing.assert_array_equal(departures(apart, PLAIN, 10.0), [0.0, 0.0])


def test_bad_fleets_are_refused() -> None:
    swaths = swaths_on(SITE, 300.0, 90.0)
    with pytest.raises(ConfigError, match="no depot"):
        share(swaths, SITE, [])
    with pytest.raises(InputError, match="outside the free ground"):
        share(swaths, SITE, [(-5.0, 0.0)])
    with pytest.raises(ConfigError, match="separation"):
        departures(share(swaths, SITE, [(0.0, 0.0)]), PLAIN, 0.0)


def test_effort_of_a_share_is_that_of_its_legs() -> None:
    legs = share(swaths_on(SITE, 150.0, 90.0), SITE, [(0.0, 0.0)], mobility=PLAIN)
    assert effort(np.vstack([leg.xy for leg in legs]), PLAIN).length_m == pytest.approx(
        sum(leg.length_m for leg in legs)
    )

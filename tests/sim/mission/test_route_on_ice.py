"""Planned routes on moving ice, in fixed coordinates and on the ice of the epoch."""

import numpy as np

from sim.config.ice import IceAssumptions, IceConfig
from sim.mission.drives import draw_on_ice
from survey import Leg, Route
from tests.sim.small_missions import mission_with

ROUTE = Route(
    (Leg("swath", [[0.0, 0.0], [100.0, 0.0]]), Leg("transit", [[100.0, 0.0], [100.0, 50.0]])),
    "EPSG:32608",
    "l",
)


def test_the_route_on_the_ice_is_that_of_the_epoch() -> None:
    assumed = IceAssumptions(velocity_m_per_day=(4.0, 0.0))
    mission = mission_with().model_copy(update={"ice": IceConfig(assumed=assumed)})
    slow = mission.model_copy(
        update={"rover": mission.rover.model_copy(update={"speed_m_s": 150.0 / 86400.0})}
    )
    drawn = draw_on_ice(ROUTE, slow)
    np.testing.assert_allclose(drawn.legs[0].xy, [[2.0, 0.0], [100.0 - 4.0 / 6.0, 0.0]])
    np.testing.assert_allclose(drawn.legs[1].xy[-1], [98.0, 50.0])


def test_ice_at_rest_leaves_it_as_it_is() -> None:
    mission = mission_with().model_copy(update={"ice": IceConfig()})
    np.testing.assert_array_equal(draw_on_ice(ROUTE, mission).legs[1].xy, ROUTE.legs[1].xy)

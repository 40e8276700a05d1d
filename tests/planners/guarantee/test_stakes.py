from planners import LawnmowerConfig, plan
from planners.guarantee.guarantee import StakePlan
from tests.planners.guarantee.smooth_site import AREA


def test_stakes_stand_at_the_ends_of_the_route():
    route = plan(AREA, None, LawnmowerConfig(swaths=3))
    stakes = StakePlan.at_ends(route, 2)
    assert stakes.xy.tolist() == [route.swaths[0].xy[0].tolist(), route.swaths[-1].xy[-1].tolist()]
    assert str(stakes).startswith("2 stakes at (")
    assert str(stakes).endswith("save 2 swaths")

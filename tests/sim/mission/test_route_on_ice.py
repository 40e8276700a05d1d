"""Planned routes on moving ice, in fixed coordinates and on the ice of the epoch."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from planners import LawnmowerConfig, plan
from sim.config.mission import MissionConfig
from sim.config.world import IceAssumptions, IceConfig
from sim.world.moving_ice import draw_on_ice, in_ice_order, write_on_ice
from sim.world.site import World
from survey import Dem, Grid, Leg, Route, SurveyArea
from survey.core.errors import ConfigError, InputError
from survey.io.vector import read_features
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


def test_the_geopackage_holds_the_route_in_fixed_coordinates_and_on_the_ice(tmp_path: Path) -> None:
    assumed = IceAssumptions(velocity_m_per_day=(400.0, 0.0))
    mission = mission_with().model_copy(update={"ice": IceConfig(assumed=assumed)})
    write_on_ice(ROUTE, mission, tmp_path)
    file = tmp_path / "route.gpkg"
    for layer, route in (("route", ROUTE), ("route_on_ice", draw_on_ice(ROUTE, mission))):
        lines = read_features(file, what="the route", layer=layer).geometry
        np.testing.assert_allclose(lines[0].coords, route.legs[0].xy)
    np.testing.assert_array_equal(Route.read(file).legs[0].xy, ROUTE.legs[0].xy)


def test_a_geojson_holds_one_route_alone(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="one layer"):
        ROUTE.write(tmp_path / "route.geojson", also={"other": ROUTE})
    assert not list(tmp_path.iterdir())


def square(ice: IceConfig, **planner: object) -> tuple[Route, MissionConfig, World]:
    """Four swaths over a square, planned in the usual order."""
    area = SurveyArea.rectangle((0.0, 0.0, 100.0, 100.0), "EPSG:32608")
    grid = Grid((-20.0, -20.0, 120.0, 120.0), 10.0, area.crs)
    flat = Dem.on(grid, np.zeros(grid.shape))
    config = LawnmowerConfig(swaths=4, heading_deg=90.0, **planner)
    mission = mission_with().model_copy(update={"ice": ice, "planner": config})
    return plan(area, flat, config), mission, World(flat, flat, area)


def test_every_second_swath_is_driven_first_where_the_mission_asks_for_it() -> None:
    route, mission, world = square(IceConfig(swath_order="alternate"), tie_lines=1)
    ordered = in_ice_order(route, mission, world)
    first = [swath.xy[0, 0] for swath in route.swaths]
    assert [swath.xy[0, 0] for swath in ordered.swaths[:4]] == [first[0], first[2], first[3], first[1]]
    assert ordered.swaths[-1].xy[0, 1] == route.swaths[-1].xy[0, 1]
    for one, following in pairwise(ordered.legs):
        np.testing.assert_array_equal(one.xy[-1], following.xy[0])
    assert ordered.prediction["length_m"] == pytest.approx(ordered.ground_length_m, rel=1e-6)
    assert ordered.prediction.keys() == route.prediction.keys()


def test_adjacent_swaths_stay_as_they_are_planned() -> None:
    route, mission, world = square(IceConfig())
    assert in_ice_order(route, mission, world) is route


def test_an_order_that_the_rover_cannot_drive_is_refused() -> None:
    route, mission, world = square(IceConfig(swath_order="alternate"))
    turning = mission.model_copy(update={"rover": mission.rover.model_copy(update={"turn_radius_m": 2.0})})
    with pytest.raises(ConfigError, match="a rover that pivots"):
        in_ice_order(route, turning, world)

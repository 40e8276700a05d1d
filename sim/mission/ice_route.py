"""Planned routes on moving ice: order of the swaths, and lines in fixed coordinates and on the ice of the epoch."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely

from planners import LawnmowerConfig, WavyConfig
from planners.driving.energy import predicted
from planners.swaths.counting import count_lines
from sim.config.mission import MissionConfig
from sim.world.assumed_motion import assumed_motion
from sim.world.site import World
from survey.core.arrays import FloatArray
from survey.core.errors import ConfigError
from survey.data.dem import Dem
from survey.data.legs import Leg
from survey.data.route import Route
from survey.reconstruction.motion.epoch import route_on_ice


def in_ice_order(route: Route, mission: MissionConfig, world: World) -> Route:
    """Return a planned route with its swaths in the order that the mission states for moving ice.

    Neighbouring swaths that are driven hours apart show the motion of the ice where they see the same ground.

    Parameters
    ----------
    route : Route
        Of one rover; its swaths in the order of their lines, lines across them last.
    mission : MissionConfig
        Its section ``ice`` and its rover.
    world : World
        Only its area and prior are used.

    Returns
    -------
    Route
        With the length, time and energy of the new order.

    Raises
    ------
    ConfigError
        Another pattern, lines that the border cuts into pieces, a rover that cannot pivot, or straight ways between the swaths that leave
        the area.
    """
    if mission.ice is None or mission.ice.swath_order == "adjacent":
        return route
    if (
        not isinstance(mission.planner, LawnmowerConfig | WavyConfig)
        or count_lines(route) < len(route.swaths)
        or mission.rover.turn_radius_m > 0.0
    ):
        raise ConfigError(
            "ice.swath_order = 'alternate' needs lawnmower or wavy swaths from border to border and a rover that pivots; "
            "leave it out."
        )
    n = len(route.swaths) - mission.planner.tie_lines
    along, across = route.swaths[:n], route.swaths[n:]
    legs = _joined((*along[::2], *along[1::2][::-1], *across), route.legs[0].xy[0])
    if not world.area.free.covers(shapely.multilinestrings([leg.xy for leg in legs])):
        raise ConfigError(
            "ice.swath_order = 'alternate' needs free ground between the ends of the swaths; leave it out."
        )
    facts = predicted(legs, mission.rover, _covering(world.prior, legs), crs=route.crs)
    return replace(route, legs=legs, prediction={**route.prediction, **facts})


def _joined(swaths: tuple[Leg, ...], start: FloatArray) -> tuple[Leg, ...]:
    """Join swaths by straight transits, each entered at its nearer end."""
    legs: list[Leg] = []
    here = start
    for swath in swaths:
        gaps = np.hypot(*(swath.xy[[0, -1]] - here).T)
        way = 1 if gaps[0] <= gaps[1] else -1
        if gaps.min() > 0.0:
            legs.append(Leg("transit", np.array([here, swath.xy[::way][0]])))
        legs.append(Leg("swath", swath.xy[::way], axis=swath.axis[::way]))
        here = legs[-1].xy[-1]
    return tuple(legs)


def _covering(prior: Dem, legs: tuple[Leg, ...]) -> Dem | None:
    """Return the prior where it has a height at every waypoint."""
    return prior if np.isfinite(prior.at(np.vstack([leg.xy for leg in legs]))).all() else None


def draw_on_ice(route: Route, mission: MissionConfig) -> Route:
    """Return the planned route as it lies on the ice of the epoch, by the motion that is assumed."""
    ice, speed_m_s = mission.ice, mission.rover.speed_m_s
    if ice is None:
        return route
    middle_s = 0.5 * route.length_m / speed_m_s
    epoch_s = middle_s if ice.epoch_s is None else ice.epoch_s
    places = np.vstack([leg.xy for leg in route.legs])
    prior = assumed_motion(ice.assumed, epoch_s, places, route.crs, path_of=mission.path)
    return route_on_ice(route, prior, speed_m_s)


def write_on_ice(route: Route, mission: MissionConfig, folder: Path) -> None:
    """Write the route on the ice of the epoch, and a GeoPackage with both as layers."""
    drawn = draw_on_ice(route, mission)
    drawn.write(folder / "route_on_ice.geojson")
    route.write(folder / "route.gpkg", also={"route_on_ice": drawn})

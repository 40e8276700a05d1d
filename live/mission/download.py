"""Download of a mission from a vehicle, as a route."""

import logging
from typing import Any

import numpy as np

from live.link.address import LinkAddress
from live.link.vehicle import Vehicle
from live.mission.items import MISSION
from live.mission.limits import n_home_items
from live.mission.transfer import fetch_items
from survey.core.arrays import FloatArray, Progress
from survey.core.crs import projected_crs
from survey.core.errors import InputError
from survey.core.transformation import chosen_crs, transformed
from survey.data.route import Leg, Route
from survey.io.vector import WGS84


def downloaded_route(
    address: LinkAddress,
    crs: Any = None,
    *,
    patience_s: float = 15.0,
    system: int | None = None,
    progress: Progress | None = None,
) -> Route:
    """Read the waypoints of the mission that a vehicle holds.

    Parameters
    ----------
    address : LinkAddress
        Where the vehicle is.
    crs : str or pyproj.CRS, optional
        Projected CRS of the route; by default the UTM zone of the first waypoint, or polar stereographic.
    patience_s : float
        How long to wait for a silent vehicle [s].
    system : int, optional
        System id of the vehicle; by default the first that answers.
    progress : callable, optional
        Called with what is done, how much of it, and of how much.

    Returns
    -------
    Route
        One swath through all waypoints.

    Raises
    ------
    InputError
        A link that stays lost, or a mission with fewer than two waypoints.
    """
    with Vehicle.connected(address, patience_s, system) as vehicle:
        items = fetch_items(vehicle, MISSION, progress)
        mission = items[n_home_items(vehicle.autopilot) :]
        places = np.array([item.degrees for item in mission if item.is_waypoint])
        if len(places) < 2:
            raise InputError(
                f"{vehicle.name} holds {len(items)} items with {len(places)} waypoints, and a route needs at least two; "
                "upload a mission to it first."
            )
    return _route(places[:, ::-1], crs)


def _route(lonlat: FloatArray, crs: Any) -> Route:
    """Return the route through places (N, 2) [deg]; repeated places are one waypoint."""
    if crs is None:
        target = chosen_crs(lonlat[:, 0], lonlat[:, 1])
        logging.getLogger(__name__).warning("the mission is projected to %s.", target.name)
    else:
        target = projected_crs(crs, "the wanted CRS")
    return Route((Leg("swath", transformed(lonlat, WGS84, target, "the mission")),), target, "downloaded")

"""Mission of a vehicle: upload with its fence, read back and compared item by item, and download as a route."""

import logging
from collections.abc import Sequence
from time import monotonic
from typing import Any, NamedTuple

import numpy as np

from live.link import LinkAddress, LinkLostError, Vehicle
from live.mission.items import (
    FENCE,
    KIND_NAMES,
    MISSION,
    AutopilotMission,
    LinkItem,
    first_difference,
    limits_of,
    n_home_items,
    require_storable,
)
from live.mission.transfer import fetch_items, send_items, start_mission
from survey.core.arrays import FloatArray, Progress
from survey.core.crs import projected_crs
from survey.core.errors import InputError
from survey.core.transformation import chosen_crs, transformed
from survey.data.route import Leg, Route
from survey.io.vector import WGS84

_MOST_TRANSFERS = 6
MOST_UPLOAD_S = 600.0
"""Time after which an upload over a poor link is given up [s]."""


class UploadReport(NamedTuple):
    """What a vehicle holds after an upload, read back and equal to what was sent.

    Parameters
    ----------
    vehicle : str
        Autopilot and system id.
    items, fence_corners : int
        Numbers of items; 0 corners where the fence was left as it was.
    transfers : int
        How often items were sent: 1 for each of mission and fence, more after losses.
    """

    vehicle: str
    items: int
    fence_corners: int
    transfers: int


def upload(
    mission: AutopilotMission,
    address: LinkAddress,
    *,
    patience_s: float = 15.0,
    system: int | None = None,
    most_items: int | None = None,
    starts: bool = False,
    progress: Progress | None = None,
) -> UploadReport:
    """Upload a fence and a mission, and compare them with what the vehicle reports; give up after `MOST_UPLOAD_S`.

    The fence goes first, so that the vehicle never has the mission without it. A vehicle exchanges its mission when
    the last item has come; until then, and after any loss of the link, it holds the former one.

    Parameters
    ----------
    mission : AutopilotMission
        Of one rover.
    address : LinkAddress
        Where the vehicle is.
    patience_s : float
        How long to wait for a silent vehicle [s].
    system : int, optional
        System id of the vehicle; by default the first that answers.
    most_items : int, optional
        How many items the board holds; by default the limit of its autopilot.
    starts : bool
        Whether to arm the vehicle and start the mission afterwards.
    progress : callable, optional
        Called with what is done, how much of it, and of how much.

    Returns
    -------
    UploadReport
        What the vehicle holds.

    Raises
    ------
    InputError
        A mission that the vehicle cannot hold or refuses, a link that stays lost, or items that come back different.
        A link so poor that the upload takes too long.
    """
    with Vehicle.connected(address, patience_s, system) as vehicle:
        limits, n_home = limits_of(vehicle.autopilot), n_home_items(vehicle.autopilot)
        items, fence = mission.link_items(vehicle.autopilot), mission.fence_items
        require_storable(items, MISSION, most_items or limits.items, n_home)
        require_storable(fence, FENCE, most_items or limits.fence_corners)
        progress = _in_time(progress, vehicle)
        transfers = _until_equal(vehicle, fence, FENCE, 0, progress) if fence else 0
        transfers += _until_equal(vehicle, items, MISSION, n_home, progress)
        if starts:
            start_mission(vehicle)
        return UploadReport(vehicle.name, len(items), len(fence), transfers)


def _in_time(progress: Progress | None, vehicle: Vehicle) -> Progress:
    """Return the callback of progress, which ends an upload that takes too long."""
    until = monotonic() + MOST_UPLOAD_S

    def checked(what: str, done: int, total: int) -> None:
        if monotonic() > until:
            raise InputError(
                f"the upload to {vehicle.address.text} took longer than {MOST_UPLOAD_S:g} s ({what}, {done} of {total} items); "
                "the link loses too many packets, come nearer and run the command again."
            )
        if progress is not None:
            progress(what, done, total)

    return checked


def _until_equal(
    vehicle: Vehicle, items: Sequence[LinkItem], kind: int, n_home: int, progress: Progress | None
) -> int:
    """Send items until the vehicle reports them equal; return the number of transfers.

    The first `n_home` items are not compared: the vehicle has a home position of its own.
    """
    index: int | None = None
    for transfer in range(1, _MOST_TRANSFERS + 1):
        try:
            send_items(vehicle, items, kind, progress)
            found = fetch_items(vehicle, kind, progress)
        except LinkLostError:
            if transfer == _MOST_TRANSFERS:
                raise
            vehicle.wait_for_heartbeat()
            continue
        index = first_difference(items[n_home:], found[n_home:])
        if index is None:
            return transfer
        index += n_home
    assert index is not None
    raise InputError(_difference(items, found, index, kind, vehicle))


def _difference(
    items: Sequence[LinkItem], found: Sequence[LinkItem], index: int, kind: int, vehicle: Vehicle
) -> str:
    """Return a sentence for items that came back different."""
    sent = items[index] if index < len(items) else "nothing"
    read = found[index] if index < len(found) else "nothing"
    return (
        f"{vehicle.name} reports {read} for item {index} of the {KIND_NAMES[kind]} where {sent} was sent; do not drive it, "
        "clear the mission and upload it again."
    )


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

"""Items of missions and fences as MAVLink carries them (mavlink.io, "Mission Protocol", MISSION_ITEM_INT)."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from survey.interchange.missions import NAV_WAYPOINT, MissionItem

MISSION, FENCE = 0, 1
"""Values of MAV_MISSION_TYPE."""
KIND_NAMES = {MISSION: "mission", FENCE: "fence"}
PER_DEGREE = 1e7
"""Steps of latitude and longitude per degree; one is 11 mm along a meridian."""
INCLUSION_POLYGON, EXCLUSION_POLYGON, INCLUSION_CIRCLE, EXCLUSION_CIRCLE = 5001, 5002, 5003, 5004
_GLOBAL_FRAMES = (0, 3, 5, 6, 10, 11)
# Autopilots store heights to the centimetre.
_HEIGHT_STEP_M = 0.01


class LinkItem(NamedTuple):
    """One item on the link.

    Parameters
    ----------
    command, frame : int
        MAV_CMD and MAV_FRAME.
    params : tuple of float
        Parameters 1 to 4 in single precision; NaN leaves a value to the vehicle.
    x, y : int
        Latitude and longitude [1e-7 deg] in global frames, else parameters 5 and 6.
    z : float
        Height in the frame [m], in single precision.
    """

    command: int
    frame: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float

    @classmethod
    def of(cls, item: MissionItem) -> "LinkItem":
        """Round an item of a mission to what the link carries.

        Parameters
        ----------
        item : MissionItem
            With degrees.

        Returns
        -------
        LinkItem
            With integers and single precision.

        Examples
        --------
        >>> LinkItem.of(MissionItem(16, 3, (0, 0, 0, None, 60.12345678, -139.5, 2.5)))[3:]
        (601234568, -1395000000, 2.5)
        """
        first = [float("nan") if value is None else _single(value) for value in item.params[:4]]
        scale = PER_DEGREE if item.frame in _GLOBAL_FRAMES else 1.0
        # Nine decimals first, as in files of missions, so that both round alike.
        x, y = (round(round(value or 0.0, 9) * scale) for value in item.params[4:6])
        return cls(
            item.command,
            item.frame,
            (first[0], first[1], first[2], first[3]),
            x,
            y,
            _single(item.params[6] or 0.0),
        )

    @classmethod
    def received(cls, message: Any) -> "LinkItem":
        """Read an item from a message MISSION_ITEM_INT.

        Parameters
        ----------
        message : object
            Of pymavlink.

        Returns
        -------
        LinkItem
            With what it states.
        """
        params = (message.param1, message.param2, message.param3, message.param4)
        return cls(message.command, message.frame, params, message.x, message.y, message.z)

    @property
    def is_waypoint(self) -> bool:
        """Whether it is a place to drive to."""
        return self.command == NAV_WAYPOINT and self.frame in _GLOBAL_FRAMES

    @property
    def degrees(self) -> tuple[float, float]:
        """Latitude and longitude [deg]."""
        return self.x / PER_DEGREE, self.y / PER_DEGREE

    def agrees_with(self, other: "LinkItem") -> bool:
        """Return whether a vehicle that reports the other item holds this one.

        Commands, frames and places have to be equal, heights to the centimetre. A parameter that is left to the
        vehicle may come back as 0.

        Parameters
        ----------
        other : LinkItem
            As read back.

        Returns
        -------
        bool
            Whether they agree.

        Examples
        --------
        >>> item = LinkItem(16, 3, (0.0, 0.0, 0.0, float("nan")), 1, 2, 0.5)
        >>> item.agrees_with(item._replace(params=(0.0, 0.0, 0.0, 0.0))), item.agrees_with(item._replace(x=3))
        (True, False)
        """
        same_place = (self.command, self.frame, self.x, self.y) == (
            other.command,
            other.frame,
            other.x,
            other.y,
        )
        if not same_place or not abs(self.z - other.z) < _HEIGHT_STEP_M:
            return False
        return bool(np.array_equal(np.nan_to_num(self.params), np.nan_to_num(other.params)))


def first_difference(sent: Sequence[LinkItem], read: Sequence[LinkItem]) -> int | None:
    """Return the index of the first item that differs, or None.

    Parameters
    ----------
    sent, read : sequence of LinkItem
        What was uploaded, and what the vehicle reports.

    Returns
    -------
    int or None
        The length of the shorter one where only the lengths differ.
    """
    for index, (one, other) in enumerate(zip(sent, read, strict=False)):
        if not one.agrees_with(other):
            return index
    return None if len(sent) == len(read) else min(len(sent), len(read))


def _single(value: float) -> float:
    return float(np.float32(value))

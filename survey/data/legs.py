"""Legs of a route and samples along it."""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from survey.core.arrays import FloatArray, IntArray, checked
from survey.core.data_object import DataObject
from survey.core.errors import InputError

LegKind = Literal["swath", "transit"]


@dataclass(frozen=True, eq=False, repr=False)
class Leg(DataObject):
    """One stretch that a rover drives.

    Parameters
    ----------
    kind : {"swath", "transit"}
        A swath is driven to measure, a transit to get to the next one.
    xy : (N, 2) array_like
        Waypoints in driving order [m], at least two.
    rover : int
        Who drives it, counted from 0.
    axis : (2, 2) array_like, optional
        Both ends of the straight line that the swath deviates from; the first and the
        last waypoint by default. β (Eqs. 14–16) is measured from it.
    """

    kind: LegKind
    xy: FloatArray
    rover: int = 0
    axis: Any = None

    def __post_init__(self) -> None:
        xy = checked(self.xy, (None, 2), f"the waypoints of a {self.kind}")
        if self.kind not in ("swath", "transit"):
            raise InputError(f"a leg is of the kind {self.kind!r}; swath or transit was expected.")
        if len(xy) < 2:
            raise InputError(f"a {self.kind} has {len(xy)} waypoints; at least two are needed.")
        object.__setattr__(self, "xy", xy)
        axis = xy[[0, -1]] if self.axis is None else self.axis
        object.__setattr__(self, "axis", checked(axis, (2, 2), f"the axis of a {self.kind}"))

    def _summary(self) -> str:
        return f"{self.kind} of rover {self.rover}, {len(self.xy)} waypoints, {self.length_m:.1f} m"

    @property
    def length_m(self) -> float:
        """Distance along the waypoints in the CRS of the route [m]."""
        return float(np.hypot(*np.diff(self.xy, axis=0).T).sum())


class RouteSamples(NamedTuple):
    """Places at equal distances along one rover's path.

    Parameters
    ----------
    xy : (N, 2) ndarray
        Easting and northing [m].
    distance_m : (N,) ndarray
        Distance from the start along the path, in the CRS [m].
    leg : (N,) ndarray of int
        Index into `Route.legs`.
    heading_rad : (N,) ndarray
        Counter-clockwise from east [rad].
    """

    xy: FloatArray
    distance_m: FloatArray
    leg: IntArray
    heading_rad: FloatArray

    def __repr__(self) -> str:
        return f"RouteSamples({len(self.xy)} places over {self.distance_m[-1]:.1f} m)"

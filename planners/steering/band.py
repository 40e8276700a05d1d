"""Band about a swath that a steered rover may use."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely

from survey.core.arrays import FloatArray


@dataclass(frozen=True)
class Band:
    """Strip about a swath that a rover may use.

    Parameters
    ----------
    axis : (2, 2) ndarray
        Both ends of the swath's line [m].
    knots_m : (K,) ndarray
        Distances along it [m].
    left_m, right_m : (K,) ndarray
        Largest deviation to both sides there [m].

    Examples
    --------
    >>> axis = np.array([[0.0, 5.0], [100.0, 5.0]])
    >>> band = Band.about(axis, 20.0, shapely.box(0.0, 0.0, 100.0, 30.0), step_m=10.0)
    >>> float(band.left_m.max()), float(band.right_m.max())
    (20.0, 5.0)
    """

    axis: FloatArray
    knots_m: FloatArray
    left_m: FloatArray
    right_m: FloatArray

    @classmethod
    def about(cls, axis: FloatArray, half_m: float, ground: Any, step_m: float) -> "Band":
        """Measure how far the free ground reaches on both sides of a swath.

        Every bound is the least one within a step before and behind, so that no step
        between two allowed places leaves the ground.

        Parameters
        ----------
        axis : (2, 2) ndarray
            Both ends of the swath's line [m].
        half_m : float
            Largest deviation [m].
        ground : shapely.Geometry
            The free ground.
        step_m : float
            Distance driven between two decisions [m].

        Returns
        -------
        Band
            With a knot at every metre or so.
        """
        length = float(np.hypot(*(axis[1] - axis[0])))
        along, left = _frame(axis)
        knots = np.linspace(0.0, length, max(int(np.ceil(length)), 2) + 1)
        # On the border itself rounding decides what is inside; a micrometre further in it does not.
        feet = axis[0] + np.clip(knots, 1e-6, length - 1e-6)[:, None] * along
        shapely.prepare(ground)
        reach = [_reach(feet, side * half_m * left, ground) for side in (1.0, -1.0)]
        window = int(np.ceil(step_m * len(knots) / length)) + 1
        left_m, right_m = (_least_within(np.minimum(r, half_m), window) for r in reach)
        return cls(axis, knots, left_m, right_m)

    @property
    def length_m(self) -> float:
        """Length of the swath's line [m]."""
        return float(self.knots_m[-1])

    @cached_property
    def heading_rad(self) -> float:
        """Heading of the swath's line."""
        along = self._frame[0]
        return float(np.arctan2(along[1], along[0]))

    @cached_property
    def _frame(self) -> tuple[FloatArray, FloatArray]:
        return _frame(self.axis)

    def next_waypoint(self, xy: FloatArray, heading_rad: FloatArray, step_m: float) -> FloatArray:
        """Return where a step ends: within the band, and at the swath's end at most.

        Parameters
        ----------
        xy : (N, 2) ndarray
            Where the rovers are [m].
        heading_rad : (N,) ndarray
            Their headings, counter-clockwise from east.
        step_m : float
            Length of the step [m].

        Returns
        -------
        (N, 2) ndarray
            Easting and northing [m].
        """
        along, left = self._frame
        u, v = (xy - self.axis[0]) @ along, (xy - self.axis[0]) @ left
        turn = heading_rad - self.heading_rad
        ahead, aside = step_m * np.cos(turn), step_m * np.sin(turn)
        share = np.minimum(1.0, (self.length_m - u) / ahead)
        u, v = np.minimum(u + share * ahead, self.length_m), v + share * aside
        v = np.clip(v, -np.interp(u, self.knots_m, self.right_m), np.interp(u, self.knots_m, self.left_m))
        waypoint: FloatArray = self.axis[0] + u[:, None] * along + v[:, None] * left
        return waypoint

    def foot(self, xy: FloatArray) -> FloatArray:
        """Return the nearest places of the swath's line.

        Parameters
        ----------
        xy : (N, 2) ndarray
            Where the rovers are [m].

        Returns
        -------
        (N, 2) ndarray
            Easting and northing [m].
        """
        along = self._frame[0]
        u = np.clip((xy - self.axis[0]) @ along, 0.0, self.length_m)
        feet: FloatArray = self.axis[0] + u[:, None] * along
        return feet

    def is_at_end(self, xy: FloatArray) -> Any:
        """Return which places are at the swath's end, to a micrometre.

        Parameters
        ----------
        xy : (N, 2) ndarray
            Where the rovers are [m].

        Returns
        -------
        (N,) ndarray of bool
            Whether each rover has arrived.
        """
        return (xy - self.axis[0]) @ self._frame[0] >= self.length_m - 1e-6


def _frame(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    along = (axis[1] - axis[0]) / np.hypot(*(axis[1] - axis[0]))
    return along, np.array([-along[1], along[0]])


def _reach(feet: FloatArray, aside: FloatArray, ground: Any) -> FloatArray:
    """Return how far the ground reaches from each foot (K, 2) along a vector [m]."""
    rays = shapely.linestrings(np.stack([feet, feet + aside], axis=1))
    reach: FloatArray = shapely.length(rays)
    cut = ~shapely.covers(ground, rays)
    inside = shapely.intersection(ground, rays[cut])
    # Of several pieces the one that begins at the foot counts.
    first = shapely.get_geometry(shapely.line_merge(inside), 0)
    pieces = np.where(shapely.is_missing(first), inside, first)
    at_foot = shapely.distance(pieces, shapely.points(feet[cut])) < 1e-6
    reach[cut] = np.where(at_foot, shapely.length(pieces), 0.0)
    return reach


def _least_within(values: FloatArray, window: int) -> FloatArray:
    padded = np.pad(values, window, mode="edge")
    least: FloatArray = np.lib.stride_tricks.sliding_window_view(padded, 2 * window + 1).min(axis=1)
    return least

"""Turns of rovers that cannot pivot, and headlands: room to turn in along the border.

A pose is (x, y, heading), in metres and radians counter-clockwise from east.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from pydantic import NonNegativeFloat
from shapely import LineString

from planners.driving.reeds_shepp import Pose, Word, dubins_words, moved, reeds_shepp_words, word_length
from planners.ground.transit import FreeGround
from survey.core.arrays import FloatArray
from survey.core.config import Section
from survey.core.errors import ConfigError, InputError

_CHORD_RAD = np.radians(5.0)
_MOST_WORDS = 12


class Turning(Section):
    """Turning radius of a rover, and whether it may reverse.

    Examples
    --------
    >>> Turning(turn_radius_m=3.0, reverse=True).turn_radius_m
    3.0
    """

    turn_radius_m: NonNegativeFloat = 0.0
    """Smallest turning radius [m]; 0 for a rover that pivots on the spot."""
    reverse: bool = False
    """Whether it may drive backwards while it turns."""


def turn_length_m(start: Pose, goal: Pose, turning: Turning) -> float:
    """Return the length of the shortest turn on open ground [m].

    Examples
    --------
    >>> round(turn_length_m((0.0, 0.0, 0.0), (0.0, 4.0, np.pi), Turning(turn_radius_m=2.0)), 3)
    6.283
    """
    return turning.turn_radius_m * word_length(_words(start, goal, turning)[0])


def _words(start: Pose, goal: Pose, turning: Turning) -> list[Word]:
    if not turning.turn_radius_m > 0.0:
        raise ConfigError("a rover with turning radius 0 pivots on the spot; give a radius for curved turns.")
    words = dubins_words(start, goal, turning.turn_radius_m)
    if turning.reverse:
        words = sorted(words + reeds_shepp_words(start, goal, turning.turn_radius_m), key=word_length)
    return words


def traced(start: Pose, word: Word, radius_m: float) -> FloatArray:
    """Return the waypoints (N, 2) of a word, its arcs as chords of at most 5°.

    A chord lies inside its arc by at most a thousandth of the radius.
    """
    points, pose = [start[:2]], start
    for steering, length in word:
        n = max(int(np.ceil(abs(length) / _CHORD_RAD)), 1) if steering else 1
        for share in (np.arange(n) + 1.0) / n:
            points.append(moved(pose, steering, share * length, radius_m)[:2])
        pose = moved(pose, steering, length, radius_m)
    xy = np.array(points)
    return xy[np.r_[True, np.hypot(*np.diff(xy, axis=0).T) > 1e-9]]


@dataclass(frozen=True, eq=False)
class Turns:
    """The turns of one rover on some ground.

    Parameters
    ----------
    ground : FreeGround
        Where it may be.
    turning : Turning
        Radius greater than 0.
    """

    ground: FreeGround
    turning: Turning

    @cached_property
    def roomy(self) -> FreeGround:
        """The ground with room to round a right-angled corner."""
        narrowed = self.ground.polygon.buffer(-turning_room_m(self.turning.turn_radius_m), quad_segs=2)
        return FreeGround(narrowed) if not narrowed.is_empty else self.ground

    def between(self, start: Pose, goal: Pose) -> FloatArray:
        """Return the waypoints (N, 2) of a turn that stays on the ground.

        The shortest word that does; where obstacles leave none, a chain of words along
        the shortest way that keeps room for rounding its corners.

        Raises
        ------
        InputError
            Neither fits.
        """
        for points in (self._direct(start, goal), self._along_way(start, goal)):
            if points is not None:
                return points
        raise InputError(
            f"no turn of radius {self.turning.turn_radius_m:g} m leads from ({start[0]:.1f}, {start[1]:.1f}) to ({goal[0]:.1f}, {goal[1]:.1f}) "
            "on the free ground; give swaths a wider inset, or the rover a smaller radius or leave to reverse."
        )

    def _direct(self, start: Pose, goal: Pose) -> FloatArray | None:
        """Return the first of the shortest words that stays on the ground, its end set to the goal."""
        for word in _words(start, goal, self.turning)[:_MOST_WORDS]:
            points = traced(start, word, self.turning.turn_radius_m)
            points[-1] = goal[:2]
            if self.ground.covers(LineString(points)):
                return points
        return None

    def _along_way(self, start: Pose, goal: Pose) -> FloatArray | None:
        """Return words chained through the middles of the pieces of the shortest roomy way."""
        ends = np.array([start[:2], goal[:2]])
        try:
            way = self.roomy.way(*self.roomy.inside(ends))
        except InputError:
            return None
        poses = [start]
        for a, b in pairwise(way):
            x, y = 0.5 * (a + b)
            poses.append((float(x), float(y), float(np.arctan2(b[1] - a[1], b[0] - a[0]))))
        pieces: list[FloatArray] = []
        for first, second in pairwise([*poses, goal]):
            piece = self._direct(first, second)
            if piece is None:
                return None
            pieces.append(piece if not pieces else piece[1:])
        return np.vstack(pieces)


def turning_room_m(turn_radius_m: float) -> float:
    """Return how far from a border the way must run so that an arc rounds a right-angled corner: R (√2 - 1) [m]."""
    return turn_radius_m * float(np.sqrt(2.0) - 1.0)


def headland_m(turning: Turning, spacing_m: float) -> float:
    r"""Return the width of border that turns from swath to swath take; 0 for a rover that pivots [m].

    .. math::  \max(2 R, \; R + \sqrt{(2 R)^2 - (R + d / 2)^2})

    Two radii hold the half circle beside a swath's end, however slanted the border. A rover
    that only drives forwards and whose swaths are d < 2 R apart needs the second term: it
    swings out and back on three arcs, the middle one's centre as far beyond the ends as the
    root says.

    Examples
    --------
    >>> headland_m(Turning(turn_radius_m=5.0), 20.0), headland_m(Turning(), 20.0)
    (10.0, 0.0)
    """
    radius = turning.turn_radius_m
    if turning.reverse or spacing_m >= 2.0 * radius:
        return 2.0 * radius
    beyond = (2.0 * radius) ** 2 - (radius + 0.5 * spacing_m) ** 2
    return max(2.0 * radius, radius + float(np.sqrt(beyond)))

"""Turns of rovers that cannot pivot: shortest words of arcs and lines between poses, and headlands to turn in.

A pose is (x, y, heading), in metres and radians counter-clockwise from east. A word is a row of pieces (steering,
length): steering 1 left, -1 right, 0 straight; length in turning radii, negative when driven backwards. Words are those
of Dubins (1957), forwards only, or of Reeds and Shepp (1990), also backwards. `Turns` takes the shortest word that stays
on the free ground; a headland is the room along the border that turns need.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from shapely import LineString

from planners.routes.rover import Turning, turning_room_m
from planners.routes.shortest_paths import FreeGround
from survey.core import ConfigError, FloatArray, InputError

Pose = tuple[float, float, float]
Word = tuple[tuple[int, float], ...]

_TURN_RAD = 2.0 * np.pi
_QUARTER_RAD = 0.5 * np.pi


def word_length(word: Word) -> float:
    """Return the length of a word in turning radii."""
    return float(sum(abs(length) for _, length in word))


def dubins_words(start: Pose, goal: Pose, radius_m: float) -> list[Word]:
    """Return the words that are driven forwards from pose to pose, the shortest first.

    The shortest way of bounded curvature is one of them (Dubins 1957).

    >>> words = dubins_words((0.0, 0.0, 0.0), (0.0, 4.0, np.pi), 2.0)
    >>> [(steering, round(length, 3)) for steering, length in words[0] if length > 1e-9]
    [(1, 3.142)]
    """
    x, y, turn = _local(start, goal, radius_m)
    words: list[Word] = []
    for side in (1, -1):
        # The words that begin to the right are those of the mirrored goal that begin to the left.
        words += [_mirrored(word, side) for word in _left_words(x, side * y, side * turn)]
    return sorted(words, key=word_length)


def reeds_shepp_words(start: Pose, goal: Pose, radius_m: float) -> list[Word]:
    """Return the words that may also be driven backwards, the shortest first.

    The shortest way is one of 48 words (Reeds and Shepp 1990): nine formulas, applied to
    the goal as it is, mirrored in time, mirrored left to right, and both; and from the
    goal back to the start.

    >>> word = reeds_shepp_words((0.0, 0.0, 0.0), (-3.0, 0.0, 0.0), 1.0)[0]
    >>> round(word_length(word), 6)
    3.0
    """
    x, y, turn = _local(start, goal, radius_m)
    cos, sin = np.cos(turn), np.sin(turn)
    back = (x * cos + y * sin, x * sin - y * cos, turn)
    words: list[Word] = []
    for time in (1.0, -1.0):
        for side in (1, -1):
            for (gx, gy, _), is_back in (((x, y, turn), False), (back, True)):
                found = _reversing_words(time * gx, side * gy, time * side * turn)
                for word in found:
                    turned = tuple((side * steering, time * length) for steering, length in word)
                    words.append(turned[::-1] if is_back else turned)
    return sorted((word for word in words if _arrives(word, x, y, turn)), key=word_length)


def _local(start: Pose, goal: Pose, radius_m: float) -> Pose:
    """Return the goal as seen from the start, in turning radii."""
    dx, dy = (goal[0] - start[0]) / radius_m, (goal[1] - start[1]) / radius_m
    cos, sin = np.cos(start[2]), np.sin(start[2])
    return dx * cos + dy * sin, dy * cos - dx * sin, _wrapped(goal[2] - start[2])


def _mirrored(word: Word, side: int) -> Word:
    return tuple((side * steering, length) for steering, length in word)


def _positive(angle: float) -> float:
    """Return an angle in [0, 2 π); rounding below a full turn counts as none."""
    wrapped = float(angle % _TURN_RAD)
    return 0.0 if _TURN_RAD - wrapped < 1e-9 else wrapped


def _wrapped(angle: float) -> float:
    """Return an angle in (-π, π]."""
    return float(np.pi - (np.pi - angle) % _TURN_RAD)


def _left_words(x: float, y: float, turn: float) -> Iterator[Word]:
    """Yield the Dubins words LSL, LRL and LSR from (0, 0, 0) with unit radius.

    The first circle is centred at (0, 1); a left circle through the goal at
    (x - sin turn, y + cos turn), a right one at (x + sin turn, y - cos turn). On a left
    circle the heading is a quarter turn ahead of the direction from the centre.
    """
    left = np.array([x - np.sin(turn), y + np.cos(turn) - 1.0])
    distance, angle = float(np.hypot(*left)), float(np.arctan2(left[1], left[0]))
    yield (1, _positive(angle)), (0, distance), (1, _positive(turn - angle))
    if distance <= 4.0:
        for sign in (1.0, -1.0):
            towards = angle + sign * np.arccos(0.25 * distance)
            onwards = np.arctan2(left[1] - 2.0 * np.sin(towards), left[0] - 2.0 * np.cos(towards))
            first, second = towards + _QUARTER_RAD, onwards + 3.0 * _QUARTER_RAD
            yield (1, _positive(first)), (-1, _positive(first - second)), (1, _positive(turn - second))
    right = np.array([x + np.sin(turn), y - np.cos(turn) - 1.0])
    distance, angle = float(np.hypot(*right)), float(np.arctan2(right[1], right[0]))
    if distance >= 2.0:
        first = angle + np.arcsin(2.0 / distance)
        yield (1, _positive(first)), (0, float(np.sqrt(distance**2 - 4.0))), (-1, _positive(first - turn))


def _reversing_words(x: float, y: float, turn: float) -> Iterator[Word]:
    """Yield the nine formulas of Reeds and Shepp (their Eqs. 8.1 to 8.11) that apply."""
    s, c = float(np.sin(turn)), float(np.cos(turn))
    yield from _same_side(x - s, y - 1.0 + c, turn)
    yield from _other_side(x + s, y - 1.0 - c, turn)


def _polar(x: float, y: float) -> tuple[float, float]:
    return float(np.hypot(x, y)), float(np.arctan2(y, x))


def _same_side(a: float, b: float, turn: float) -> Iterator[Word]:
    """Return the words that begin and end on left circles: L S L, L R L and L R S L."""
    rho, angle = _polar(a, b)
    yield (1, angle), (0, rho), (1, _wrapped(turn - angle))
    if rho <= 4.0:
        middle = -2.0 * np.arcsin(0.25 * rho)
        first = _wrapped(angle + 0.5 * middle + np.pi)
        yield (1, first), (-1, middle), (1, _wrapped(turn - first + middle))
    if rho >= 2.0:
        r = np.sqrt(rho**2 - 4.0)
        first = _wrapped(angle + np.arctan2(r, -2.0))
        yield (1, first), (-1, -_QUARTER_RAD), (0, 2.0 - r), (1, _wrapped(turn - _QUARTER_RAD - first))


def _other_side(a: float, b: float, turn: float) -> Iterator[Word]:
    """Return the words that begin left and end right: L S R, L R L R, L R S R and L R S L R."""
    rho, angle = _polar(a, b)
    if rho >= 2.0:
        straight = np.sqrt(rho**2 - 4.0)
        first = _wrapped(angle + np.arctan2(2.0, straight))
        yield (1, first), (0, straight), (-1, _wrapped(first - turn))
    yield from _four_arcs(a, b, turn)
    if rho >= 2.0:
        first = float(np.arctan2(a, -b))
        yield (1, first), (-1, -_QUARTER_RAD), (0, 2.0 - rho), (-1, _wrapped(first + _QUARTER_RAD - turn))
        straight = 4.0 - np.sqrt(rho**2 - 4.0)
        if straight <= 0.0:
            first = _wrapped(np.arctan2((4.0 - straight) * a - 2.0 * b, -2.0 * a + (straight - 4.0) * b))
            last = _wrapped(first - turn)
            yield (1, first), (-1, -_QUARTER_RAD), (0, straight), (1, -_QUARTER_RAD), (-1, last)


def _four_arcs(a: float, b: float, turn: float) -> Iterator[Word]:
    """Return L R L R with the two middle arcs of equal length, driven in opposite or in the same direction."""
    rho = 0.25 * (2.0 + np.hypot(a, b))
    if rho <= 1.0:
        u = float(np.arccos(rho))
        first, last = _outer_arcs(u, -u, a, b, turn)
        yield (1, first), (-1, u), (1, -u), (-1, last)
    rho = (20.0 - a * a - b * b) / 16.0
    if 0.0 <= rho <= 1.0:
        u = -float(np.arccos(rho))
        if u >= -_QUARTER_RAD:
            first, last = _outer_arcs(u, u, a, b, turn)
            yield (1, first), (-1, u), (1, u), (-1, last)


def _outer_arcs(u: float, v: float, a: float, b: float, turn: float) -> tuple[float, float]:
    delta = _wrapped(u - v)
    p, q = np.sin(u) - np.sin(delta), np.cos(u) - np.cos(delta) - 1.0
    first = np.arctan2(b * p - a * q, a * p + b * q)
    if 2.0 * (np.cos(delta) - np.cos(v) - np.cos(u)) + 3.0 < 0.0:
        first += np.pi
    first = _wrapped(first)
    return first, _wrapped(first - u + v - turn)


def _arrives(word: Word, x: float, y: float, turn: float) -> bool:
    """Return whether a word, driven from (0, 0, 0), ends at the goal; formulas outside their domain do not."""
    here = (0.0, 0.0, 0.0)
    for steering, length in word:
        here = moved(here, steering, length, 1.0)
    return abs(here[0] - x) + abs(here[1] - y) + abs(_wrapped(here[2] - turn)) < 1e-6


def moved(pose: Pose, steering: int, length: float, radius_m: float) -> Pose:
    """Return the pose after one piece of a word, or part of it.

    >>> x, y, heading = moved((0.0, 0.0, 0.0), 1, np.pi, 2.0)
    >>> round(float(y), 6), round(float(heading), 6)
    (4.0, 3.141593)
    """
    x, y, heading = pose
    if steering == 0:
        return x + radius_m * length * np.cos(heading), y + radius_m * length * np.sin(heading), heading
    ahead = heading + steering * length
    return (
        x + steering * radius_m * (np.sin(ahead) - np.sin(heading)),
        y - steering * radius_m * (np.cos(ahead) - np.cos(heading)),
        ahead,
    )


_CHORD_RAD = np.radians(5.0)
_MOST_WORDS = 12


def turn_length_m(start: Pose, goal: Pose, turning: Turning) -> float:
    """Return the length of the shortest turn on open ground [m].

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

    `ground`: where it may be. `turning`: radius greater than 0.
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


def headland_m(turning: Turning, spacing_m: float) -> float:
    r"""Return the width of border that turns from swath to swath take; 0 for a rover that pivots [m].

    .. math::  \max(2 R, \; R + \sqrt{(2 R)^2 - (R + d / 2)^2})

    Two radii hold the half circle beside a swath's end, however slanted the border. A rover
    that only drives forwards and whose swaths are d < 2 R apart needs the second term: it
    swings out and back on three arcs, the middle one's centre as far beyond the ends as the
    root says.

    >>> headland_m(Turning(turn_radius_m=5.0), 20.0), headland_m(Turning(), 20.0)
    (10.0, 0.0)
    """
    radius = turning.turn_radius_m
    if turning.reverse or spacing_m >= 2.0 * radius:
        return 2.0 * radius
    beyond = (2.0 * radius) ** 2 - (radius + 0.5 * spacing_m) ** 2
    return max(2.0 * radius, radius + float(np.sqrt(beyond)))

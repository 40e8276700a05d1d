"""Swaths worth driving: pieces of a line joined around short notches, and pieces left out that are too short.

A piece takes the way to it and its turns. It is left out where it measures less, and a notch in front of it is driven
around where this is shorter.
"""

from collections.abc import Sequence

import numpy as np
import shapely

from planners.routes.shortest_paths import FreeGround
from planners.swaths.reference_lines import Swath
from survey.core import FloatArray, IntArray

APART_M = 0.01
"""Parallel lines that are nearer to each other are one [m]."""
_NEAR = 1.5
"""A piece that is too short is driven where no other swath passes within so many times the shortest length."""


def worth_driving(
    swaths: Sequence[Swath], ground: FreeGround, shortest_m: float, *, bends: bool = True
) -> list[Swath]:
    """Join pieces of a line around short notches (`bends`), and leave out those shorter than `shortest_m` [m].

    A line keeps its longest piece. Ground far from all other swaths, such as an arm that runs across them, keeps pieces
    of a quarter of this length. The swaths run along one heading or square to it.
    """
    if shortest_m == 0.0 or not swaths:
        return list(swaths)
    swaths = _bridged(swaths, ground, shortest_m) if bends else swaths
    shapes = np.array([shapely.linestrings(swath.xy) for swath in swaths])
    lengths = shapely.length(shapes)
    keeps = lengths >= shortest_m
    keeps[[line[np.argmax(lengths[line])] for line in _lines(swaths)]] = True
    for index in np.argsort(-lengths.round(3), kind="stable"):
        if not keeps[index] and lengths[index] >= 0.25 * shortest_m:
            keeps[index] = shapely.distance(shapes[keeps], shapes[index]).min() > _NEAR * shortest_m
    kept = [swath for swath, keep in zip(swaths, keeps, strict=True) if keep]
    return _bridged(kept, ground, shortest_m) if bends else kept


def _lines(swaths: Sequence[Swath]) -> list[IntArray]:
    """Return the swaths of each line, in their order along it."""
    ends = np.array([swath.axis for swath in swaths])
    moves = ends[:, 1] - ends[:, 0]
    along = moves[np.argmax(np.hypot(*moves.T))]
    along = along / np.hypot(*along)
    left = np.array([-along[1], along[0]])
    is_across = np.abs(moves @ left) > np.abs(moves @ along)
    middle = ends.mean(axis=1) - ends[0, 0]
    across = np.where(is_across, middle @ along, middle @ left)
    order = np.lexsort((across, is_across))
    is_new = (np.diff(across[order]) > APART_M) | np.diff(is_across[order])
    first = np.array([swath.xy[0] for swath in swaths])
    lines = np.split(order, np.flatnonzero(is_new) + 1)
    return [line[np.argsort(first[line] @ moves[line[0]], kind="stable")] for line in lines]


def _bridged(swaths: Sequence[Swath], ground: FreeGround, most_m: float) -> list[Swath]:
    """Join neighbouring pieces of a line where the way between them is no longer than either, and than `most_m`."""
    joined: dict[int, Swath] = {}
    for line in _lines(swaths):
        last = -1
        for index in line.tolist():
            piece = swaths[index]
            way = None if last < 0 else _way(joined[last], piece, ground, most_m)
            if way is None:
                last, joined[index] = index, piece
            else:
                axis = np.array([joined[last].axis[0], piece.axis[1]])
                joined[last] = Swath(np.vstack([joined[last].xy, way[1:-1], piece.xy]), axis)
    return [joined[index] for index in sorted(joined)]


def _way(one: Swath, other: Swath, ground: FreeGround, most_m: float) -> FloatArray | None:
    """Return the shortest way (N, 2) between two pieces; None where it is longer than one of them, or than `most_m`."""
    ends, most_m = [one.xy[-1], other.xy[0]], min(most_m, _length_m(one.xy), _length_m(other.xy))
    if _length_m(np.array(ends)) > most_m or np.ptp(ground.part_of(ends)) != 0:
        return None
    way = ground.way(*ends)
    return way if _length_m(way) <= most_m else None


def _length_m(xy: FloatArray) -> float:
    return float(np.hypot(*np.diff(xy, axis=0).T).sum())

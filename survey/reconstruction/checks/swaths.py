"""Swaths of a drive from the points' keyframes and headings, to be left out one at a time."""

from typing import NamedTuple

import numpy as np

from survey.core.arrays import FloatArray, IntArray
from survey.data.surface_points import SurfacePoints

# A swath ends where the heading has turned by more than this from that of its beginning [rad].
_TURN_RAD = np.radians(50.0)
# A swath is left out in pieces of at most this share of all points, and of at most so many points.
_LARGEST_SHARE, _MOST_POINTS = 0.3, 1000
# Runs with fewer points are turns, and are never left out.
_N_LEAST = 15


class Swaths(NamedTuple):
    """Numbers of the swath from which points were seen (N,), -1 for points of short runs; and whether some are parts."""

    number: IntArray
    are_parts: bool


def swaths_of(points: SurfacePoints) -> Swaths:
    """Return the swath from which each point was seen.

    Points are ordered by their keyframes. A swath is a run without a turn; runs that hold more than three
    tenths of all points, or more than 1,000, are cut into equal parts.

    Parameters
    ----------
    points : SurfacePoints
        Points that name their keyframes and headings.

    Examples
    --------
    >>> heading = np.repeat([0.0, 1.57, 3.14], [40, 2, 40])
    >>> line = SurfacePoints(
    ...     np.zeros((82, 3)), covariance=np.tile(np.eye(3), (82, 1, 1)), own_covariance=np.tile(np.eye(3), (82, 1, 1)),
    ...     keyframe=np.arange(82.0), heading_rad=heading, body=np.zeros((82, 3)), crs="EPSG:32608")
    >>> np.unique(swaths_of(line).number, return_counts=True)[1].tolist()
    [2, 20, 20, 20, 20]
    """
    assert points.keyframe is not None
    assert points.heading_rad is not None
    order = np.argsort(points.keyframe, kind="stable")
    swath = np.full(len(points), -1, dtype=np.int64)
    n_swaths, are_parts = 0, False
    for run in _runs(points.heading_rad[order]):
        rows = order[run]
        if len(rows) < _N_LEAST:
            continue
        most = min(max(_LARGEST_SHARE * len(points), _N_LEAST), _MOST_POINTS)
        n_pieces = int(np.ceil(len(rows) / most))
        are_parts |= n_pieces > 1
        for piece in np.array_split(rows, n_pieces):
            swath[piece] = n_swaths
            n_swaths += 1
    return Swaths(swath, are_parts)


def groups_of(xy: FloatArray, most: int) -> list[IntArray]:
    """Return the rows of groups of neighbours, by halving the points along their longer extent.

    Parameters
    ----------
    xy : (N, 2) ndarray
        Places [m].
    most : int
        Largest number of points in a group.

    Examples
    --------
    >>> [rows.tolist() for rows in groups_of(np.array([[0.0, 0.0], [9.0, 0.0], [1.0, 0.0], [8.0, 0.0]]), 2)]
    [[0, 2], [3, 1]]
    """
    found, waiting = [], [np.arange(len(xy))]
    while waiting:
        rows = waiting.pop()
        if len(rows) <= most:
            found.append(rows)
            continue
        axis = int(np.argmax(np.ptp(xy[rows], axis=0)))
        rows = rows[np.argsort(xy[rows, axis], kind="stable")]
        waiting += [rows[len(rows) // 2 :], rows[: len(rows) // 2]]
    return found


def _runs(heading_rad: FloatArray) -> list[slice]:
    """Return runs of headings that stay within a turn of that at their beginning."""
    starts, first = [0], heading_rad[0]
    for k, heading in enumerate(heading_rad):
        if abs((heading - first + np.pi) % (2.0 * np.pi) - np.pi) > _TURN_RAD:
            starts.append(k)
            first = heading
    return [slice(a, b) for a, b in zip(starts, [*starts[1:], len(heading_rad)], strict=True)]

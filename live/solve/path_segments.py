"""Division of a path's unknowns into segments between knots, each of which can be eliminated on its own."""

from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from survey.core.arrays import FloatArray, IntArray
from survey.data.path_error import PathError

KEYFRAMES = 24
"""Keyframes of a segment: the fewer, the more unknowns are left for the end; the more, the dearer each segment."""


class PathSegments(NamedTuple):
    """Unknowns and points in the order of segments.

    Parameters
    ----------
    interior : (S - R,) ndarray of int
        Unknowns that only one segment touches, segment after segment.
    bounds : (n + 1,) ndarray of int
        Where each segment begins in `interior`.
    knots : (R,) ndarray of int
        All other unknowns: poses between segments, and what the points of several segments share.
    points : (N,) ndarray of int
        Points, segment after segment.
    point_bounds : (n + 1,) ndarray of int
        Where each segment begins in `points`.
    """

    interior: IntArray
    bounds: IntArray
    knots: IntArray
    points: IntArray
    point_bounds: IntArray


def path_segments(path: PathError, keyframe: FloatArray, rows: Any, n_common: int = 0) -> PathSegments:
    """Divide a path between knots, so that no segment touches the inside of another.

    Parameters
    ----------
    path : PathError
        Its information may link keyframes that are far apart; both ends of such a link become knots.
    keyframe : (N,) ndarray
        Places of the points among the keyframes.
    rows : (N, S) scipy.sparse array
        Derivatives of the points by all shared unknowns, those of the path first.
    n_common : int
        How many unknowns after those of the path are left for the end in any case.

    Returns
    -------
    PathSegments
        Every unknown and every point once.

    Examples
    --------
    >>> path = PathError(np.arange(60.0), sparse.identity(360, format="csr"))
    >>> keyframe = np.array([3.0, 30.5])
    >>> found = path_segments(path, keyframe, path.rows(keyframe, np.ones((2, 6))))
    >>> len(found.interior), len(found.knots), found.point_bounds
    (336, 24, array([0, 1, 2, 2]))
    """
    knots = _knots(path)
    segment = np.searchsorted(knots, np.minimum(keyframe.astype(np.int64), len(path) - 2), side="right") - 1
    place = _segment_of_unknowns(path, knots, segment, sparse.coo_array(rows))
    place[path.n_unknowns : path.n_unknowns + n_common] = -1
    order = np.argsort(place, kind="stable")
    n_kept = int((place < 0).sum())
    edges = np.arange(len(knots))
    interior, points = order[n_kept:], np.argsort(segment, kind="stable")
    return PathSegments(
        interior,
        np.searchsorted(place[interior], edges),
        order[:n_kept],
        points,
        np.searchsorted(segment[points], edges),
    )


def _knots(path: PathError) -> IntArray:
    """Return the keyframes between segments: the first, the last, every few, and those of links across."""
    n_keyframes, n_states = len(path), path.n_states
    links = sparse.coo_array(path.information)
    one, other = links.row // n_states, links.col // n_states
    is_far = (np.maximum(one, other) < n_keyframes) & (np.abs(one - other) > 1) & (links.data != 0.0)
    regular = np.arange(0, n_keyframes - 1, KEYFRAMES)
    knots: IntArray = np.unique(np.r_[regular, n_keyframes - 1, one[is_far], other[is_far]])
    return knots


def _segment_of_unknowns(path: PathError, knots: IntArray, segment: IntArray, rows: Any) -> IntArray:
    """Return the segment (S,) that each unknown lies in; -1 for those at knots and those of several segments."""
    place = np.full(rows.shape[1], -1)
    n_of_keyframes = len(path) * path.n_states
    of_keyframe = np.searchsorted(knots, np.arange(len(path)), side="right") - 1
    of_keyframe[knots] = -1
    place[:n_of_keyframes] = np.repeat(of_keyframe, path.n_states)
    is_other = rows.col >= path.n_unknowns
    column, here = rows.col[is_other], segment[rows.row[is_other]]
    lowest = np.full(rows.shape[1], len(knots))
    highest = np.full(rows.shape[1], -1)
    np.minimum.at(lowest, column, here)
    np.maximum.at(highest, column, here)
    return np.where(lowest == highest, lowest, place)

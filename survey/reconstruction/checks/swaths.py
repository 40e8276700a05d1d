"""Swaths of a drive from the points' keyframes and headings, to be left out one at a time."""

import numpy as np

from survey.core.arrays import FloatArray, IntArray
from survey.data.surface_points import SurfacePoints

# A swath ends where the heading has turned by more than this from that of its beginning [rad].
_TURN_RAD = np.radians(50.0)
# Straight drives are cut into pieces of at most this share of all points.
_LARGEST_SHARE = 0.3
# Runs with fewer points are turns, and are never left out.
_N_LEAST = 15


def swaths_of(points: SurfacePoints) -> IntArray:
    """Return the number of the swath from which each point was seen (N,); -1 for points of short runs.

    Points are ordered by their keyframes. A swath is a run without a turn; runs that hold more than three
    tenths of all points are cut into equal pieces.

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
    >>> np.unique(swaths_of(line), return_counts=True)[1].tolist()
    [2, 20, 20, 20, 20]
    """
    assert points.keyframe is not None
    assert points.heading_rad is not None
    order = np.argsort(points.keyframe, kind="stable")
    swath = np.full(len(points), -1, dtype=np.int64)
    n_swaths = 0
    for run in _runs(points.heading_rad[order]):
        rows = order[run]
        if len(rows) < _N_LEAST:
            continue
        n_pieces = int(np.ceil(len(rows) / max(_LARGEST_SHARE * len(points), _N_LEAST)))
        for piece in np.array_split(rows, n_pieces):
            swath[piece] = n_swaths
            n_swaths += 1
    return swath


def _runs(heading_rad: FloatArray) -> list[slice]:
    """Return runs of headings that stay within a turn of that at their beginning."""
    starts, first = [0], heading_rad[0]
    for k, heading in enumerate(heading_rad):
        if abs((heading - first + np.pi) % (2.0 * np.pi) - np.pi) > _TURN_RAD:
            starts.append(k)
            first = heading
    return [slice(a, b) for a, b in zip(starts, [*starts[1:], len(heading_rad)], strict=True)]

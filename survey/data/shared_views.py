"""Errors that landmarks share beyond those of the path: of what is seen from one stretch of it, and of far ground."""

import numpy as np

from survey.core.arrays import FloatArray, IntArray
from survey.data.surface_points import SurfacePoints

STRETCH_M = 5.0
"""Travel over which landmarks share an error of height [m]."""
SHARED_SIGMA_M = 0.017
"""Standard deviation of that error for landmarks from images [m]: means of ten seconds scatter by 1.3 cm, 2.3 to 2.5
times what independent errors make of them."""
_FAR_FROM_M, _FAR_TO_M = 10.0, 15.0


def far_share(range_m: FloatArray) -> FloatArray:
    """Return the share (N,) of the height bias of far landmarks at ranges (N,): 0 to 10 m, 1 from 15 m on.

    At grazing angles a camera sees crests and not the troughs between them, so what it sees lies above the mean
    ground.

    Parameters
    ----------
    range_m : (N,) ndarray
        Distance at first sight [m].

    Returns
    -------
    (N,) ndarray
        Between 0 and 1.

    Examples
    --------
    >>> far_share(np.array([5.0, 12.5, 30.0]))
    array([0. , 0.5, 1. ])
    """
    return np.clip((range_m - _FAR_FROM_M) / (_FAR_TO_M - _FAR_FROM_M), 0.0, 1.0)


def stretches(points: SurfacePoints, drive: IntArray | None = None) -> IntArray | None:
    """Return the number of the stretch of `STRETCH_M` of travel that each point was seen from.

    Parameters
    ----------
    points : SurfacePoints
        Landmarks.
    drive : (N,) ndarray of int, optional
        Number of the drive of each landmark; drives share no stretch.

    Returns
    -------
    (N,) ndarray of int or None
        Numbers from 0 on, of those stretches that points were seen from; None for points that name no keyframe.
    """
    if points.keyframe is None or points.body is None:
        return None
    _, first, pose = np.unique(points.keyframe, return_index=True, return_inverse=True)
    steps = np.linalg.norm(np.diff(points.body[first], axis=0), axis=1)
    travel_m = np.r_[0.0, np.cumsum(steps)]
    stretch = np.floor(travel_m / STRETCH_M)
    if drive is not None:
        stretch = stretch + drive[first] * (stretch[-1] + 1.0)
    _, numbers = np.unique(stretch[pose], return_inverse=True)
    return numbers

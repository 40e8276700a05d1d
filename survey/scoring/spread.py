"""Spread of the samples of a survey: centeredness α and distributedness β (Eqs. 12 to 16)."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.legs import RouteSamples
from survey.data.route import Route

SHORTEST_STEP_M = 1.0
"""Cross-track steps below this are left out of Eq. 15 [m]."""
# A straight swath deviates from its axis by rounding alone.
_STRAIGHT_M = 1e-6


def centeredness(samples: Any, reference: Any, farthest_m: float) -> float:
    r"""Return the distance of the samples' centre of mass from the reference, relative (α, Eqs. 12 and 13).

    .. math::  \alpha = \| \tfrac{1}{M} \sum_m x_m - x_{ref} \| / D_{max}

    Parameters
    ----------
    samples : (M, 2) array_like
        Easting and northing of every sample taken, repeats included [m].
    reference : (2,) array_like
        The centre of the area [m].
    farthest_m : float
        :math:`D_{max}`: distance from the reference to the farthest point of the area [m].

    Returns
    -------
    float
        0 (best) to 1.

    Notes
    -----
    Samples crowded around the centre and samples along the border both give 0.

    Examples
    --------
    >>> centeredness([[0.0, 0.0], [6.0, 8.0]], (0.0, 0.0), farthest_m=10.0)
    0.5
    """
    points = np.asarray(samples, dtype=np.float64).reshape(-1, 2)
    if len(points) == 0 or not farthest_m > 0.0:
        raise InputError(
            f"centeredness needs samples and an area around the reference; there are {len(points)} samples and "
            f"{farthest_m} m to the farthest point."
        )
    return float(np.hypot(*(points.mean(axis=0) - np.asarray(reference)))) / farthest_m


def distribution(route: Route, tracks: Sequence[RouteSamples]) -> float | None:
    r"""Return the mean distance from the swath over the mean step across it (β, Eqs. 14 to 16).

    .. math::  \beta_a = \frac{1}{M} \sum_{m=1}^M |y_m|, \quad
               \beta_b = \frac{1}{K} \sum_{|y_m - y_{m+1}| \ge 1\,\mathrm{m}} |y_m - y_{m+1}|, \quad
               \beta = \beta_a / \beta_b

    with y the distance of a sample from the axis of its own swath and K the number of
    those steps. The paper divides by M − 1 in any case; steps from one swath to the
    next and samples on transits are left out here.

    Parameters
    ----------
    route : Route
        The legs and their axes.
    tracks : sequence of RouteSamples
        `Route.sample` of every rover.

    Returns
    -------
    float or None
        0 for straight swaths; ``None`` when swaths deviate but never by a metre from one
        sample to the next, or when no sample lies on a swath.

    Examples
    --------
    >>> from survey.data.route import Leg
    >>> zigzag = Leg("swath", [[0, 0], [6, 8], [12, 0]], axis=[[0, 0], [12, 0]])
    >>> route = Route((zigzag,), "EPSG:32608", "zigzag")
    >>> distribution(route, [route.sample(5.0)])
    0.8
    """
    offsets = [
        _across(route.legs[leg].axis, track.xy[track.leg == leg])
        for track in tracks
        for leg in np.unique(track.leg)
        if route.legs[leg].kind == "swath"
    ]
    if not offsets:
        return None
    mean_offset_m = float(np.abs(np.concatenate(offsets)).mean())
    if mean_offset_m < _STRAIGHT_M:
        return 0.0
    steps = np.concatenate([np.abs(np.diff(y)) for y in offsets])
    # The slack lets a step of exactly 1 m count whatever the rounding.
    steps = steps[steps >= SHORTEST_STEP_M - _STRAIGHT_M]
    return mean_offset_m / float(steps.mean()) if len(steps) else None


def _across(axis: FloatArray, xy: FloatArray) -> FloatArray:
    """Return the signed distance (N,) of places from the straight line through both ends of an axis [m]."""
    (x0, y0), (x1, y1) = axis
    length = float(np.hypot(x1 - x0, y1 - y0))
    if length == 0.0:
        raise InputError(
            f"a swath's axis starts and ends at ({x0:.1f}, {y0:.1f}); give it two different ends."
        )
    signed: FloatArray = ((x1 - x0) * (xy[:, 1] - y0) - (y1 - y0) * (xy[:, 0] - x0)) / length
    return signed

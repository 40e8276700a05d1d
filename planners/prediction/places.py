"""Places where a map is judged and where samples are taken, and the distance over which the slopes of a terrain change."""

import numpy as np

from planners.capacity import require_samples
from survey import InputError, Route, SurveyArea
from survey.core import FloatArray
from survey.reconstruction.gp.kernels import Kernel

# The plastic number, whose powers spread places evenly over the plane (Roberts 2018).
_PLASTIC = 1.324717957244746
_MOST_DRAWN = 100
"""Places drawn for each one wanted, at most: the bounds of a thin area hold little of it."""


def spread_places(area: SurveyArea, n: int) -> FloatArray:
    """Return places that are spread evenly over the free ground, in no step with any swaths.

    Places on a square grid would all lie on swaths, or all between them, where the swaths are as far apart as the nodes.

    Returns (M, 2): easting and northing [m]; any first part of them is spread evenly.

    >>> spread_places(SurveyArea.rectangle((0.0, 0.0, 20.0, 10.0), "EPSG:32608"), 2).round(1).tolist()
    [[5.1, 0.7], [0.2, 6.4]]
    """
    low, high = np.array(area.bounds[:2]), np.array(area.bounds[2:])
    drawn = min(int(n * np.prod(high - low) / max(area.free.area, 1e-9)), _MOST_DRAWN * n)
    share = (0.5 + np.arange(1, drawn + 1)[:, None] / _PLASTIC ** np.array([1, 2])) % 1.0
    places = low + share * (high - low)
    inside: FloatArray = places[area.contains(places)]
    if not len(inside):
        raise InputError("the area is so thin that no node of its map lies on free ground; widen it.")
    return inside


def places(route: Route, step_m: float) -> FloatArray:
    """Return the samples (N, 2) that all rovers take along everything they drive [m]."""
    require_samples(route.length_m, step_m)
    return np.vstack([route.sample(step_m, rover).xy for rover in range(route.n_rovers)])


def slope_length_m(kernel: Kernel) -> float:
    r"""Return the distance over which slopes change: what the length of a wave is measured by [m].

    .. math::  \sqrt{v / -k''(0)} \approx h / \sqrt{2 (1 - k(h) / v)}

    the standard deviation of heights over that of slopes. It is ℓ for the squared
    exponential and ℓ/√3 for the Matérn 3/2 covariance, so that one number fits smooth and
    rough terrain. Of several directions the shortest counts.
    """
    angles = np.linspace(0.0, np.pi, 12, endpoint=False)
    lag_m = 0.02 * kernel.length_scales_m[0]
    lags = lag_m * np.column_stack([np.cos(angles), np.sin(angles)])
    lost = 1.0 - kernel.covariance_of_lag(lags) / kernel.variance_m2
    return lag_m / float(np.sqrt(2.0 * lost.max()))

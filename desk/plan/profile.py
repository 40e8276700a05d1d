"""Elevation profile along a route."""

from typing import Any

import numpy as np

from desk.terrain.heights import heights_at
from desk.terrain.pyramid import ElevationPyramid
from survey.data.route import Route

_N_SAMPLES = 400


def profiles(route: Route, pyramid: ElevationPyramid, grid_per_ground: float) -> list[dict[str, Any]]:
    """Return heights along the path of each rover.

    Parameters
    ----------
    route : Route
        The route.
    pyramid : ElevationPyramid
        Heights.
    grid_per_ground : float
        Grid metres for each metre on the ground.

    Returns
    -------
    list of dict
        ``distance_m`` on the ground, ``heights_m`` (None where unknown) and ``places``.
    """
    found = []
    for rover in range(route.n_rovers):
        samples = route.sample(_length_m(route, rover) / _N_SAMPLES, rover)
        heights = heights_at(pyramid, samples.xy)
        found.append(
            {
                "rover": rover,
                "distance_m": (samples.distance_m / grid_per_ground).round(1).tolist(),
                "heights_m": [None if np.isnan(height) else round(float(height), 2) for height in heights],
                "places": samples.xy.round(2).tolist(),
            }
        )
    return found


def _length_m(route: Route, rover: int) -> float:
    return sum(leg.length_m for leg in route.legs if leg.rover == rover)

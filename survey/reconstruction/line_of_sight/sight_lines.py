"""Checks of lines of sight before they bound the ground."""

import numpy as np
from scipy.spatial import cKDTree

from survey.core.arrays import BoolArray, FloatArray
from survey.core.errors import InputError
from survey.data.surface_points import SurfacePoints

_SHORTEST_M = 1e-3
# The ground beside a sensor is what at least so many points say, within so many metres.
_N_LEAST, _BESIDE_M = 8, 6.0
_N_ASKED = 2_000
_UNDER_SHARE = 0.9
_ABOVE_SHARE = 0.9
# A ray that ends so many standard deviations below the map went somewhere else.
_OUTLYING_SIGMAS, _MEDIAN_TO_SIGMA = 4.0, 0.6745


def checked_origins(points: SurfacePoints) -> FloatArray:
    """Return where the sensor stood for every point (N, 3) [m], once the lines of sight make sense.

    Points above their sensor may be hills, trees or houses, and are retained. More than nine tenths are refused: the heights
    count downwards, origins and points are in different frames, or no ground was seen.

    Parameters
    ----------
    points : SurfacePoints
        With their sensors' origins.

    Raises
    ------
    InputError
        No origins; a point less than a millimetre from its sensor; nine tenths of the points
        above their sensor; a sensor under nine tenths of the points next to it, within 6 m.

    Examples
    --------
    >>> hit = SurfacePoints([[4.0, 0.0, 0.0]], sigma_m=0.1, origins=[[0.0, 0.0, 2.0]], crs="EPSG:32608")
    >>> checked_origins(hit)
    array([[0., 0., 2.]])
    """
    origins = points.origins
    if origins is None:
        raise InputError(
            "the points do not say where their sensor stood; lines of sight need origins, give them or leave the rays out."
        )
    length_m = np.linalg.norm(points.xyz - origins, axis=1)
    n_short = int((length_m < _SHORTEST_M).sum())
    if n_short:
        k = int(np.argmin(length_m))
        raise InputError(
            f"{n_short} points lie where their sensor stood (the first is number {k}), which is no line of sight; "
            "give the sensor's own place as origin, or leave these points out."
        )
    n_above = int((points.z > origins[:, 2]).sum())
    if n_above > _ABOVE_SHARE * len(points):
        raise InputError(
            f"{n_above} of {len(points)} points lie above their sensor; ground below it, heights that count upwards, and "
            "origins in the points' frame were expected."
        )
    _refuse_buried(points.xyz, origins)
    return origins


def ends_far_below(low_m: FloatArray, sigma_m: FloatArray) -> BoolArray:
    """Return which lines of sight end so far below a map that they went somewhere else.

    Parameters
    ----------
    low_m : (N,) ndarray
        How far their ends lie below the map [m]; NaN where it does not reach, where nothing is known.
    sigma_m : (N,) ndarray
        Standard deviations of the ends' heights [m].

    Returns
    -------
    (N,) ndarray of bool
        Those more than four standard deviations below, of the point itself and of the usual distance together.

    Examples
    --------
    >>> ends_far_below(np.array([0.0, 0.1, -0.1, 0.1, -0.1, 2.0, -2.0]), np.full(7, 0.02))
    array([False, False, False, False, False,  True, False])
    """
    known = np.isfinite(low_m)
    spread_m = float(np.median(np.abs(low_m[known]))) / _MEDIAN_TO_SIGMA if known.any() else 0.0
    far: BoolArray = known & (low_m > _OUTLYING_SIGMAS * np.hypot(spread_m, sigma_m))
    return far


def _refuse_buried(xyz: FloatArray, origins: FloatArray) -> None:
    """Refuse sensors that stood under the points beside them."""
    places = _distinct(origins)
    some = xyz[:: -(-len(xyz) // _N_ASKED)]
    tree = cKDTree(some[:, :2])
    beside = [np.asarray(tree.query_ball_point(place[:2], _BESIDE_M), dtype=np.int64) for place in places]
    # All within reach are asked: the nearest may hang over the sensor.
    buried = np.array(
        [
            len(near) >= _N_LEAST and np.mean(some[near, 2] > place[2]) > _UNDER_SHARE
            for place, near in zip(places, beside, strict=True)
        ]
    )
    if buried.any():
        x, y, z = places[np.argmax(buried)]
        raise InputError(
            f"{int(buried.sum())} of {len(places)} sensor places are under the ground, the first at ({x:.2f}, {y:.2f}, "
            f"{z:.2f}) m below the points beside it; give origins and points in one frame and one vertical datum."
        )


def _distinct(origins: FloatArray) -> FloatArray:
    """Return the places of a sensor, each once, where it moved between one point and the next."""
    moved: BoolArray = np.ones(len(origins), dtype=bool)
    moved[1:] = (origins[1:] != origins[:-1]).any(axis=1)
    return np.unique(origins[moved], axis=0)

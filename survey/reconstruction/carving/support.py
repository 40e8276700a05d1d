"""What stands behind the height of a carved surface."""

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt

from survey.core.arrays import FloatArray
from survey.reconstruction.base import INTERPOLATED, MEASURED, RAY_BOUNDED, UNSEEN
from survey.reconstruction.carving.cloud import Cloud
from survey.reconstruction.line_of_sight.ceiling import LowestRays
from survey.reconstruction.nodes import NodeWindow

Codes = npt.NDArray[np.uint8]


def support_codes(window: NodeWindow, cloud: Cloud, reach_m: float, *, rays: bool) -> Codes:
    """Return the support codes (H, W) of nodes: a point within half a step, rays over it, a point within reach.

    Parameters
    ----------
    window : NodeWindow
        Nodes in the cloud's coordinates.
    cloud : Cloud
        Points and their sensors.
    reach_m : float
        Distance within which a point determines the surface [m].
    rays : bool
        Whether lines of sight count.
    """
    hit = np.zeros(window.shape, dtype=bool)
    u, v = np.round(window.coordinates(cloud.xyz[:, :2])).astype(np.int64).T
    hit[np.clip(v, 0, window.rows - 1), np.clip(u, 0, window.columns - 1)] = True
    away_m: FloatArray = window.step_m * distance_transform_edt(~hit)
    codes = np.where(away_m <= reach_m, INTERPOLATED, UNSEEN)
    if rays:
        lowest = LowestRays.empty(window.shape)
        lowest.add(window, cloud.origins, cloud.xyz, np.zeros(len(cloud)))
        codes = np.where(lowest.covered(), RAY_BOUNDED, codes)
    return np.where(hit, MEASURED, codes).astype(np.uint8)

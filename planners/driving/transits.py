"""Transits between the ends of swaths: lengths and nearest neighbours."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from planners.capacity import MOST_LINES
from planners.ground.shortest_paths import Network
from survey.core.arrays import FloatArray, IntArray
from survey.core.errors import CapacityError

_NEIGHBOURS = 10


class Transits(NamedTuple):
    """Lengths of the transits between ends [m], looked up when first needed.

    An entry below zero is minus the straight distance: a bound, not yet the length.
    """

    length: npt.NDArray[np.float32]  # (E, E)
    near: IntArray  # (E, K) ends of other swaths, the nearest first
    parent: IntArray  # room for the search
    network: Network


def transits(network: Network, is_free: FloatArray) -> Transits:
    """Begin the table between the network's points, two per swath, those of the depots last.

    Ends with ``is_free`` > 0 are joined to any other at no cost.
    """
    xy = network.sights.xy
    n_swaths = len(xy) // 2
    if n_swaths > MOST_LINES:
        raise CapacityError(
            f"the area cuts the swaths into {n_swaths} pieces; at most {MOST_LINES} can be ordered at once, widen the spacing or "
            "split the area."
        )
    length = np.empty((len(xy), len(xy)), dtype=np.float32)
    for row, (x, y) in enumerate(xy):
        length[row] = -np.hypot(xy[:, 0] - x, xy[:, 1] - y)
    length[is_free > 0.0] = 0.0
    length[:, is_free > 0.0] = 0.0
    parent = np.empty(len(network.bends.xy) + 1, dtype=np.int64)
    return Transits(length, _near_ends(xy), parent, network)


def _near_ends(xy: FloatArray) -> IntArray:
    """Return the ends nearest to each end (E, K), those of its own swath left out."""
    k = min(_NEIGHBOURS + 2, len(xy))
    found = np.asarray(cKDTree(xy).query(xy, k=k)[1])
    rows = np.empty((len(xy), k - 2), dtype=np.int64)
    for end, candidates in enumerate(found):
        rows[end] = [c for c in candidates if c >> 1 != end >> 1][: k - 2]
    return rows

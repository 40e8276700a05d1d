"""OctoMap, the baseline of the EMap paper, with the topmost voxels as the surface."""

import os
import time
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.surface_points import SurfacePoints

# A ray is followed a little beyond the scanner's range, so that noise cuts none.
_FARTHEST_M = 11.0
_KEY_BITS = 21
_OCCUPIED = 1


class OctoMapSurface:
    """OctoMap of scans; every node takes the height of the nearest topmost occupied voxel.

    Parameters
    ----------
    resolution_m : float
        Side of a voxel [m].

    Raises
    ------
    InputError
        When octomap-python is not installed.

    Notes
    -----
    Voxels that were hit are remembered here, because walking through the tree from Python is
    far too slow; of these, the ones that the tree still holds occupied are asked for. Only
    the insertion is timed (`seconds`, CPU time of every scan).
    """

    def __init__(self, resolution_m: float) -> None:
        self.resolution_m = resolution_m
        self.seconds: list[float] = []
        self._tree = _octomap().OcTree(resolution_m)
        self._hit = np.zeros(0, dtype=np.int64)

    def insert(self, points: SurfacePoints) -> None:
        """Insert one scan, all of whose points were seen from one place."""
        if points.origins is None:
            raise InputError("the scan does not say where its sensor stood; OctoMap needs the origin.")
        cloud, origin = np.ascontiguousarray(points.xyz), np.array(points.origins[0])
        began = time.process_time()
        self._tree.insertPointCloud(cloud, origin, _FARTHEST_M)
        self.seconds.append(time.process_time() - began)
        self._hit = np.union1d(self._hit, _packed(np.floor(cloud / self.resolution_m).astype(np.int64)))

    def heights(self, nodes: FloatArray) -> FloatArray:
        """Return the surface's height at nodes (N, 2) [m]."""
        top = self._topmost()
        return np.asarray(top[cKDTree(top[:, :2]).query(nodes)[1], 2], dtype=np.float64)

    def _topmost(self) -> FloatArray:
        """Return the centres (M, 3) of the highest occupied voxel of every column [m]."""
        centres = (_unpacked(self._hit) + 0.5) * self.resolution_m
        labels = np.asarray(self._tree.getLabels(np.ascontiguousarray(centres)))
        occupied = centres[labels == _OCCUPIED]
        order = np.lexsort((-occupied[:, 2], occupied[:, 1], occupied[:, 0]))
        occupied = occupied[order]
        first = np.ones(len(occupied), dtype=bool)
        first[1:] = (np.diff(occupied[:, :2], axis=0) != 0).any(axis=1)
        top: FloatArray = occupied[first]
        return top


def _packed(keys: Any) -> Any:
    """Return one whole number for each voxel (N, 3)."""
    shifted = keys + (1 << (_KEY_BITS - 1))
    return (shifted[:, 0] << (2 * _KEY_BITS)) | (shifted[:, 1] << _KEY_BITS) | shifted[:, 2]


def _unpacked(packed: Any) -> Any:
    mask, half = (1 << _KEY_BITS) - 1, 1 << (_KEY_BITS - 1)
    columns = (packed >> (2 * _KEY_BITS)) & mask, (packed >> _KEY_BITS) & mask, packed & mask
    return np.column_stack(columns) - half


def _octomap() -> Any:
    """Import octomap-python with one thread: its insertion is parallel, and waits by spinning."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    try:
        import octomap
    except ImportError as error:
        raise InputError(
            "the baseline needs octomap-python, which is not installed; install firnline with its extra `peers`."
        ) from error
    return octomap

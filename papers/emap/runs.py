"""Runs of the EMap experiment: every method gets the same scans, and is scored after each.

OctoMap is the baseline of the paper; the topmost occupied voxels are its surface.
"""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from scipy.spatial import cKDTree

from papers.emap.world import (
    RANGE_M,
    EmapRun,
    printed_mse_cm2,
    seen_gap_outside,
    utilities,
    weighted_mse_cm2,
)
from survey.core.arrays import BoolArray, FloatArray, IntArray
from survey.core.errors import InputError
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.lattice.config import FieldLatticeConfig, SpringLatticeConfig
from survey.reconstruction.lattice.field_lattice import FieldLattice
from survey.reconstruction.lattice.spring_lattice import SpringLattice
from survey.reconstruction.nodes import NodeWindow

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


STEP_M = 0.25
SIDE_M = 2.0 * RANGE_M
SCENARIOS = ("Raw", "Nearest", "Gaussian", "CDF")
OCTOMAP, OCTOMAP_COARSE, EMAP, FIELD = "OctoMap 0.10 m", "OctoMap 0.25 m", "EMap (springs)", "Field lattice"
METHODS = (OCTOMAP, OCTOMAP_COARSE, EMAP, FIELD)


class Mapper(Protocol):
    """A method under test."""

    def take(self, points: SurfacePoints) -> None:
        """Add one scan."""

    def heights(self, nodes: FloatArray) -> FloatArray:
        """Return heights at places (N, 2) [m]."""


class _OctoMap:
    def __init__(self, resolution_m: float) -> None:
        self._surface = OctoMapSurface(resolution_m)

    def take(self, points: SurfacePoints) -> None:
        self._surface.insert(points)

    def heights(self, nodes: FloatArray) -> FloatArray:
        return self._surface.heights(nodes)


class _Lattice:
    def __init__(self, model: FieldLattice | SpringLattice) -> None:
        self._model = model

    def take(self, points: SurfacePoints) -> None:
        self._model.update(points)

    def heights(self, nodes: FloatArray) -> FloatArray:
        return self._model.predict(nodes)


def mapper(method: str) -> Mapper:
    """Return a new instance of a method of the study."""
    make: dict[str, Callable[[], Mapper]] = {
        OCTOMAP: lambda: _OctoMap(0.10),
        OCTOMAP_COARSE: lambda: _OctoMap(STEP_M),
        EMAP: lambda: _Lattice(SpringLattice(SpringLatticeConfig(step_m=STEP_M, side_m=SIDE_M))),
        FIELD: lambda: _Lattice(FieldLattice(FieldLatticeConfig(step_m=STEP_M, side_m=SIDE_M))),
    }
    return make[method]()


@dataclass
class RunScore:
    """Scores [cm²] of one method on one run, scan by scan.

    `weighted` and `printed` have one list per scenario; `parts` one per part of the lattice;
    `squared_m2` is the sum over scans of the squared error at every node of the moving lattice.
    """

    weighted: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in SCENARIOS})
    printed: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in SCENARIOS})
    parts: dict[str, list[float]] = field(
        default_factory=lambda: {name: [] for name in ("seen", "gap", "outside")}
    )
    squared_m2: FloatArray = field(default_factory=lambda: np.zeros(0))

    def mean(self, scenario: str) -> float:
        """Return the mean over the scans of a scenario's weighted error [cm²]."""
        return float(np.mean(self.weighted[scenario]))

    def add(self, error_m: FloatArray, offset: FloatArray, parts: dict[str, BoolArray]) -> None:
        """Score one scan."""
        for name, utility in utilities(offset).items():
            self.weighted[name].append(weighted_mse_cm2(error_m, utility))
            self.printed[name].append(printed_mse_cm2(error_m, utility))
        for name, nodes in parts.items():
            self.parts[name].append(1e4 * float(np.mean(error_m[nodes] ** 2)) if nodes.any() else np.nan)
        squared = error_m**2
        self.squared_m2 = squared if not self.squared_m2.size else self.squared_m2 + squared


def run(drive: EmapRun, methods: Sequence[str] = METHODS) -> dict[str, RunScore]:
    """Add one drive's scans to every method, and score each after every scan."""
    mappers = {method: mapper(method) for method in methods}
    scores = {method: RunScore() for method in methods}
    hit = _HitNodes()
    for place, points in drive.scans():
        hit.add(points.xy)
        nodes = NodeWindow.around(place, SIDE_M, STEP_M).xy
        height = drive.height(nodes)
        parts = seen_gap_outside(nodes, place, hit.at(nodes))
        for method, each in mappers.items():
            each.take(points)
            scores[method].add(each.heights(nodes) - height, nodes - place[:2], parts)
    return scores


class _HitNodes:
    """Return which nodes have had a hit within half a step."""

    def __init__(self) -> None:
        self._keys = np.zeros(0, dtype=np.int64)

    def add(self, xy: FloatArray) -> None:
        self._keys = np.union1d(self._keys, _keys(xy))

    def at(self, nodes: FloatArray) -> BoolArray:
        found: BoolArray = np.isin(_keys(nodes), self._keys)
        return found


def _keys(xy: FloatArray) -> IntArray:
    cells = np.round(xy / STEP_M).astype(np.int64)
    keys: IntArray = cells[:, 0] * (1 << 32) + cells[:, 1]
    return keys


def below(score: float, baseline: float) -> float:
    """Return by how many per cent a score lies below a baseline.

    Examples
    --------
    >>> below(45.8, 74.6)
    38.6
    """
    return 100.0 * (1.0 - score / baseline)

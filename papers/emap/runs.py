"""Runs of the EMap experiment: every method gets the same scans, and is scored after each."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from papers.emap.octomap import OctoMapSurface
from papers.emap.world import (
    RANGE_M,
    EmapRun,
    printed_mse_cm2,
    seen_gap_outside,
    utilities,
    weighted_mse_cm2,
)
from survey.core.arrays import BoolArray, FloatArray, IntArray
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.lattice.config import FieldLatticeConfig, SpringLatticeConfig
from survey.reconstruction.lattice.field_lattice import FieldLattice
from survey.reconstruction.lattice.spring_lattice import SpringLattice
from survey.reconstruction.nodes import NodeWindow

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

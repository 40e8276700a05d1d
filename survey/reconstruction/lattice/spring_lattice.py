"""Spring lattice of the EMap paper (Lock, Camara and Fox)."""

import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt
from pyproj import CRS

from survey.core import FloatArray, InputError, IntArray, same_crs, validated
from survey.data import Grid, SurfacePoints
from survey.io.arrays_file import read_arrays, write_arrays
from survey.reconstruction.lattice.config import SpringLatticeConfig
from survey.reconstruction.lattice.multigrid import Operator
from survey.reconstruction.lattice.solver import solve
from survey.reconstruction.nodes import LatticeFrame, LatticeModel, NodeWindow, require_room, sensor_place
from survey.reconstruction.terrain_model import Capabilities, local_datum_m

_FORMAT = "firnline spring lattice 1"
_NOTE = "springs state none; the band holds the root mean square distance of a node's points from the surface, or of all points where it has none"
_SPARE_NODES = 16
BYTES_PER_NODE = 120.0
"""Memory of a node: heights, sums and the solver's work [bytes]."""
# A range's noise throws a few points over the edge.
_SHARE_OUTSIDE = 0.01


@dataclass(eq=False)
class SpringLattice(LatticeModel):
    r"""Springs between neighbouring nodes, at rest on the surface so far, and springs from nodes to new points.

    The displacement d that a scan causes is where all forces balance,

    .. math::  (k_s L + k_d C) \, d = k_d \sum_{j \in s} (z_j - z_s)

    with the lattice Laplacian L, the number C of points per node, and every point tied to its
    nearest node. This is the sound reading of Eqs. 1–3 of the paper: printed, the stiffness
    matrix is diagonal and couples no nodes, so that a node without points never moves, and
    the displacement is the root of a quantity that may be negative.

    `config`: spring constants and the lattice, which follows the sensor.

    Points of earlier scans are in the surface, but do not hold it. There is
    no standard deviation, and no use of the points' own.

    >>> xyz = [[0.0, 0.0, 1.0], [4.0, 0.0, 1.0], [0.0, 4.0, 1.0], [4.0, 4.0, 1.0]]
    >>> model = SpringLattice(SpringLatticeConfig(side_m=None))
    >>> model.fit(SurfacePoints(xyz, sigma_m=0.05, crs="EPSG:32608")).predict([[2.0, 2.0]]).round(2)
    array([1.])
    """

    capabilities: ClassVar = Capabilities(std=False, samples=False, rays=True)
    method: ClassVar = "emap"

    config: SpringLatticeConfig = field(default_factory=SpringLatticeConfig)
    here: LatticeFrame | None = field(default=None, init=False, repr=False)
    z_: FloatArray = field(default_factory=lambda: np.zeros((0, 0)), init=False, repr=False)
    """Heights of the nodes above the datum [m], (H, W)."""
    seen_: IntArray = field(default_factory=lambda: np.zeros((0, 0), dtype=np.int64), init=False, repr=False)
    """How many points each node has had, (H, W)."""
    squared_: FloatArray = field(default_factory=lambda: np.zeros((0, 0)), init=False, repr=False)
    """Sum of the squared distances of the points from the surface after their scan [m²], (H, W)."""
    n_scans_: int = field(default=0, init=False)
    n_iterations_: int = field(default=0, init=False)

    def fit(self, points: SurfacePoints) -> Self:
        """Lay the lattice at the points' median height, and take them in."""
        window = self._window(points, None)
        self.here = LatticeFrame(window, local_datum_m(points.z), points.crs, points.vertical_datum)
        level = float(np.median(points.z)) - self.here.datum_m
        self.z_, self.seen_ = np.full(window.shape, level), np.zeros(window.shape, dtype=np.int64)
        self.squared_, self.n_scans_ = np.zeros(window.shape), 0
        return self._pulled(points)

    def update(self, points: SurfacePoints) -> Self:
        """Add a scan in place; the lattice moves with the sensor by whole steps."""
        if self.here is None:
            return self.fit(points)
        same_crs(self.here.crs, points.crs, "the map and the scan")
        old, new = self.here.window, self._window(points, self.here.window)
        if new != old:
            self.z_ = _edges_continued(new.carried(self.z_, old, np.nan))
            self.seen_ = new.carried(self.seen_, old, 0)
            self.squared_ = new.carried(self.squared_, old)
            self.here = self.here._replace(window=new)
        return self._pulled(points)

    def sample(self, grid: Grid, n: int, rng: np.random.Generator) -> FloatArray:  # noqa: ARG002
        """Refuse: springs state no distribution."""
        raise InputError(
            "a SpringLattice has one surface and no distribution to draw from; take a FieldLattice."
        )

    def save(self, path: str | Path) -> None:
        """Write the model to one ``.npz`` file."""
        window = self.where.window
        facts = {
            "config": self.config.model_dump(),
            "window": [window.step_m, window.west, window.south, window.rows, window.columns],
            "datum_m": self.where.datum_m,
            "crs": self.where.crs.to_wkt(),
            "vertical_datum": self.where.vertical_datum,
            "n_scans": self.n_scans_,
        }
        write_arrays(path, _FORMAT, facts, {"z": self.z_, "seen": self.seen_, "squared": self.squared_})

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote."""
        facts, arrays = read_arrays(path, _FORMAT)
        model = cls(validated(SpringLatticeConfig, facts["config"], "the spring lattice's settings"))
        crs = CRS.from_wkt(facts["crs"])
        model.here = LatticeFrame(
            NodeWindow(*facts["window"]), facts["datum_m"], crs, facts["vertical_datum"]
        )
        model.z_, model.seen_, model.squared_ = arrays["z"], arrays["seen"], arrays["squared"]
        model.n_scans_ = facts["n_scans"]
        return model

    def _pulled(self, points: SurfacePoints) -> Self:
        """Tie the points to their nearest nodes and find the new equilibrium."""
        window = self.where.window
        node, inside = nearest_nodes(window, points.xy)
        n_outside = len(points) - int(inside.sum())
        if n_outside > _SHARE_OUTSIDE * len(points):
            self._warn(points, n_outside)
        residual = points.z[inside] - self.where.datum_m - self.z_.ravel()[node]
        n_nodes = window.rows * window.columns
        count = np.bincount(node, minlength=n_nodes).reshape(window.shape)
        pull = self.config.k_data * np.bincount(node, residual, n_nodes).reshape(window.shape)
        if node.size:
            springs = Operator(
                self.config.k_data * count[None].astype(float), (0.0, self.config.k_surface, 0.0)
            )
            displacement, self.n_iterations_ = solve(
                springs,
                np.asarray(pull, dtype=np.float64),
                np.zeros(window.shape),
                tolerance=self.config.tolerance,
            )
            self.z_ = self.z_ + displacement
            left = residual - displacement.ravel()[node]
            self.squared_ = self.squared_ + np.bincount(node, left**2, n_nodes).reshape(window.shape)
        self.seen_ = self.seen_ + count
        self.n_scans_ += 1
        return self

    def _warn(self, points: SurfacePoints, n_outside: int) -> None:
        side_m = self.where.window.step_m * (self.where.window.rows - 1)
        warnings.warn(
            f"{n_outside} of {len(points)} points lie beyond the lattice, which measures {side_m:g} m and does not "
            "cover the sensor's range; give it twice the range as its side.",
            stacklevel=4,
        )

    def _window(self, points: SurfacePoints, old: NodeWindow | None) -> NodeWindow:
        step_m = self.config.node_step_m
        if self.config.side_m is not None:
            window = NodeWindow.around(sensor_place(points.origins), self.config.side_m, step_m)
        else:
            (xmin, ymin), (xmax, ymax) = points.xy.min(axis=0), points.xy.max(axis=0)
            if old is not None and old.covers((xmin, ymin, xmax, ymax)):
                return old
            spare = _SPARE_NODES * step_m if old else 0.0
            window = NodeWindow.over((xmin - spare, ymin - spare, xmax + spare, ymax + spare), step_m)
            window = window if old is None else old.joined(window)
        require_room(window, BYTES_PER_NODE, self.config.memory_mb, 0 if old is None else 2 * _SPARE_NODES)
        return window

    def _nodes(self) -> FloatArray:
        return self.z_

    def _node_std(self) -> FloatArray:
        spread = np.sqrt(self.squared_ / np.maximum(self.seen_, 1))
        overall = np.sqrt(self.squared_.sum() / max(self.seen_.sum(), 1))
        return np.where(self.seen_ > 0, spread, overall)

    def _weights(self) -> FloatArray:
        return self.seen_.astype(np.float64)

    def _reach_m(self) -> float:
        return np.inf

    def _record(self) -> tuple[dict[str, Any], dict[str, Any]]:
        assumed = {"k_surface": self.config.k_surface, "k_data": self.config.k_data}
        return assumed, {
            "step_m": self.config.node_step_m,
            "n_scans": self.n_scans_,
            "standard_deviation": _NOTE,
        }


def nearest_nodes(window: NodeWindow, xy: FloatArray) -> tuple[IntArray, npt.NDArray[np.bool_]]:
    """Return the number of each point's nearest node, and which points (N,) lie within half a step of the lattice.

    On a regular lattice the nearest node follows by rounding; a k-d tree over the nodes gives the same.
    """
    u, v = np.round(window.coordinates(xy)).astype(np.int64).T
    inside = (u >= 0) & (v >= 0) & (u < window.columns) & (v < window.rows)
    return (v * window.columns + u)[inside], inside


def _edges_continued(z: FloatArray) -> FloatArray:
    """Give nodes without height (NaN) that of the nearest row or column that has one."""
    rows, columns = np.flatnonzero(~np.isnan(z).all(axis=1)), np.flatnonzero(~np.isnan(z).all(axis=0))
    if not len(rows):
        return np.zeros_like(z)
    j = np.clip(np.arange(z.shape[0]), rows[0], rows[-1])
    i = np.clip(np.arange(z.shape[1]), columns[0], columns[-1])
    continued: FloatArray = z[np.ix_(j, i)]
    return continued

"""Lattices of nodes anchored in the world, and models of heights on them."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from pyproj import CRS

from survey.core import BoolArray, CapacityError, FloatArray, InputError
from survey.data import Dem, Grid
from survey.reconstruction.capacity import rounded_up, smallest_step_m
from survey.reconstruction.terrain_map import INTERPOLATED, MEASURED, UNSEEN, Reconstruction
from survey.reconstruction.terrain_model import TerrainModel, not_fitted

# Beyond this number neighbouring steps are the same number in double precision.
_MOST_STEPS = 2.0**52


@dataclass(frozen=True)
class NodeWindow:
    """A rectangle of nodes at whole multiples of the step, so that windows always fall upon one another.

    `step_m`: distance between neighbouring nodes [m]. `west`, `south`: easting and northing of the first
    node, in steps. `rows`, `columns`: nodes northwards and eastwards, at least 3 each.

    >>> NodeWindow.over((0.3, 0.0, 2.0, 1.0), 0.5).xy[0]
    array([0., 0.])
    """

    step_m: float
    west: int
    south: int
    rows: int
    columns: int

    @classmethod
    def over(cls, bounds: tuple[float, float, float, float], step_m: float) -> Self:
        """Return the smallest window that covers ``(xmin, ymin, xmax, ymax)`` [m]."""
        xmin, ymin, xmax, ymax = in_steps(bounds, step_m)
        west, south = int(np.floor(xmin + 1e-9)), int(np.floor(ymin + 1e-9))
        columns = max(int(np.ceil(xmax - 1e-9)) - west + 1, 3)
        return cls(step_m, west, south, max(int(np.ceil(ymax - 1e-9)) - south + 1, 3), columns)

    @classmethod
    def around(cls, centre: FloatArray, side_m: float, step_m: float) -> Self:
        """Return the window of a given side whose middle node is nearest to a place."""
        side, *middle = in_steps((side_m, *centre[:2].tolist()), step_m)
        n = max(round(side), 3)
        west, south = (int(np.round(c)) - n // 2 for c in middle)
        return cls(step_m, west, south, n, n)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows, self.columns

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """``(xmin, ymin, xmax, ymax)`` of the outermost nodes [m]."""
        east, north = self.west + self.columns - 1, self.south + self.rows - 1
        return self.west * self.step_m, self.south * self.step_m, east * self.step_m, north * self.step_m

    @property
    def xy(self) -> FloatArray:
        """Places of the nodes [m], (rows * columns, 2), row by row from the south-west."""
        x = self.step_m * (self.west + np.arange(self.columns))
        y = self.step_m * (self.south + np.arange(self.rows))
        east, north = np.meshgrid(x, y)
        return np.column_stack([east.ravel(), north.ravel()])

    def coordinates(self, xy: FloatArray) -> FloatArray:
        """Return places (N, 2) [m] in steps from the first node."""
        return xy / self.step_m - np.array([self.west, self.south], dtype=np.float64)

    def covers(self, bounds: tuple[float, float, float, float]) -> bool:
        """Return whether the rectangle [m] lies within the nodes, to a thousandth of a step."""
        slack = 1e-3 * self.step_m
        mine = self.bounds
        return all(mine[k] <= bounds[k] + slack for k in (0, 1)) and all(
            mine[k] >= bounds[k] - slack for k in (2, 3)
        )

    def joined(self, other: "NodeWindow") -> "NodeWindow":
        """Return the smallest window that holds both."""
        west, south = min(self.west, other.west), min(self.south, other.south)
        east = max(self.west + self.columns, other.west + other.columns)
        north = max(self.south + self.rows, other.south + other.rows)
        return NodeWindow(self.step_m, west, south, north - south, east - west)

    def within(self, other: "NodeWindow") -> tuple[slice, slice]:
        """Return the rows and columns of `other` that lie in this window."""
        south, west = self.south - other.south, self.west - other.west
        rows = slice(max(south, 0), min(max(south + self.rows, 0), other.rows))
        return rows, slice(max(west, 0), min(max(west + self.columns, 0), other.columns))

    def carried(self, values: Any, old: "NodeWindow", fill: float = 0.0) -> Any:
        """Return an array (…, H, W) of the old window on this one; `fill` where the old one has no node."""
        moved = np.full((*values.shape[:-2], *self.shape), fill, dtype=values.dtype)
        moved[(..., *old.within(self))] = values[(..., *self.within(old))]
        return moved


def in_steps(lengths_m: Sequence[float], step_m: float) -> list[float]:
    """Return coordinates and lengths [m] in steps, or refuse a step that is too small to count them.

    >>> in_steps((10.0, 5.0), 2.5)
    [4.0, 2.0]
    """
    largest_m = max(abs(float(length)) for length in lengths_m)
    if not step_m * _MOST_STEPS > largest_m:
        raise CapacityError(
            f"the lattice's step of {step_m:g} m is too small to count coordinates of {largest_m:g} m; take a step of "
            f"{rounded_up(largest_m / _MOST_STEPS * 1.01):g} m or more."
        )
    return [float(length) / step_m for length in lengths_m]


class LatticeFrame(NamedTuple):
    """Where a lattice is and in which system: its nodes, the level of its heights, CRS and vertical datum."""

    window: NodeWindow
    datum_m: float
    crs: CRS
    vertical_datum: str


class LatticeModel(TerrainModel):
    """Heights on nodes, bilinear between them, and NaN beyond them."""

    method: ClassVar[str]
    here: LatticeFrame | None = None

    @abstractmethod
    def _nodes(self) -> FloatArray:
        """Return the heights of the nodes above the datum (H, W) [m]."""

    @abstractmethod
    def _node_std(self) -> FloatArray:
        """Return the standard deviations of the nodes (H, W) [m], or the points' spread for a model that has none."""

    @abstractmethod
    def _weights(self) -> FloatArray:
        """Return how much data hang on each node (H, W); 0 for none."""

    @abstractmethod
    def _reach_m(self) -> float:
        """Return the distance from the data beyond which the map says nothing of the ground."""

    @abstractmethod
    def _record(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return what was assumed or learned, and what was found out, for the record."""

    def grid(self, grid: Grid) -> Reconstruction:
        """Return the map on the nodes of a grid; NaN beyond the lattice.

        A model without standard deviation gives the spread of the points about the surface in
        its place, and says so.
        """
        here = self.where
        places = grid.xy
        hyperparameters, diagnostics = self._record()

        def dem(values: FloatArray) -> Dem:
            return Dem.on(grid, values.reshape(grid.shape), here.vertical_datum)

        has_std = self.capabilities.std
        return Reconstruction(
            dem(self._height(places)),
            dem(self._std(places)),
            self._support(places).reshape(grid.shape),
            self.method,
            hyperparameters,
            dem(self._bound(places, "lower")) if has_std else None,
            dem(self._bound(places, "upper")) if has_std else None,
            diagnostics=diagnostics,
        )

    def full_grid(self, step_m: float | None = None) -> Grid:
        """Return a grid over the lattice, of its own nodes unless a step [m] is given."""
        here = self.where
        if step_m is None or step_m == here.window.step_m:
            return Grid(here.window.bounds, here.window.step_m, here.crs)
        window = NodeWindow.over(here.window.bounds, step_m)
        return Grid(window.bounds, step_m, here.crs)

    @property
    def where(self) -> LatticeFrame:
        """The nodes' place, the level of their heights, and their system."""
        if self.here is None:
            raise not_fitted()
        return self.here

    def _height(self, xy: FloatArray) -> FloatArray:
        here = self.where
        return bilinear(self._nodes(), here.window.coordinates(xy)) + here.datum_m

    def _std(self, xy: FloatArray) -> FloatArray:
        return bilinear(self._node_std(), self.where.window.coordinates(xy))

    def _support(self, xy: FloatArray) -> npt.NDArray[np.uint8]:
        window = self.where.window
        u, v = np.round(window.coordinates(xy)).astype(np.int64).T
        inside = (u >= 0) & (v >= 0) & (u < window.columns) & (v < window.rows)
        codes = self._node_support()[np.where(inside, v, 0), np.where(inside, u, 0)]
        return np.where(inside, codes, UNSEEN).astype(np.uint8)

    def _node_support(self) -> npt.NDArray[np.uint8]:
        """Return the support code of every node."""
        away_m = self._away_m()
        near = np.where(away_m <= self._reach_m(), INTERPOLATED, UNSEEN)
        return np.where(away_m == 0.0, MEASURED, near).astype(np.uint8)

    def _away_m(self) -> FloatArray:
        """Return the distance of every node (H, W) from the nearest one that a point hangs on [m]."""
        return self.where.window.step_m * away_from(self._weights() > 0.0)


def away_from(measured: BoolArray) -> FloatArray:
    """Return the distance of every node (H, W) from the nearest measured one, in steps."""
    if not measured.any():
        return np.full(measured.shape, np.inf)
    # Here, because every command that knows the methods would load it.
    from scipy.ndimage import distance_transform_edt

    away: FloatArray = distance_transform_edt(~measured)
    return away


def bilinear(values: FloatArray, uv: FloatArray) -> FloatArray:
    """Interpolate node values (H, W) at lattice coordinates (N, 2); NaN beyond the nodes."""
    rows, columns = values.shape
    # A thousandth of a step of slack: a place on the edge is on the lattice whatever the rounding.
    u, v = np.clip(uv, 0.0, (columns - 1, rows - 1)).T
    inside = (np.abs(uv - np.column_stack([u, v])) <= 1e-3).all(axis=1)
    i, j = np.minimum(u.astype(np.int64), columns - 2), np.minimum(v.astype(np.int64), rows - 2)
    s, t = u - i, v - j
    south = values[j, i] * (1 - s) + values[j, i + 1] * s
    north = values[j + 1, i] * (1 - s) + values[j + 1, i + 1] * s
    return np.where(inside, south * (1 - t) + north * t, np.nan)


def require_room(window: NodeWindow, bytes_per_node: float, memory_mb: float, spare_nodes: int = 0) -> None:
    """Refuse a lattice that would not fit the memory allowed, and name the smallest step that does.

    So many nodes of every row and column are spare: their number stays when the step changes.
    """
    needed = window.rows * window.columns * bytes_per_node / 1e6
    if needed > memory_mb:
        remedy = _step_that_fits(window, memory_mb * 1e6 / bytes_per_node, spare_nodes)
        raise CapacityError(
            f"the map spans {window.rows:.6g} × {window.columns:.6g} nodes of {window.step_m:g} m, which take "
            f"{needed:.6g} MB of the {memory_mb:g} MB allowed; {remedy}, cut the points, or let the map follow the sensor."
        )


def _step_that_fits(window: NodeWindow, most_nodes: float, spare_nodes: int) -> str:
    """Return the remedy: the step with which a window has no more nodes than allowed, or more memory."""
    # A window ends on nodes, up to a step beyond its rectangle on either side.
    beyond = spare_nodes + 3
    width_m, height_m = (window.step_m * max(n - 1 - spare_nodes, 1) for n in (window.columns, window.rows))
    if most_nodes <= beyond**2:
        return "allow more memory"
    return f"take a step of {smallest_step_m(width_m, height_m, most_nodes, beyond):g} m or more"


def sensor_place(origins: FloatArray | None) -> FloatArray:
    """Return the middle (2,) [m] between a scan's first and last origin, or refuse a scan without origins."""
    if origins is None:
        raise InputError(
            "the scan does not say where its sensor stood, and the map is to follow it; give origins or a map of fixed bounds."
        )
    middle: FloatArray = 0.5 * (origins[0, :2] + origins[-1, :2])
    return middle

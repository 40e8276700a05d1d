"""Walls of a raster of free cells, and whether one place sees another."""

from typing import NamedTuple

import numpy as np
from numba import njit

from survey.core.arrays import FloatArray, IntArray

PointXY = tuple[float, float]


class RasterCells(NamedTuple):
    """A raster of square cells, numbered column by column."""

    x0: float
    y0: float
    cell_m: float
    n_columns: int
    n_rows: int


class Walls(NamedTuple):
    """The ground's edges, listed by the cells that they pass through."""

    edges: FloatArray  # (M, 4) x0, y0, x1, y1
    start: IntArray  # (n_columns * n_rows + 1,) where a cell's edges begin
    listed: IntArray
    cells: RasterCells


@njit(cache=True)
def _columns_along(p: PointXY, q: PointXY, cells: RasterCells) -> tuple[int, int]:
    """Return the first and the last column of cells that a segment touches."""
    first = int(np.floor((min(p[0], q[0]) - cells.x0) / cells.cell_m - 1e-6))
    last = int(np.floor((max(p[0], q[0]) - cells.x0) / cells.cell_m + 1e-6))
    return max(first, 0), min(last, cells.n_columns - 1)


@njit(cache=True)
def _rows_along(p: PointXY, q: PointXY, cells: RasterCells, column: int) -> tuple[int, int]:
    """Return the first and the last row that a segment touches within a column."""
    lo, hi = 0.0, 1.0
    if p[0] != q[0]:
        left = cells.x0 + column * cells.cell_m
        lo, hi = (left - p[0]) / (q[0] - p[0]), (left + cells.cell_m - p[0]) / (q[0] - p[0])
        lo, hi = max(min(lo, hi), 0.0), min(max(lo, hi), 1.0)
    ya, yb = p[1] + lo * (q[1] - p[1]), p[1] + hi * (q[1] - p[1])
    first = int(np.floor((min(ya, yb) - cells.y0) / cells.cell_m - 1e-6))
    last = int(np.floor((max(ya, yb) - cells.y0) / cells.cell_m + 1e-6))
    return max(first, 0), min(last, cells.n_rows - 1)


@njit(cache=True)
def _listed(edges: FloatArray, cells: RasterCells) -> tuple[IntArray, IntArray]:
    """List the edges cell by cell: count first, then fill."""
    start = np.zeros(cells.n_columns * cells.n_rows + 1, dtype=np.int64)
    listed = np.zeros(0, dtype=np.int64)
    place = start
    for filling in (False, True):
        if filling:
            start = np.cumsum(start)
            listed = np.empty(start[-1], dtype=np.int64)
            place = start.copy()
        for e in range(len(edges)):
            p, q = (edges[e, 0], edges[e, 1]), (edges[e, 2], edges[e, 3])
            first, last = _columns_along(p, q, cells)
            for column in range(first, last + 1):
                bottom, top = _rows_along(p, q, cells, column)
                for cell in range(column * cells.n_rows + bottom, column * cells.n_rows + top + 1):
                    if filling:
                        listed[place[cell]] = e
                        place[cell] += 1
                    else:
                        start[cell + 1] += 1
    return start, listed


def walls(edges: FloatArray) -> Walls:
    """Index the ground's edges (M, 4) by square cells, about one edge each."""
    low = np.minimum(edges[:, :2].min(axis=0), edges[:, 2:].min(axis=0))
    high = np.maximum(edges[:, :2].max(axis=0), edges[:, 2:].max(axis=0))
    extent = np.maximum(high - low, 1e-3)
    cell_m = float(max(np.sqrt(extent.prod() / len(edges)), extent.max() / 1024))
    n_columns, n_rows = (int(n) for n in np.floor(extent / cell_m) + 1)
    cells = RasterCells(float(low[0]), float(low[1]), cell_m, n_columns, n_rows)
    return Walls(edges, *_listed(edges, cells), cells)


@njit(cache=True)
def sees(p: PointXY, q: PointXY, walls: Walls) -> bool:
    """Return whether no edge lies between two points that are strictly inside the ground.

    A corner on the line counts as left of it, so a line through a corner crosses exactly
    one of the two edges that meet there when they lie on opposite sides.
    """
    dx, dy = q[0] - p[0], q[1] - p[1]
    first, last = _columns_along(p, q, walls.cells)
    for step in range(last - first + 1):
        column = first + step if dx >= 0.0 else last - step
        bottom, top = _rows_along(p, q, walls.cells, column)
        cell = column * walls.cells.n_rows
        for k in range(walls.start[cell + bottom], walls.start[cell + top + 1]):
            ax, ay, bx, by = walls.edges[walls.listed[k]]
            a_is_left = dx * (ay - p[1]) - dy * (ax - p[0]) >= 0.0
            b_is_left = dx * (by - p[1]) - dy * (bx - p[0]) >= 0.0
            if a_is_left == b_is_left:
                continue
            ex, ey = bx - ax, by - ay
            p_is_left = ex * (p[1] - ay) - ey * (p[0] - ax) >= 0.0
            q_is_left = ex * (q[1] - ay) - ey * (q[0] - ax) >= 0.0
            if p_is_left != q_is_left:
                return False
    return True

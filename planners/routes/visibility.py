"""Visibility graph over the reflex corners of free ground, and the search for a shortest path on it by A*: compiled loops.

A shortest path inside a polygon with holes is straight except at reflex corners (Lozano-Pérez and Wesley 1979), so the
network's nodes are those corners and its links the pairs that see one another and are tangent to the ground at both
ends. `Walls` lists the edges of the ground by square cells, so that a line of sight is tested against few of them.
The functions work in metres about a local origin and expect their points strictly inside the ground.
"""

import heapq
from typing import NamedTuple

import numpy as np
from numba import njit

from survey.core import FloatArray, IntArray

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


class Bends(NamedTuple):
    """The reflex corners, and the way from each to its neighbours on the ring, each (N, 2).

    ``slack`` (N, 2): products of lengths with a tenth of a millimetre, below which a point is on the line of an edge [m²].
    """

    xy: FloatArray
    to_before: FloatArray
    to_after: FloatArray
    slack: FloatArray


class Links(NamedTuple):
    """Which corners see each other: row ``i`` is ``seen[start[i]:start[i + 1]]``."""

    start: IntArray
    seen: IntArray
    length: FloatArray


class VisibleCorners(NamedTuple):
    """Which corners each of some points (P, 2) sees, in rows as in `Links`."""

    xy: FloatArray
    start: IntArray
    seen: IntArray


class Network(NamedTuple):
    """Everything that a search needs."""

    sights: VisibleCorners
    bends: Bends
    links: Links
    walls: Walls


@njit(cache=True)
def _grazes(dx: float, dy: float, before: PointXY, after: PointXY, slack: PointXY) -> bool:
    """Return whether a line to a corner along (dx, dy) has both edges of the corner on one side of it, or on it.

    Points within a tenth of a millimetre of an edge's line count as on it: those that were
    moved onto an edge lie off it by the rounding of large coordinates.
    """
    a, b = dx * before[1] - dy * before[0], dx * after[1] - dy * after[0]
    return not ((a > slack[0] and b < -slack[1]) or (a < -slack[0] and b > slack[1]))


@njit(cache=True)
def _is_tangent(p: PointXY, corner: int, bends: Bends) -> bool:
    """Return whether a line from `p` grazes a corner instead of running into it."""
    before, after, slack = bends.to_before[corner], bends.to_after[corner], bends.slack[corner]
    dx, dy = bends.xy[corner, 0] - p[0], bends.xy[corner, 1] - p[1]
    return _grazes(dx, dy, (before[0], before[1]), (after[0], after[1]), (slack[0], slack[1]))


@njit(cache=True)
def _pairs(bends: Bends, walls: Walls) -> list[tuple[int, int]]:
    """Return the pairs of corners that see one another and are tangent at both ends."""
    pairs = [(0, 0) for _ in range(0)]
    x, y = bends.xy[:, 0].copy(), bends.xy[:, 1].copy()
    sides = np.hstack((bends.to_before, bends.to_after, bends.slack))
    for i in range(len(x)):
        before, after, slack = (
            (sides[i, 0], sides[i, 1]),
            (sides[i, 2], sides[i, 3]),
            (sides[i, 4], sides[i, 5]),
        )
        for j in range(i + 1, len(x)):
            dx, dy = x[i] - x[j], y[i] - y[j]
            if not _grazes(dx, dy, before, after, slack):
                continue
            other = sides[j]
            if _grazes(-dx, -dy, (other[0], other[1]), (other[2], other[3]), (other[4], other[5])) and sees(
                (x[i], y[i]), (x[j], y[j]), walls
            ):
                pairs.append((i, j))
    return pairs


@njit(cache=True)
def links(bends: Bends, walls: Walls) -> Links:
    """Join the reflex corners that a taut string could run between."""
    pairs = _pairs(bends, walls)
    start = np.zeros(len(bends.xy) + 1, dtype=np.int64)
    for i, j in pairs:
        start[i + 1] += 1
        start[j + 1] += 1
    start = np.cumsum(start)
    place = start.copy()
    seen, length = np.empty(start[-1], dtype=np.int64), np.empty(start[-1])
    for i, j in pairs:
        seen[place[i]], seen[place[j]] = j, i
        distance = np.hypot(bends.xy[i, 0] - bends.xy[j, 0], bends.xy[i, 1] - bends.xy[j, 1])
        length[place[i]] = distance
        length[place[j]] = distance
        place[i] += 1
        place[j] += 1
    return Links(start, seen, length)


@njit(cache=True)
def sights(points: FloatArray, bends: Bends, walls: Walls) -> VisibleCorners:
    """List the corners that each point (P, 2) sees and that a taut string could bend at."""
    start = np.zeros(len(points) + 1, dtype=np.int64)
    found = [0 for _ in range(0)]
    for i in range(len(points)):
        p = (points[i, 0], points[i, 1])
        for c in range(len(bends.xy)):
            if _is_tangent(p, c, bends) and sees(p, (bends.xy[c, 0], bends.xy[c, 1]), walls):
                found.append(c)
        start[i + 1] = len(found)
    seen = np.empty(len(found), dtype=np.int64)
    for k in range(len(found)):
        seen[k] = found[k]
    return VisibleCorners(points, start, seen)


@njit(cache=True)
def search(a: int, b: int, network: Network, parent: IntArray) -> float:
    """Return the length [m] of the shortest way from point `a` to `b`; infinite when there is none.

    A* with the straight distance as bound. ``parent[n]`` onwards leads back from the goal
    to the start, corner by corner; -1 is the start itself.
    """
    sights, bends, links, walls = network
    n = len(bends.xy)
    ax, ay = sights.xy[a]
    bx, by = sights.xy[b]
    parent[n] = -1
    if sees((ax, ay), (bx, by), walls):
        return float(np.hypot(bx - ax, by - ay))
    cost, to_goal = np.full(n + 1, np.inf), np.full(n, np.inf)
    bound = np.hypot(bends.xy[:, 0] - bx, bends.xy[:, 1] - by)
    for c in sights.seen[sights.start[b] : sights.start[b + 1]]:
        to_goal[c] = bound[c]
    heap = [(0.0, 0) for _ in range(0)]
    for c in sights.seen[sights.start[a] : sights.start[a + 1]]:
        cost[c] = np.hypot(bends.xy[c, 0] - ax, bends.xy[c, 1] - ay)
        parent[c] = -1
        heap.append((cost[c] + bound[c], int(c)))
    heapq.heapify(heap)
    while len(heap) > 0:
        estimate, c = heapq.heappop(heap)
        if c == n:
            return float(cost[n])
        if estimate > cost[c] + bound[c] + 1e-9:
            continue
        if cost[c] + to_goal[c] < cost[n]:
            cost[n] = cost[c] + to_goal[c]
            parent[n] = c
            heapq.heappush(heap, (cost[n], n))
        for k in range(links.start[c], links.start[c + 1]):
            d = int(links.seen[k])
            if cost[c] + links.length[k] < cost[d]:
                cost[d] = cost[c] + links.length[k]
                parent[d] = c
                heapq.heappush(heap, (cost[d] + bound[d], d))
    return np.inf


def way(a: int, b: int, network: Network) -> tuple[float, FloatArray]:
    """Return the length of the shortest way and its waypoints (K, 2), both ends included."""
    parent = np.full(len(network.bends.xy) + 1, -1, dtype=np.int64)
    length = search(a, b, network, parent)
    bends = []
    corner = parent[-1]
    while corner != -1:
        bends.append(network.bends.xy[corner])
        corner = parent[corner]
    ends = network.sights.xy
    return float(length), np.vstack([ends[a], *reversed(bends), ends[b]])

r"""Detours of a path around blocked ground, on a grid of nodes.

Where a path crosses blocked ground it leaves before and joins again behind. The way between is the cheapest over the
grid, straightened where nothing is in the way. It joins where

.. math::  d(s) + \lambda \, m(s)

is least, with the cost d of the way that joins at the distance s along the path, the length m of the swaths that are skipped up to there, and
λ metres of way for each of its metres: ground that can only be reached by a long way is left out.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from survey.core import BoolArray, FloatArray, IntArray
from survey.reconstruction.nodes import NodeWindow

_WORTH = 6.0
"""Metres of way that a metre of skipped swath is worth."""
BEFORE_M = 1.5
"""Distance before blocked ground at which a swath is left [m]."""
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))


class Detour(NamedTuple):
    """Way around blocked ground.

    `xy` (K, 2): waypoints from where the path is left to where it is joined [m]. `leaves`, `joins`: numbers of
    these samples of the path.
    """

    xy: FloatArray
    leaves: int
    joins: int


class CostGrid(NamedTuple):
    """Cost of a metre of way (H, W) at the nodes of a window, infinite where they are blocked."""

    window: NodeWindow
    cost: FloatArray

    def at(self, xy: FloatArray) -> FloatArray:
        """Return the costs of the nodes nearest to places (N, 2) [m]; NaN beyond the window."""
        column, row = np.rint(self.window.coordinates(xy)).astype(np.int64).T
        inside = (column >= 0) & (row >= 0) & (column < self.window.columns) & (row < self.window.rows)
        found = np.full(len(xy), np.nan)
        found[inside] = self.cost[row[inside], column[inside]]
        return found

    def blocked_samples(self, path: FloatArray) -> IntArray:
        """Return the numbers of the samples of a path (N, 2) that lie on blocked nodes."""
        blocked: IntArray = np.flatnonzero(np.isposinf(self.at(path)))
        return blocked

    def detour(self, path: FloatArray, on_swath: BoolArray, step_m: float) -> Detour | None:
        """Return the way around the first blocked part of a path.

        `path` (N, 2): samples of the path from the rover on, `step_m` apart [m]; the first one must not be blocked. `on_swath` (N,): which
        of them are worth driving. Nothing where no way joins the path again within the window.
        """
        blocked = self.blocked_samples(path)
        leaves = max(int(blocked[0]) - round(BEFORE_M / step_m) - 1, 0)
        if not on_swath[leaves]:
            leaves = 0  # a former detour is not kept: the new one begins where the rover is
        free = np.flatnonzero(np.isfinite(self.at(path)))
        targets = free[free > blocked[0]]
        if len(targets) == 0:
            return None
        cost, before = self._ways(path[leaves])
        nodes = self._nodes(path[targets])
        skipped_m = step_m * np.cumsum(on_swath)
        objective = cost[nodes] + _WORTH * (skipped_m[targets] - skipped_m[leaves])
        best = int(objective.argmin())
        if not np.isfinite(objective[best]):
            return None
        chain, node = [int(nodes[best])], int(before[nodes[best]])
        while node >= 0:
            chain.append(node)
            node = int(before[node])
        inner = self.window.xy[chain[::-1]]
        joins = int(targets[best])
        return Detour(self._straightened(np.vstack([path[leaves], inner[1:-1], path[joins]])), leaves, joins)

    def _nodes(self, xy: FloatArray) -> IntArray:
        column, row = np.rint(self.window.coordinates(xy)).astype(np.int64).T
        number: IntArray = row * self.window.columns + column
        return number

    def _ways(self, start: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return the cost of the cheapest way to every node and the node before it; -1 or less before the first."""
        rows, columns = self.window.shape
        number = np.arange(rows * columns).reshape(rows, columns)
        begin, end, weight = [], [], []
        for south, east in _STEPS:
            west = max(-east, 0)
            a = (slice(0, rows - south), slice(west, columns - max(east, 0)))
            b = (slice(south, rows), slice(west + east, columns - max(east, 0) + east))
            mean = 0.5 * (self.cost[a] + self.cost[b])
            is_open = np.isfinite(mean)
            begin.append(number[a][is_open])
            end.append(number[b][is_open])
            weight.append(self.window.step_m * np.hypot(south, east) * mean[is_open])
        edges = (np.concatenate(weight), (np.concatenate(begin), np.concatenate(end)))
        graph = coo_array(edges, shape=(number.size, number.size)).tocsr()
        length, before = dijkstra(
            graph, directed=False, indices=self._nodes(start[None]), return_predecessors=True
        )
        return length[0], before[0]

    def _straightened(self, xy: FloatArray) -> FloatArray:
        """Leave out waypoints between which the straight way costs no more per metre than the bent one."""
        costs = self.at(xy)
        chosen, k = [0], 0
        while k < len(xy) - 1:
            following = k + 1
            for m in range(len(xy) - 1, k + 1, -1):
                if self.largest_between(xy[k], xy[m]) <= max(np.nanmax(costs[k : m + 1]), 1.0):
                    following = m
                    break
            chosen.append(following)
            k = following
        return xy[chosen]

    def largest_between(self, a: FloatArray, b: FloatArray) -> float:
        """Return the largest cost on the straight way between two places (2,) [m]."""
        n = int(np.ceil(np.hypot(*(b - a)) / (0.2 * self.window.step_m))) + 1
        along = np.linspace(a, b, max(n, 2))
        return float(np.nan_to_num(self.at(along), nan=np.inf).max())


def densified(xy: FloatArray, step_m: float) -> FloatArray:
    """Return a path (N, 2) with samples at most a step apart [m], its waypoints among them.

    >>> densified(np.array([[0.0, 0.0], [1.0, 0.0]]), 0.5).tolist()
    [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]]
    """
    parts = [xy[:1]]
    for a, b in pairwise(xy):
        n = max(int(np.ceil(np.hypot(*(b - a)) / step_m - 1e-9)), 1)
        parts.append(a + (b - a) * (np.arange(1, n + 1) / n)[:, None])
    return np.vstack(parts)

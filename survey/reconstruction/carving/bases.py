"""What a surface has learned: kernels with weights, each knowing what made it, found by their cells."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from survey.core.arrays import FloatArray, IntArray
from survey.reconstruction.carving.wu_kernel import wu

BY_POINT, BY_RAY = 0, 1
"""What made a basis: a point beside the surface, or a line of sight under it."""

_BLOCK = 16
FAST = {"reassoc", "contract", "nsz", "arcp"}

Kinds = npt.NDArray[np.uint8]


class LevelCells(NamedTuple):
    """Square cells as wide as each level's length scale, one level after the other, with a rim of empty ones.

    ``length_m`` (E,) of the levels; ``n_east`` and ``n_north`` (E,) cells; ``first`` (E + 1,)
    number of each level's first cell; all from (0, 0).
    """

    length_m: FloatArray
    n_east: IntArray
    n_north: IntArray
    first: IntArray

    @classmethod
    def over(cls, lengths_m: FloatArray, width_m: float, height_m: float) -> "LevelCells":
        """Return the cells of all levels over a rectangle from (0, 0)."""
        east, north = (np.floor(side / lengths_m).astype(np.int64) + 3 for side in (width_m, height_m))
        first = np.concatenate([[0], np.cumsum(east * north)])
        return cls(lengths_m, east, north, first)

    @property
    def n_cells(self) -> int:
        """Cells of all levels."""
        return int(self.first[-1])


class Columns(NamedTuple):
    """Kernels one after the other: places (n,) [m], weights (n,) [m], what made them (n,), and their levels (n,)."""

    x: FloatArray
    y: FloatArray
    weight: FloatArray
    made_by: Kinds
    level: IntArray


class Bases(NamedTuple):
    """Kernels sorted by cell: places (n,) [m], weights (n,) [m], what made them (n,), and where each cell's begin."""

    cells: LevelCells
    x: FloatArray
    y: FloatArray
    weight: FloatArray
    made_by: Kinds
    start: IntArray

    @classmethod
    def none(cls, cells: LevelCells) -> "Bases":
        """Return no bases."""
        empty = np.zeros(0)
        start = np.zeros(cells.n_cells + 1, np.int64)
        return cls(cells, empty, empty, empty, np.zeros(0, np.uint8), start)

    @property
    def n(self) -> int:
        """How many there are."""
        return len(self.x)

    def level(self) -> IntArray:
        """Return the level (n,) of every basis."""
        counts = np.diff(self.start[self.cells.first])
        return np.repeat(np.arange(len(counts)), counts)

    def columns(self) -> Columns:
        """Return them one after the other."""
        return Columns(self.x, self.y, self.weight, self.made_by, self.level())

    def merged(self, others: Columns) -> "Bases":
        """Return these and others, in their cells."""
        mine = self.columns()
        return _sorted(
            self.cells,
            Columns(
                np.concatenate([mine.x, others.x]),
                np.concatenate([mine.y, others.y]),
                np.concatenate([mine.weight, others.weight]),
                np.concatenate([mine.made_by, others.made_by]),
                np.concatenate([mine.level, others.level]),
            ),
        )

    def on(self, cells: LevelCells, east_m: float, north_m: float) -> "Bases":
        """Return the same bases on other cells, which begin so far west and south of these."""
        columns = self.columns()
        return Bases.none(cells).merged(columns._replace(x=self.x + east_m, y=self.y + north_m))

    def heights(self, xy: FloatArray) -> FloatArray:
        """Return the sum of all kernels at places (N, 2) [m]."""
        return _heights(self, np.ascontiguousarray(xy))


class Fresh(NamedTuple):
    """Kernels of one level that are being added, in blocks chained by cell.

    ``newest`` (n_cells,) is a cell's latest block, -1 for none; ``before`` the block before it;
    ``filled`` how many places of a block are taken; ``n`` (1,) counts the blocks.
    """

    length_m: float
    n_east: int
    newest: IntArray
    before: IntArray
    filled: IntArray
    x: FloatArray
    y: FloatArray
    weight: FloatArray
    made_by: Kinds
    n: IntArray

    @classmethod
    def on(cls, cells: LevelCells, level: int, n_most: int) -> "Fresh":
        """Return room for so many kernels of a level."""
        n_east, n_north = int(cells.n_east[level]), int(cells.n_north[level])
        n_blocks = n_most // _BLOCK + min(n_most, n_east * n_north) + 1
        room = n_blocks * _BLOCK
        return cls(
            float(cells.length_m[level]),
            n_east,
            np.full(n_east * n_north, -1),
            np.empty(n_blocks, np.int64),
            np.empty(n_blocks, np.int64),
            np.empty(room),
            np.empty(room),
            np.empty(room),
            np.empty(room, np.uint8),
            np.zeros(1, np.int64),
        )

    def taken(self, level: int) -> Columns:
        """Return what was added."""
        used = int(self.n[0])
        room = used * _BLOCK
        taken = (np.arange(_BLOCK) < self.filled[:used, None]).ravel()
        levels = np.full(int(taken.sum()), level, dtype=np.int64)
        x, y, weight = (column[:room][taken] for column in (self.x, self.y, self.weight))
        return Columns(x, y, weight, self.made_by[:room][taken], levels)


@njit(cache=True, fastmath=FAST)
def add_fresh(fresh: Fresh, x: float, y: float, weight: float, made_by: int) -> None:
    """Add a kernel to its cell's latest block, or to a new one."""
    scale = 1.0 / fresh.length_m
    cell = (int(y * scale) + 1) * fresh.n_east + int(x * scale) + 1
    block = fresh.newest[cell]
    if block < 0 or fresh.filled[block] == _BLOCK:
        new = fresh.n[0]
        fresh.n[0] += 1
        fresh.before[new] = block
        fresh.filled[new] = 0
        # What is not taken must add nothing: blocks are summed whole.
        fresh.weight[new * _BLOCK : (new + 1) * _BLOCK] = 0.0
        fresh.x[new * _BLOCK : (new + 1) * _BLOCK] = x
        fresh.y[new * _BLOCK : (new + 1) * _BLOCK] = y
        fresh.newest[cell] = new
        block = new
    k = block * _BLOCK + fresh.filled[block]
    fresh.x[k], fresh.y[k], fresh.weight[k], fresh.made_by[k] = x, y, weight, made_by
    fresh.filled[block] += 1


@njit(cache=True, fastmath=FAST)
def fresh_height(fresh: Fresh, x: float, y: float) -> float:
    """Sum of the kernels that are being added, at a place."""
    scale = 1.0 / fresh.length_m
    i, j = int(x * scale) + 1, int(y * scale) + 1
    total = 0.0
    for row in range(j - 1, j + 2):
        for cell in range(row * fresh.n_east + i - 1, row * fresh.n_east + i + 2):
            block = fresh.newest[cell]
            while block >= 0:
                first = block * _BLOCK
                total += _sum_of((fresh.x, fresh.y, fresh.weight), (first, first + _BLOCK), x, y, scale)
                block = fresh.before[block]
    return total


@njit(cache=True, fastmath=FAST)
def height_at(bases: Bases, x: float, y: float) -> float:
    """Sum of all kernels at a place within the rectangle."""
    cells = bases.cells
    total = 0.0
    for level in range(len(cells.length_m)):
        scale = 1.0 / cells.length_m[level]
        i, j = int(x * scale) + 1, int(y * scale) + 1
        for row in range(j - 1, j + 2):
            cell = cells.first[level] + row * cells.n_east[level] + i
            row_of_three = bases.start[cell - 1], bases.start[cell + 2]
            total += _sum_of((bases.x, bases.y, bases.weight), row_of_three, x, y, scale)
    return total


@njit(cache=True, fastmath=FAST, inline="always")
def _sum_of(
    kernels: tuple[FloatArray, FloatArray, FloatArray],
    span: tuple[int, int],
    x: float,
    y: float,
    scale: float,
) -> float:
    """Sum of the kernels of a span at a place."""
    xs, ys, weights = kernels
    total = 0.0
    for k in range(span[0], span[1]):
        dx, dy = xs[k] - x, ys[k] - y
        total += weights[k] * wu(np.sqrt(dx * dx + dy * dy) * scale)
    return total


@njit(cache=True, fastmath=FAST)
def _heights(bases: Bases, xy: FloatArray) -> FloatArray:
    heights = np.empty(len(xy))
    for k in range(len(xy)):
        heights[k] = height_at(bases, xy[k, 0], xy[k, 1])
    return heights


@njit(cache=True)
def _sorted(cells: LevelCells, kernels: Columns) -> Bases:
    """Bring kernels into the order of their cells, by counting; those of a cell stay as they came."""
    n = len(kernels.x)
    key = np.empty(n, np.int64)
    start = np.zeros(cells.first[-1] + 1, np.int64)
    for k in range(n):
        e = kernels.level[k]
        scale = 1.0 / cells.length_m[e]
        i, j = int(kernels.x[k] * scale) + 1, int(kernels.y[k] * scale) + 1
        key[k] = cells.first[e] + j * cells.n_east[e] + i
        start[key[k] + 1] += 1
    start = np.cumsum(start)
    place = start.copy()
    x, y, weight, made_by = np.empty(n), np.empty(n), np.empty(n), np.empty(n, np.uint8)
    for k in range(n):
        to = place[key[k]]
        place[key[k]] += 1
        x[to], y[to], weight[to] = kernels.x[k], kernels.y[k], kernels.weight[k]
        made_by[to] = kernels.made_by[k]
    return Bases(cells, x, y, weight, made_by, start)

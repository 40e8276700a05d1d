"""Functional stochastic subgradient descent with compactly supported kernels (Algorithm 1), compiled.

The kernel is Wu's φ₂,₁. A surface is a sum of kernels with weights: `Bases` holds those of earlier passes, sorted into the
cells of their levels, and `Fresh` those of the pass that runs; both state whether a point or a ray made each kernel.
`descend` is one pass over points and lines of sight: a kernel at each point that the surface misses by more than the
dead-band, and kernels where a ray runs deepest under the surface.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from survey.core import BoolArray, FloatArray, IntArray


@njit(cache=True, inline="always")
def wu(rho: float) -> float:
    """Kernel at a distance of ρ length scales; 0 from 1 on, without a branch, so that loops over it run in lanes."""
    inside = max(1.0 - rho, 0.0)
    square = inside * inside
    return square * square * (1.0 + rho * (4.0 + rho * (3.0 + 0.75 * rho)))


def wu_kernel(distance_m: FloatArray, length_m: float) -> FloatArray:
    r"""Return Wu's kernel φ₂,₁ of distances, 1 at none.

    .. math::  k(\rho) = (1 - \rho)^4_+ \, (4 + 16 \rho + 12 \rho^2 + 3 \rho^3) / 4,
               \qquad \rho = d / \sigma

    Eqs. 6 and 7 of the carving paper, divided by 4 so that a weight is a height.

    `distance_m`: distances d [m]. `length_m`: length scale σ [m], beyond which the kernel is 0. Returns:
    between 0 and 1, positive definite in up to three dimensions, twice continuously differentiable.

    >>> wu_kernel(np.array([0.0, 1.0, 2.0, 3.0]), 2.0).round(4)
    array([1.    , 0.2402, 0.    , 0.    ])
    """
    rho = np.asarray(distance_m, dtype=np.float64) / length_m
    inside = np.maximum(1.0 - rho, 0.0)
    kernel: FloatArray = inside**4 * (1.0 + rho * (4.0 + rho * (3.0 + 0.75 * rho)))
    return kernel


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


@njit(cache=True, fastmath=FAST, inline="always")
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
        # Unused entries are zero, since blocks are summed completely.
        fresh.weight[new * _BLOCK : (new + 1) * _BLOCK] = 0.0
        fresh.x[new * _BLOCK : (new + 1) * _BLOCK] = x
        fresh.y[new * _BLOCK : (new + 1) * _BLOCK] = y
        fresh.newest[cell] = new
        block = new
    k = block * _BLOCK + fresh.filled[block]
    fresh.x[k], fresh.y[k], fresh.weight[k], fresh.made_by[k] = x, y, weight, made_by
    fresh.filled[block] += 1


@njit(cache=True, fastmath=FAST, inline="always")
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


@njit(cache=True, fastmath=FAST, inline="always")
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


# How often one line of sight presses the surface down in a pass, and how hard at most [m].
_N_WORST, _YIELD_M = 2, 2.0
MOST_PER_POINT = 1 + _N_WORST
"""Bases that a point and its line of sight make in a pass at most."""


class Step(NamedTuple):
    """Parameters of a pass: prior and dead-band of points [m], η₀, the steps after which η has fallen by √2, λ, whether rays count, their η."""

    prior_m: float
    dead_band_m: float
    rate: float
    slow_after: float
    decay: float
    carve: bool
    ray_rate: float


class Rasters(NamedTuple):
    """The surface above its prior on nodes, on which lines of sight are searched for their worst violation.

    ``fine`` (H, W) holds all passes before this one from (0, 0), ``coarse`` what this pass has
    added from (``west_m``, ``south_m``), both with their own steps [m]; ``highest`` (2,) the
    greatest height of each.
    """

    fine: FloatArray
    fine_step_m: float
    coarse: FloatArray
    coarse_step_m: float
    west_m: float
    south_m: float
    highest: FloatArray


class Visited(NamedTuple):
    """What a pass goes over: hits and sensors (N, 3), and what a surface makes of them.

    `slack_m` (N,) is how deep under the surface a line of sight may run [m], `carves` (N,) whether it
    is accepted at all, and `outvoted` (H, W) the heights below which none is [m], on nodes `vote_step_m`
    apart from (0, 0); `before` and `known` (N,) are the heights above the prior that earlier runs and
    this one gave the points; `settled` holds the bases of earlier runs, `latest` those of this run's
    passes before.
    """

    xyz: FloatArray
    origins: FloatArray
    slack_m: FloatArray
    carves: BoolArray
    outvoted: FloatArray
    vote_step_m: float
    before: FloatArray
    known: FloatArray
    settled: Bases
    latest: Bases


class Violation(NamedTuple):
    """Where a line of sight is deepest under the surface, and how deep [m]; 0 where it is nowhere deeper than its slack."""

    x: float
    y: float
    depth_m: float


class Tally(NamedTuple):
    """What a pass met: bases made by points and by rays, steps, and sums of |violation| [m] and ½ violation² [m²]."""

    n_points: int
    n_rays: int
    n_steps: int
    gradient_m: float
    loss_m2: float
    decayed: float


@njit(cache=True, fastmath=FAST)
def descend(  # noqa: PLR0917 - compiled functions take no keywords
    visited: Visited, order: IntArray, first_step: int, fresh: Fresh, rasters: Rasters, step: Step
) -> Tally:
    r"""Visit the points in the given order, and add the bases that their violations ask for.

    For the point i and its line of sight g_i, with the height f of the surface,

    .. math::  \alpha = -\eta_t (f(x_i) - z_i),  \qquad
               \alpha = -\eta_{ray} \max_x (f(x) - g_i(x)),  \qquad
               \alpha_j \leftarrow (1 - \eta_t \lambda) \alpha_j

    (Eqs. 12 and 13). The paper has one η, and visits a point and its line of sight together; here all points
    come first, because on an unfinished surface the next points undo the effect of the lines of sight. Weights are stored
    divided by the decay so far, so that a step does not change the old ones. Afterwards all weights of this run have to be
    multiplied by the tally's ``decayed``; those of earlier runs are final.
    """
    decayed, gradient, loss = 1.0, 0.0, 0.0
    n_points, n_rays = 0, 0
    xyz = visited.xyz
    for t in range(len(order)):
        i = order[t]
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        rate = step.rate / np.sqrt(1.0 + (first_step + t) / step.slow_after)
        residual = (
            step.prior_m + visited.before[i] + decayed * (visited.known[i] + fresh_height(fresh, x, y)) - z
        )
        if abs(residual) > step.dead_band_m:
            _add(fresh, rasters, x, y, -rate * residual / decayed, BY_POINT, step.carve)
            gradient += abs(residual)
            n_points += 1
        loss += 0.5 * residual * residual
        decayed *= 1.0 - rate * step.decay
    for i in order if step.carve else order[:0]:
        if visited.carves[i]:
            deepest, n_made = _carve(visited, i, fresh, rasters, step, decayed)
            gradient += deepest
            loss += 0.5 * deepest * deepest
            n_rays += n_made
    return Tally(n_points, n_rays, len(order), gradient, loss, decayed)


@njit(cache=True, fastmath=FAST, inline="always")
def _carve(  # noqa: PLR0917
    visited: Visited, i: int, fresh: Fresh, rasters: Rasters, step: Step, decayed: float
) -> tuple[float, int]:
    """Press the surface down where a line of sight is deepest under it, and where it is then; return the first depth and how often."""
    deepest = 0.0
    for k in range(_N_WORST):
        worst = worst_violation(visited, i, fresh, rasters, step, decayed)
        if worst.depth_m == 0.0:
            return deepest, k
        deepest = max(deepest, worst.depth_m)
        # Huber's loss: one ray says no more than this at once.
        pull = step.ray_rate * min(worst.depth_m, _YIELD_M)
        _add(fresh, rasters, worst.x, worst.y, -pull / decayed, BY_RAY, True)
    return deepest, _N_WORST


@njit(cache=True, fastmath=FAST, inline="always")
def worst_violation(  # noqa: PLR0917
    visited: Visited, i: int, fresh: Fresh, rasters: Rasters, step: Step, decayed: float
) -> Violation:
    """Search a line of sight on the rasters, and weigh the worst place exactly.

    The search uses the pass's own nodes, and the finest ones about the worst of them. What the line of
    sight bounds there counts as far as other lines do not contradict it.
    """
    hit, origin = visited.xyz[i], visited.origins[i]
    dx, dy, dz = origin[0] - hit[0], origin[1] - hit[1], origin[2] - hit[2]
    n = int(np.sqrt(dx * dx + dy * dy) / rasters.fine_step_m)
    stride = max(int(rasters.coarse_step_m / rasters.fine_step_m), 1)
    k, depth = _deepest((hit, dx, dy, dz), (1, n, stride), n, rasters, step.prior_m, decayed)
    if stride > 1 and depth > 0.0:
        about = max(k - stride + 1, 1), min(k + stride - 1, n), 1
        k, depth = _deepest((hit, dx, dy, dz), about, n, rasters, step.prior_m, decayed)
    if depth <= visited.slack_m[i]:
        return Violation(hit[0], hit[1], 0.0)
    at = k / n
    x, y = hit[0] + at * dx, hit[1] + at * dy
    learned = height_at(visited.latest, x, y) + fresh_height(fresh, x, y)
    exact = step.prior_m + height_at(visited.settled, x, y) + decayed * learned
    rows, columns = visited.outvoted.shape
    i_vote = min(int(x / visited.vote_step_m + 0.5), columns - 1)
    j_vote = min(int(y / visited.vote_step_m + 0.5), rows - 1)
    depth = exact - max(hit[2] + at * dz, visited.outvoted[j_vote, i_vote])
    return Violation(x, y, depth if depth > visited.slack_m[i] else 0.0)


@njit(cache=True, fastmath=FAST, inline="always")
def _deepest(  # noqa: PLR0917
    line: tuple[FloatArray, float, float, float],
    places: tuple[int, int, int],
    n: int,
    rasters: Rasters,
    prior_m: float,
    decayed: float,
) -> tuple[int, float]:
    """Return which of the places first, first + stride … last of n between hit and sensor is deepest on the rasters, and how deep [m]."""
    hit, dx, dy, dz = line
    highest = prior_m + rasters.highest[0] + rasters.highest[1]
    deepest, at = 0.0, 0
    for k in range(places[0], places[1] + 1, places[2]):
        u = k / n
        g = hit[2] + u * dz
        if g > highest and dz >= 0.0:
            break
        x, y = hit[0] + u * dx, hit[1] + u * dy
        east, north = x - rasters.west_m, y - rasters.south_m
        if not _covers(rasters.coarse, rasters.coarse_step_m, east, north):
            break
        above = _on(rasters.fine, rasters.fine_step_m, x, y)
        above += decayed * _on(rasters.coarse, rasters.coarse_step_m, east, north)
        depth = prior_m + above - g
        if depth > deepest:
            deepest, at = depth, k
    return at, deepest


@njit(cache=True, fastmath=FAST, inline="always")
def _add(  # noqa: PLR0917
    fresh: Fresh, rasters: Rasters, x: float, y: float, weight: float, made_by: int, on_raster: bool
) -> None:
    add_fresh(fresh, x, y, weight, made_by)
    if on_raster:
        _splat(rasters, x, y, weight, fresh.length_m)


@njit(cache=True, fastmath=FAST, inline="always")
def _splat(rasters: Rasters, x: float, y: float, weight: float, length_m: float) -> None:
    """Add one kernel to the pass's raster."""
    raster, scale = rasters.coarse, 1.0 / rasters.coarse_step_m
    rows, columns = raster.shape
    u, v, reach = (x - rasters.west_m) * scale, (y - rasters.south_m) * scale, length_m * scale
    i0, i1 = max(int(np.ceil(u - reach)), 0), min(int(u + reach), columns - 1)
    j0, j1 = max(int(np.ceil(v - reach)), 0), min(int(v + reach), rows - 1)
    highest = rasters.highest[1]
    for j in range(j0, j1 + 1):
        for i in range(i0, i1 + 1):
            raster[j, i] += weight * wu(np.sqrt((i - u) ** 2 + (j - v) ** 2) / reach)
            highest = max(highest, raster[j, i])
    rasters.highest[1] = highest


@njit(cache=True, inline="always")
def _covers(raster: FloatArray, step_m: float, x: float, y: float) -> bool:
    rows, columns = raster.shape
    return x >= 0.0 and y >= 0.0 and x < (columns - 1) * step_m and y < (rows - 1) * step_m


@njit(cache=True, fastmath=FAST, inline="always")
def _on(raster: FloatArray, step_m: float, x: float, y: float) -> float:
    """Return the height of a raster at a place that it covers, bilinear."""
    u, v = x / step_m, y / step_m
    i, j = int(u), int(v)
    s, t = u - i, v - j
    south = raster[j, i] + s * (raster[j, i + 1] - raster[j, i])
    north = raster[j + 1, i] + s * (raster[j + 1, i + 1] - raster[j + 1, i])
    return float(south + t * (north - south))

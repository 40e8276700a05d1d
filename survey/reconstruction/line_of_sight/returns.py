r"""Tests of the returns of a scan: outliers, isolated low ones, ground under overhangs, and valid lines of sight.

`ghosts` detects returns far from the median height of their neighbours.

`ground` classifies returns where trees, walls and cables hang over the ground. A return is ground if no other lies so far
below it that the ground would have to rise more steeply than m between the two (Vosselman 2000, *Slope based filtering
of laser altimetry data*):

.. math::  z_i \le \min_j (z_j + m \, d_{ij}) + c

A map of heights has one height over every place; returns from what overhangs it would be mapped as hills.

`checked_origins` refuses sensor positions that cannot belong to the points, and `ends_far_below` finds
lines of sight that end far below a map, both before rays bound the ground.

Multiple reflections and faulty ranges leave single returns metres below the ground. A filter that keeps the lowest
returns, or a line of sight to such a return, would cut a hole as wide as it is deep: `without_low_returns` leaves them out
first.
"""

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from survey.core import BoolArray, CapacityError, FloatArray, InputError, IntArray
from survey.data import SurfacePoints

# A neighbourhood is 3 × 3 cells; where it holds too few points, one of cells four times as wide is used.
_CELL_M, _WIDER = 1.0, 4.0
_N_LEAST = 6
_N_SAMPLED = 32
_N_COMPANIONS = 3
LEAST_M = 0.3
_SIGMAS = 4.0
QUARTILES_TO_SIGMA = 1.349
"""Distance of the quartiles of a normal distribution over its standard deviation."""


def ghosts(xyz: FloatArray) -> BoolArray:
    """Return which points of a scan (N, 3) [m] are ghosts (N,).

    A ghost lies farther from the median height of its neighbours, within 1 to 2 m, than
    0.3 m and four of their standard deviations, taken from their quartiles, and fewer than
    three of them lie within 0.3 m of its height: the top of a pile is not alone. Where fewer than six points are
    near, those within 4 to 8 m are used; without six there, a point is accepted.

    >>> xy = np.random.default_rng(0).uniform(0.0, 5.0, (200, 2))
    >>> xyz = np.column_stack([xy, 0.1 * xy[:, 0]])
    >>> xyz[17, 2] -= 10.0
    >>> np.flatnonzero(ghosts(xyz))
    array([17])
    """
    x, y, z = (np.ascontiguousarray(axis) for axis in xyz.T)
    near, n_near = _beside_neighbours(x, y, z, _CELL_M)
    alone = n_near < _N_LEAST
    if alone.any():
        far, n_far = _beside_neighbours(x, y, z, _CELL_M * _WIDER)
        near = np.where(alone, (n_far >= _N_LEAST) & far, near)
    return near


def _beside_neighbours(
    x: FloatArray, y: FloatArray, z: FloatArray, cell_m: float
) -> tuple[BoolArray, IntArray]:
    """Return which points lie far from their neighbourhood's median, and how many points it holds."""
    key, n_east = _cells(x, y, cell_m)
    order = _sorted(key) if key.max() < 4 * len(key) + 1000 else np.argsort(key, kind="stable")
    return _judged(z, key, order, n_east)


@njit(cache=True)
def _cells(x: FloatArray, y: FloatArray, cell_m: float) -> tuple[IntArray, int]:
    """Return the number of every point's cell, and the cells in a row; a rim of empty ones spares the search its edges."""
    west, south = np.floor(x.min() / cell_m), np.floor(y.min() / cell_m)
    n_east = int(np.floor(x.max() / cell_m) - west) + 3
    key = np.empty(len(x), dtype=np.int64)
    for k in range(len(x)):
        i, j = int(np.floor(x[k] / cell_m) - west), int(np.floor(y[k] / cell_m) - south)
        key[k] = (j + 1) * n_east + i + 1
    return key, n_east


@njit(cache=True)
def _sorted(key: IntArray) -> IntArray:
    """Return the order of the points by their cell, equal ones as they came, by counting."""
    first = np.zeros(key.max() + 2, dtype=np.int64)
    for cell in key:
        first[cell + 1] += 1
    first = np.cumsum(first)
    order = np.empty(len(key), dtype=np.int64)
    for k in range(len(key)):
        order[first[key[k]]] = k
        first[key[k]] += 1
    return order


@njit(cache=True)
def _judged(z: FloatArray, key: IntArray, order: IntArray, n_east: int) -> tuple[BoolArray, IntArray]:
    """Judge every point by the median of the 3 × 3 cells around its own."""
    n = len(z)
    far = np.zeros(n, dtype=np.bool_)
    n_near = np.zeros(n, dtype=np.int64)
    keys = key[order]
    k = 0
    while k < n:
        own, first = keys[k], k
        while k < n and keys[k] == own:
            k += 1
        total = 0
        spans = np.empty((3, 2), dtype=np.int64)
        for row in range(3):
            start = own + (row - 1) * n_east - 1
            spans[row, 0] = np.searchsorted(keys, start)
            spans[row, 1] = np.searchsorted(keys, start + 3)
            total += spans[row, 1] - spans[row, 0]
        stride = (total + _N_SAMPLED - 1) // _N_SAMPLED
        heights = np.empty(total // stride + 1)
        m, count = 0, 0
        for row in range(3):
            for a in range(spans[row, 0], spans[row, 1]):
                if count % stride == 0:
                    heights[m] = z[order[a]]
                    m += 1
                count += 1
        sampled = np.sort(heights[:m])
        middle = sampled[m // 2]
        allowed = max(LEAST_M, _SIGMAS * (sampled[3 * m // 4] - sampled[m // 4]) / QUARTILES_TO_SIGMA)
        for a in range(first, k):
            height = z[order[a]]
            n_near[order[a]] = total
            if abs(height - middle) > allowed:
                companions = -1
                for row in range(3):
                    for b in range(spans[row, 0], spans[row, 1]):
                        companions += abs(z[order[b]] - height) <= LEAST_M
                far[order[a]] = companions < _N_COMPANIONS
    return far, n_near


_STEEPEST, _TOLERANCE_M = 1.2, 0.3
_GROUND_CELL_M = 0.25
_MOST_CELLS = 50_000_000
# Two sweeps there and back carry a height around every corner that ground has.
_N_SWEEPS = 2


def ground(xyz: FloatArray) -> BoolArray:
    """Return which points (N, 3) [m] are ground (N,), by their heights over the lowest ones around.

    A point is ground up to 0.3 m above cones that rise by 1.2 (50°) from the lowest point in every cell
    of 0.25 m. Distances run along the cells in eight directions, which makes them up to 8 % too long.

    Lines of sight are not used, so that they can be tested against the result. The edges of steps, boulders
    and ice walls go too where they rise by more than 0.3 m at once: what is left is what a map of heights
    can hold. A roof so wide that its middle is far from all ground stays, and a cluster of returns from
    under the ground takes the ground about it away.

    A branch 3 m above a slope of 0.5:

    >>> slope = np.column_stack([np.arange(9.0), np.zeros(9), 0.5 * np.arange(9.0)])
    >>> slope[4, 2] += 3.0
    >>> ground(slope)
    array([ True,  True,  True,  True, False,  True,  True,  True,  True])
    """
    cell = np.floor(xyz[:, :2] / _GROUND_CELL_M).astype(np.int64)
    cell -= cell.min(axis=0)
    n_east, n_north = (int(n) for n in cell.max(axis=0) + 1)
    if n_east * n_north > _MOST_CELLS:
        raise CapacityError(
            f"ground is classified on cells of {_GROUND_CELL_M:g} m, and the points spread over {n_east} × {n_north} of them; "
            "cut off the points that are far from the others."
        )
    lowest = np.full((n_east, n_north), np.inf)
    np.minimum.at(lowest, tuple(cell.T), xyz[:, 2])
    _rise(lowest, _STEEPEST * _GROUND_CELL_M)
    found: BoolArray = xyz[:, 2] <= lowest[tuple(cell.T)] + _TOLERANCE_M
    return found


@njit(cache=True)
def _rise(height: FloatArray, rise_m: float) -> None:
    """Lower every cell to the cones over all others, which rise so much from cell to cell."""
    rows, columns = height.shape
    for _ in range(_N_SWEEPS):
        for j in range(rows):
            for i in range(columns):
                _lower(height, j, i, -1, rise_m)
        for j in range(rows - 1, -1, -1):
            for i in range(columns - 1, -1, -1):
                _lower(height, j, i, 1, rise_m)


@njit(cache=True, inline="always")
def _lower(height: FloatArray, j: int, i: int, way: int, rise_m: float) -> None:
    """Lower a cell to the cones over the four neighbours that a sweep has passed."""
    rows, columns = height.shape
    low, askew_m = height[j, i], np.sqrt(2.0) * rise_m
    if 0 <= i + way < columns:
        low = min(low, height[j, i + way] + rise_m)
    if 0 <= j + way < rows:
        low = min(low, height[j + way, i] + rise_m)
        if i > 0:
            low = min(low, height[j + way, i - 1] + askew_m)
        if i < columns - 1:
            low = min(low, height[j + way, i + 1] + askew_m)
    height[j, i] = low


_SHORTEST_M = 1e-3
# The ground beside a sensor is what at least so many points say, within so many metres.
_N_LEAST_BESIDE, _BESIDE_M = 8, 6.0
_N_SAMPLED = 2_000
_UNDER_SHARE = 0.9
_ABOVE_SHARE = 0.9
# A ray that ends so many standard deviations below the map went somewhere else.
_OUTLYING_SIGMAS, _MEDIAN_TO_SIGMA = 4.0, 0.6745


def checked_origins(points: SurfacePoints) -> FloatArray:
    """Return where the sensor stood for every point (N, 3) [m], once the lines of sight make sense.

    Points above their sensor may be hills, trees or houses, and are retained. More than nine tenths are refused: the heights
    count downwards, origins and points are in different frames, or no ground was seen.

    >>> hit = SurfacePoints([[4.0, 0.0, 0.0]], sigma_m=0.1, origins=[[0.0, 0.0, 2.0]], crs="EPSG:32608")
    >>> checked_origins(hit)
    array([[0., 0., 2.]])
    """
    origins = points.origins
    if origins is None:
        raise InputError(
            "the points do not say where their sensor stood; lines of sight need origins, give them or leave the rays out."
        )
    length_m = np.linalg.norm(points.xyz - origins, axis=1)
    n_short = int((length_m < _SHORTEST_M).sum())
    if n_short:
        k = int(np.argmin(length_m))
        raise InputError(
            f"{n_short} points lie where their sensor stood (the first is number {k}), which is no line of sight; "
            "give the sensor's own place as origin, or leave these points out."
        )
    n_above = int((points.z > origins[:, 2]).sum())
    if n_above > _ABOVE_SHARE * len(points):
        raise InputError(
            f"{n_above} of {len(points)} points lie above their sensor; ground below it, heights that count upwards, and "
            "origins in the points' frame were expected."
        )
    _refuse_buried(points.xyz, origins)
    return origins


def ends_far_below(low_m: FloatArray, sigma_m: FloatArray) -> BoolArray:
    """Return which lines of sight end so far below a map that they went somewhere else.

    `low_m` (N,): how far their ends lie below the map [m]; NaN where it does not reach, where nothing is
    known. `sigma_m` (N,): standard deviations of the ends' heights [m]. Returns (N,) bool: those more than
    four standard deviations below, of the point itself and of the usual distance together.

    >>> ends_far_below(np.array([0.0, 0.1, -0.1, 0.1, -0.1, 2.0, -2.0]), np.full(7, 0.02))
    array([False, False, False, False, False,  True, False])
    """
    known = np.isfinite(low_m)
    spread_m = float(np.median(np.abs(low_m[known]))) / _MEDIAN_TO_SIGMA if known.any() else 0.0
    far: BoolArray = known & (low_m > _OUTLYING_SIGMAS * np.hypot(spread_m, sigma_m))
    return far


def _refuse_buried(xyz: FloatArray, origins: FloatArray) -> None:
    """Refuse sensors that stood under the points beside them."""
    places = _distinct(origins)
    some = xyz[:: -(-len(xyz) // _N_SAMPLED)]
    tree = cKDTree(some[:, :2])
    beside = [np.asarray(tree.query_ball_point(place[:2], _BESIDE_M), dtype=np.int64) for place in places]
    # All within reach are examined: the nearest may hang over the sensor.
    buried = np.array(
        [
            len(near) >= _N_LEAST_BESIDE and np.mean(some[near, 2] > place[2]) > _UNDER_SHARE
            for place, near in zip(places, beside, strict=True)
        ]
    )
    if buried.any():
        x, y, z = places[np.argmax(buried)]
        raise InputError(
            f"{int(buried.sum())} of {len(places)} sensor places are under the ground, the first at ({x:.2f}, {y:.2f}, "
            f"{z:.2f}) m below the points beside it; give origins and points in one frame and one vertical datum."
        )


def _distinct(origins: FloatArray) -> FloatArray:
    """Return the places of a sensor, each once, where it moved between one point and the next."""
    moved: BoolArray = np.ones(len(origins), dtype=bool)
    moved[1:] = (origins[1:] != origins[:-1]).any(axis=1)
    return np.unique(origins[moved], axis=0)


# Neighbours in plan that state where the ground is.
_N_NEIGHBOURS = 24
# Candidates lie below the median of the cells around their own by more than this [m].
_LOW_CELL_M, _LEAST_M = 4.0, 0.5
_LOW_SIGMAS, _QUARTILES_TO_SIGMA = 4.0, 1.349
# Returns at one depth beside each other that are a pit or a crevasse: the point itself and three more.
_N_LOW_COMPANIONS, _COMPANION_M = 3, 1.0
_MOST_CANDIDATES_AT_ONCE = 50_000


def without_low_returns(points: SurfacePoints) -> tuple[SurfacePoints, int]:
    """Return the points without isolated low ones, and the number of those.

    >>> level = np.column_stack([np.random.default_rng(0).uniform(0.0, 9.0, (300, 2)), np.zeros(300)])
    >>> level[7, 2] = -10.0
    >>> without_low_returns(SurfacePoints(level, sigma_m=0.02, crs="EPSG:32608"))[1]
    1
    """
    low = isolated_low(points.xyz)
    n_low = int(low.sum())
    return (points.select(~low), n_low) if n_low else (points, 0)


def isolated_low(xyz: FloatArray) -> BoolArray:
    """Return which points (N, 3) [m] lie alone below the ground, as (N,).

    A point is low if it lies below the median of its 24 nearest neighbours in plan by more than 0.5 m and by more
    than four of their standard deviations, taken from their quartiles. It is isolated if fewer than three of them
    lie within 1 m of its height, so that pits and crevasses with several returns stay.

    `xyz` (N, 3): easting, northing and height [m]. Returns (N,) bool: True for isolated low points; all False
    for fewer than 25 points.

    A pit that gave fewer than four returns cannot be distinguished from faulty ranges and is left out.

    >>> xyz = np.column_stack([np.random.default_rng(0).uniform(0.0, 9.0, (300, 2)), np.zeros(300)])
    >>> xyz[[7, 8], 2] = -10.0
    >>> np.flatnonzero(isolated_low(xyz))
    array([7, 8])
    """
    low = np.zeros(len(xyz), dtype=bool)
    if len(xyz) <= _N_NEIGHBOURS:
        return low
    candidates = _candidates(xyz)
    if not len(candidates):
        return low
    tree = cKDTree(xyz[:, :2])
    for first in range(0, len(candidates), _MOST_CANDIDATES_AT_ONCE):
        some = candidates[first : first + _MOST_CANDIDATES_AT_ONCE]
        low[some] = _alone_below(xyz, some, tree)
    return low


def _candidates(xyz: FloatArray) -> IntArray:
    """Return the numbers of the points that may be low: below the median of a cell around, or with few around."""
    cell = np.floor((xyz[:, :2] - xyz[:, :2].min(axis=0)) / _LOW_CELL_M).astype(np.int64)
    n_north = int(cell[:, 1].max()) + 3
    key = (cell[:, 0] + 1) * n_north + cell[:, 1] + 1
    order = np.lexsort((xyz[:, 2], key))
    cells, start, count = np.unique(key[order], return_index=True, return_counts=True)
    median = xyz[order[start + count // 2], 2]
    highest, n_around = median.copy(), count.copy()
    for shift in (-n_north - 1, -n_north, -n_north + 1, -1, 1, n_north - 1, n_north, n_north + 1):
        at = np.minimum(np.searchsorted(cells, cells + shift), len(cells) - 1)
        is_there = cells[at] == cells + shift
        highest = np.where(is_there, np.maximum(highest, median[at]), highest)
        n_around = n_around + np.where(is_there, count[at], 0)
    own = np.searchsorted(cells, key)
    return np.flatnonzero((xyz[:, 2] < highest[own] - _LEAST_M) | (n_around[own] <= _N_NEIGHBOURS))


def _alone_below(xyz: FloatArray, some: IntArray, tree: cKDTree) -> BoolArray:
    """Judge some points by their nearest neighbours in plan."""
    index = np.asarray(tree.query(xyz[some, :2], k=_N_NEIGHBOURS + 1)[1])
    near, own = xyz[index, 2], xyz[some, 2]
    lower, middle, upper = np.quantile(near, (0.25, 0.5, 0.75), axis=1)
    allowed = np.maximum(_LEAST_M, _LOW_SIGMAS * (upper - lower) / _QUARTILES_TO_SIGMA)
    companions = (np.abs(near - own[:, None]) <= _COMPANION_M).sum(axis=1) - 1
    alone: BoolArray = (own < middle - allowed) & (companions < _N_LOW_COMPANIONS)
    return alone

"""One pass of functional stochastic subgradient descent over points and lines of sight (Algorithm 1), compiled."""

from typing import NamedTuple

import numpy as np
from numba import njit

from survey.core.arrays import BoolArray, FloatArray, IntArray
from survey.reconstruction.carving.bases import (
    BY_POINT,
    BY_RAY,
    FAST,
    Bases,
    Fresh,
    add_fresh,
    fresh_height,
    height_at,
)
from survey.reconstruction.carving.wu_kernel import wu

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


@njit(cache=True, fastmath=FAST)
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


@njit(cache=True, fastmath=FAST)
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


@njit(cache=True, fastmath=FAST)
def _add(  # noqa: PLR0917
    fresh: Fresh, rasters: Rasters, x: float, y: float, weight: float, made_by: int, on_raster: bool
) -> None:
    add_fresh(fresh, x, y, weight, made_by)
    if on_raster:
        _splat(rasters, x, y, weight, fresh.length_m)


@njit(cache=True, fastmath=FAST)
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

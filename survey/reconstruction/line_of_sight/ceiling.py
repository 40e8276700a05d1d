r"""Upper bounds of the ground from the lowest rays over every node, and Gaussian maps truncated at them.

A ray that went from its sensor to its end passed above the ground all the way, g(t) ≥ f(x(t)).
It bounds the height of a node from the point of the ray nearest to it, at the distance d. With slopes of at most m
between the two,

.. math::  f(x_{node}) \le c = g(t^*) + k \sigma + m d

with the standard deviation σ of the ray's height.  One wrong ray would carve a hole, so that not
the lowest one counts but the third.

`below_sight_lines` applies such bounds to a map with Gaussian errors. Where the map states the height N(m, s²) and lines
of sight allow no more than c, the height is normal given that it is below c. With a = (c - m) / s, the density φ and the
distribution Φ of the standard normal,

.. math::  E = m - s \frac{\varphi(a)}{\Phi(a)}, \qquad
           V = s^2 \Big(1 - a \frac{\varphi(a)}{\Phi(a)} - \frac{\varphi(a)^2}{\Phi(a)^2}\Big)

and the bounds are the quantiles at which Φ has 2.5 and 97.5 % of Φ(a). Every node is truncated by itself:
its neighbours do not follow, so that this suits maps whose ceilings are mostly out of reach.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numba import njit
from scipy.special import log_ndtr, ndtr, ndtri

from survey.core import BoolArray, FloatArray, InputError
from survey.data import Dem, SurfacePoints
from survey.reconstruction.line_of_sight.returns import checked_origins, ends_far_below, ghosts
from survey.reconstruction.nodes import NodeWindow, bilinear
from survey.reconstruction.terrain_map import ELEVATION, MEASURED, RAY_BOUNDED, Reconstruction

# Number of rays stored for a node; the last of them is the one that counts.
N_LOWEST = 3
# A ray's last steps say nothing that its end does not say better.
_END_IN_STEPS = 1.5
_SIGMAS = 3.0
# Beyond its mean slope, ground may rise so much from where a ray passes to the node.
_MORE_SLOPE = 0.3
# A ray so far below the third-lowest is outvoted [m].
_ALONE_M = 0.2
# The slope that ranks the rays of one node, before the ground's own is known.
_RANKING_SLOPE = 1.0


@dataclass(eq=False)
class LowestRays:
    """The three lowest rays over every node of a window.

    `height` (3, H, W): height above the datum of the lowest rays where each is nearest to the node, three
    standard deviations of the ray's height added [m]; infinite where there is none. The first is the lowest
    once the ground's rise to the node is added. `offset` (3, H, W): horizontal distance between that place
    and the node [m].

    A node hears of the rays that cross its cell, a square of one step about it. Neighbouring nodes
    often hear of the same rays, so that a ray that is wrong by itself is outvoted and a beam that
    always lies is not.

    A level ray 2 m above the row of nodes, and another, and a third:

    >>> window = NodeWindow(1.0, 0, 0, 3, 9)
    >>> rays = LowestRays.empty(window.shape)
    >>> start, end = np.tile([0.0, 1.0, 2.0], (3, 1)), np.tile([8.0, 1.0, 2.0], (3, 1))
    >>> rays.add(window, start, end, np.zeros(3))
    >>> rays.ceiling(np.zeros(window.shape))[1]
    array([ 2.,  2.,  2.,  2.,  2.,  2.,  2., inf, inf])
    """

    height: FloatArray
    offset: FloatArray

    @classmethod
    def empty(cls, shape: tuple[int, int]) -> Self:
        """Return an empty set of rays."""
        return cls(np.full((N_LOWEST, *shape), np.inf), np.zeros((N_LOWEST, *shape)))

    def add(self, window: NodeWindow, start: FloatArray, end: FloatArray, sigma_m: FloatArray) -> None:
        """Add rays.

        `start`, `end` (N, 3): where the sensor stood and where the ray ended, heights above the datum [m].
        `sigma_m` (N,): standard deviation of a ray's height [m].
        """
        rays = np.empty((len(start), 7))
        rays[:, :2], rays[:, 2] = window.coordinates(start[:, :2]), start[:, 2]
        rays[:, 3:5], rays[:, 5] = window.coordinates(end[:, :2]), end[:, 2]
        rays[:, 6] = _SIGMAS * sigma_m
        # Steep rays first: they are short, and with them most cells near the sensor need no other.
        length = np.hypot(rays[:, 3] - rays[:, 0], rays[:, 4] - rays[:, 1])
        steep_first = np.argsort((rays[:, 5] - rays[:, 2]) / np.maximum(length, 1e-9), kind="stable")
        _cast(rays[steep_first], window.step_m, self.height, self.offset)

    def ceiling(self, slope: FloatArray) -> FloatArray:
        """Return the greatest height (H, W) that the ground can have [m]; infinite where too few rays passed.

        `slope` (H, W): steepness of the ground as far as it is known [m/m].
        """
        reach = np.where(np.isfinite(self.height[-1]), self.offset[-1], 0.0)
        ceiling: FloatArray = self.height[-1] + (slope + _MORE_SLOPE) * reach
        return ceiling

    def outvoted(self) -> FloatArray:
        """Return the heights (H, W) below which no other rays confirm a ray [m]: 0.2 m under the third-lowest.

        -∞ where fewer than three rays passed: no ray can be judged there.
        """
        third = self.height[-1]
        return np.where(np.isfinite(third), third - _ALONE_M, -np.inf)

    def within(self, rows: slice, columns: slice) -> "LowestRays":
        """Return those over a part of the window."""
        return LowestRays(self.height[:, rows, columns], self.offset[:, rows, columns])

    def covered(self) -> BoolArray:
        """Return over which nodes (H, W) enough rays passed."""
        covered: BoolArray = np.isfinite(self.height[-1])
        return covered

    def carried(self, new: NodeWindow, old: NodeWindow) -> "LowestRays":
        """Return the same on another window."""
        return LowestRays(new.carried(self.height, old, np.inf), new.carried(self.offset, old, 0.0))


def steepness(z: FloatArray, step_m: float) -> FloatArray:
    """Return the slope (H, W) of node heights, by differences of neighbours [m/m].

    >>> steepness(np.array([[0.0, 1.0, 2.0]] * 3), 2.0)[1]
    array([0.5, 0.5, 0.5])
    """
    north, east = np.gradient(z, step_m)
    slope: FloatArray = np.hypot(north, east)
    return slope


@njit(cache=True)
def _cast(rays: FloatArray, step_m: float, height: FloatArray, offset: FloatArray) -> None:
    """Walk every ray from cell to cell and keep the lowest; rays are start, end (in steps, steps, m) and margin [m]."""
    rows, columns = height.shape[1:]
    # What a ray has to be below to be among a node's lowest: most are not, and are passed over quickly.
    highest = height[-1] + _RANKING_SLOPE * offset[-1]
    for k in range(len(rays)):
        u, v, z, u_end, v_end, z_end, margin = rays[k]
        du, dv, dz = u_end - u, v_end - v, z_end - z
        squared = du * du + dv * dv
        if squared <= _END_IN_STEPS**2:
            continue
        t, last = 0.0, 1.0 - _END_IN_STEPS / np.sqrt(squared)
        t, last = _within(u, du, columns, t, last)
        t, last = _within(v, dv, rows, t, last)
        if t >= last:
            continue
        i = min(max(int(np.floor(u + t * du + 0.5)), 0), columns - 1)
        j = min(max(int(np.floor(v + t * dv + 0.5)), 0), rows - 1)
        east, north = 1 if du > 0.0 else -1, 1 if dv > 0.0 else -1
        per_column, per_row = 1.0 / du if du else np.inf, 1.0 / dv if dv else np.inf
        t_east, t_north = _leaves(u, per_column, i, east), _leaves(v, per_row, j, north)
        a, b, z = du / squared, dv / squared, z + margin
        while t < last:
            leave = min(t_east, t_north, last)
            nearest = min(max((i - u) * a + (j - v) * b, t), max(leave, t))
            h = z + nearest * dz
            if h < highest[j, i]:
                away_m = step_m * np.hypot(u + nearest * du - i, v + nearest * dv - j)
                _keep(height[:, j, i], offset[:, j, i], h, away_m)
                highest[j, i] = height[-1, j, i] + _RANKING_SLOPE * offset[-1, j, i]
            t = leave
            if t_east <= t_north:
                i += east
                t_east = _leaves(u, per_column, i, east)
            else:
                j += north
                t_north = _leaves(v, per_row, j, north)
            if i < 0 or j < 0 or i >= columns or j >= rows:
                break


@njit(cache=True, inline="always")
def _within(x: float, dx: float, n: int, t: float, last: float) -> tuple[float, float]:
    """Cut the part of a ray between t and last to the cells of n nodes on one axis."""
    low, high = -0.5, n - 0.5
    if dx == 0.0:
        return (t, last) if low <= x <= high else (1.0, 0.0)
    a, b = (low - x) / dx, (high - x) / dx
    return max(t, min(a, b)), min(last, max(a, b))


@njit(cache=True, inline="always")
def _leaves(x: float, per_step: float, i: int, way: int) -> float:
    """Return where a ray leaves the cell of node i on one axis; never, where it runs across that axis."""
    return (i + 0.5 * way - x) * per_step if per_step != np.inf else np.inf


@njit(cache=True, inline="always")
def _keep(height: FloatArray, offset: FloatArray, h: float, d: float) -> None:
    """Insert a ray among a node's lowest, if it is one of them."""
    rank = h + _RANKING_SLOPE * d
    n = len(height)
    if rank >= height[n - 1] + _RANKING_SLOPE * offset[n - 1]:
        return
    k = n - 1
    while k > 0 and rank < height[k - 1] + _RANKING_SLOPE * offset[k - 1]:
        height[k], offset[k] = height[k - 1], offset[k - 1]
        k -= 1
    height[k], offset[k] = h, d


_MISS = 0.025


def below_sight_lines(reconstruction: Reconstruction, points: SurfacePoints) -> Reconstruction:
    """Return a map with bounds that know its points' lines of sight.

    Rays of ghost returns, and rays that end far below the map, count for nothing; over every
    node the third-lowest of the others does.

    The standard deviation is taken to be right, and errors to be normal: the bounds are as good
    as they are. `FieldLattice` has bounds that were held to hidden ground.

    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 8.0, 2.0), 1.0)
    >>> high, wide = Dem.on(grid, np.full(grid.shape, 1.0)), Dem.on(grid, np.full(grid.shape, 1.0))
    >>> bridged = Reconstruction(high, wide, np.ones(grid.shape, dtype=int), "gp", {})
    >>> far = SurfacePoints([[8.0, 1.0, 0.0]] * 3, sigma_m=0.01, origins=[[0.0, 1.0, 1.0]] * 3, crs=grid.crs)
    >>> below_sight_lines(bridged, far).mean.elevation[1].round(1)
    array([ 0.2,  0.2,  0.1,  0. , -0.1, -0.2, -0.3,  1. ,  1. ])
    """
    if reconstruction.quantity != ELEVATION:
        raise InputError(
            f"lines of sight bound elevations, and {reconstruction.quantity} is mapped; leave the rays out."
        )
    ceiling = _ceiling(reconstruction, points)
    mean, std, lower, upper = truncated(reconstruction.mean.elevation, reconstruction.std.elevation, ceiling)
    covered = np.isfinite(ceiling) & np.isfinite(mean) & (reconstruction.support != MEASURED)
    grid, datum = reconstruction.mean.grid(), reconstruction.mean.vertical_datum
    return replace(
        reconstruction,
        mean=Dem.on(grid, mean, datum),
        std=Dem.on(grid, std, datum),
        lower=Dem.on(grid, lower, datum),
        upper=Dem.on(grid, upper, datum),
        support=np.where(covered, RAY_BOUNDED, reconstruction.support),
        diagnostics={**reconstruction.diagnostics, "ray_covered_share": float(np.isfinite(ceiling).mean())},
    )


def truncated(
    mean: FloatArray, std: FloatArray, ceiling: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return mean, standard deviation and the bounds that hold 95 %, given that the height is below a ceiling."""
    # Ten deviations above a ceiling the map is plainly wrong; the tail there has no more digits.
    a = np.clip((ceiling - mean) / std, -10.0, 40.0)
    ratio = np.exp(-0.5 * a * a - log_ndtr(a)) / np.sqrt(2.0 * np.pi)
    shrunk = np.sqrt(np.maximum(1.0 - a * ratio - ratio * ratio, 0.0))
    low, high = (mean + std * ndtri(share * ndtr(a)) for share in (_MISS, 1.0 - _MISS))
    return mean - std * ratio, std * shrunk, low, high


def _ceiling(reconstruction: Reconstruction, points: SurfacePoints) -> FloatArray:
    """Return the greatest height [m] that lines of sight allow on the map's nodes, its first row in the north."""
    origins = checked_origins(points)
    # Nodes count from the south-west corner of the map, whatever it is.
    z, grid = reconstruction.mean.elevation[::-1], reconstruction.mean.grid()
    window = NodeWindow(grid.step_m, 0, 0, *grid.shape)
    corner = np.array([grid.bounds[0], grid.bounds[1], 0.0])
    start, end = origins - corner, points.xyz - corner
    low_m = bilinear(z, window.coordinates(end[:, :2])) - points.z
    accepted = ~ghosts(points.xyz) & ~ends_far_below(low_m, points.sigma_z)
    rays = LowestRays.empty(window.shape)
    rays.add(window, start[accepted], end[accepted], points.sigma_z[accepted])
    slope = steepness(z, grid.step_m)
    ceiling = rays.ceiling(np.where(np.isfinite(slope), slope, 0.0))
    return np.ascontiguousarray(ceiling[::-1])

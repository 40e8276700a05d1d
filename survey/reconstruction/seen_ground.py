r"""Ground around a rover as its scanner has seen it: heights of returns, lowest rays, and where the ground is too steep.

`SeenGround` keeps the newest returns of every node of a window that moves with the rover, and the lowest rays over it. Between two nodes
less than the base b apart the medians differ by Δ, with a standard deviation σ. The rise u between them is taken to be that of
common ground or, with the probability π, that of a hazard,

.. math::  u \sim (1 - \pi) \, N(0, \tau^2) + \pi \, N(0, S^2), \qquad P(u > b \tan \theta \mid \Delta)

is the probability of a rise beyond the limit. A step, a wall, a boulder and the edge of a crevasse are such rises, as is a
slope. The scatter τ is that of the rises of the ground itself. Where no return came from the lower node, the height that lines of
sight allow takes its place: ground that a ray passed over and that lies so far below its neighbour is steep without
having been seen (the chord bound of the space-carving paper, Fig. 4).
"""

import math
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.ndimage import distance_transform_edt, grey_closing
from scipy.special import ndtr

from survey.core import BoolArray, FloatArray, InputError, IntArray
from survey.reconstruction.line_of_sight.ceiling import LowestRays
from survey.reconstruction.nodes import NodeWindow

N_KEPT = 9
"""Newest returns of a node whose median is its height."""
_LEAST_RETURNS = 3
# Nodes this near to one that was seen count as seen: sparse returns leave single nodes out [m].
_BESIDE_M = 0.3
DIP_M = 1.0
"""Widest dip that may be a gap in the ground [m]."""
_LEAST_DIP_M, _DIP_SIGMAS = 0.15, 5.0
# Share of the rises that are hazards', and their standard deviation in limits.
_HAZARD_SHARE, _HAZARD_RISES = 0.02, 2.0
# Pairs from which the scatter of common rises is taken; the least one, and the one that is assumed without them, as shares of the limit.
_LEAST_PAIRS, _LEAST_SHARE, _USUAL_SHARE = 200, 0.05, 0.3
# From the median of the absolute deviations to a standard deviation, and from that of a mean to that of a median.
_TO_SIGMA, _OF_MEDIAN = 1.4826, 1.2533


@dataclass(frozen=True)
class RiseLimit:
    """Steepest ground that a rover can stand.

    Parameters
    ----------
    slope_deg : float
        Steepest slope over the base [deg].
    base_m : float
        Base over which ground rises, about the length of the rover [m]. A step of ``base_m * tan(slope_deg)`` is too high.

    Raises
    ------
    InputError
        A slope that is not between 0 and 90°, or a base that is not positive.

    Examples
    --------
    >>> round(RiseLimit(25.0, 1.0).rise_m, 2)
    0.47
    """

    slope_deg: float = 25.0
    base_m: float = 1.0

    def __post_init__(self) -> None:
        if not 0.0 < self.slope_deg < 90.0:
            raise InputError(f"a slope of {self.slope_deg:g}° is no limit; give one between 0 and 90°.")
        if not (np.isfinite(self.base_m) and self.base_m > 0.0):
            raise InputError(f"a base of {self.base_m:g} m was given; it must be greater than 0.")

    @property
    def rise_m(self) -> float:
        """Largest rise over the base or less [m]."""
        return self.base_m * float(np.tan(np.radians(self.slope_deg)))


@dataclass(eq=False)
class SeenGround:
    """Heights of returns and lowest rays on a window of nodes.

    Parameters
    ----------
    window : NodeWindow
        Nodes; a quarter of the rover's length apart or less.

    Notes
    -----
    Returns and rays are placed by estimated poses. Errors of the poses that change within metres of travel widen the spread of a node's
    returns and with it σ; those that change slowly move all nodes alike, and do not matter. Old returns are replaced by new ones.

    Examples
    --------
    A step of 1 m that was seen from both sides:

    >>> seen = SeenGround(NodeWindow(0.25, 0, 0, 5, 20))
    >>> xy = np.tile(seen.window.xy, (3, 1))
    >>> xyz = np.column_stack([xy, 1.0 * (xy[:, 0] > 2.4)])
    >>> seen.add(xyz, np.tile([0.0, 0.0, 3.0], (len(xyz), 1)), np.full(len(xyz), 0.02))
    >>> (seen.steep_probability(RiseLimit(25.0, 0.5))[2] > 0.5).nonzero()[0].tolist()  # nodes at 2.25 and 2.5 m
    [9, 10]
    """

    window: NodeWindow
    rays: LowestRays = field(init=False)
    _height: npt.NDArray[np.float32] = field(init=False)
    _count: npt.NDArray[np.int32] = field(init=False)
    _variance: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        shape = self.window.shape
        self.rays = LowestRays.empty(shape)
        self._height = np.zeros((N_KEPT, *shape), dtype=np.float32)
        self._count = np.zeros(shape, dtype=np.int32)
        self._variance = np.zeros(shape)

    def add(self, xyz: FloatArray, origins: FloatArray | None, sigma_m: FloatArray) -> None:
        """Add returns and the rays that brought them.

        Parameters
        ----------
        xyz : (N, 3) ndarray
            Places of returns in the world [m].
        origins : (N, 3) ndarray or None
            Places of the scanner [m]; without them there are no rays.
        sigma_m : (N,) ndarray
            Standard deviations of their heights [m].
        """
        rings = (self._height, self._count, self._variance)
        _store(self.window.coordinates(xyz[:, :2]), xyz[:, 2], sigma_m, rings)
        if origins is not None:
            self.rays.add(self.window, origins, xyz, sigma_m)

    def move_to(self, window: NodeWindow) -> None:
        """Take another window of nodes with the same step; what lies beyond it is forgotten."""
        self.rays = self.rays.carried(window, self.window)
        self._height, self._count, self._variance = (
            window.carried(values, self.window) for values in (self._height, self._count, self._variance)
        )
        self.window = window

    def heights(self) -> tuple[FloatArray, FloatArray]:
        """Return the medians (H, W) [m] and their standard deviations (H, W) [m]; NaN at nodes without returns."""
        return _medians(self._height, self._count, self._variance)

    def is_seen(self) -> BoolArray:
        """Return at which nodes (H, W) the ground was seen, there or within 0.3 m."""
        enough = self._count >= _LEAST_RETURNS
        if not enough.any():
            return enough
        seen: BoolArray = distance_transform_edt(~enough) * self.window.step_m <= _BESIDE_M
        return seen

    def steep_probability(self, limit: RiseLimit) -> FloatArray:
        """Return the probability that a rover at each node stands on a rise beyond the limit.

        Parameters
        ----------
        limit : RiseLimit
            Steepest ground.

        Returns
        -------
        (H, W) ndarray
            The largest probability over all rises in the middle of which the node lies: a rover there stands on both ends. 0 where nothing
            is known.
        """
        height, sigma = self.heights()
        known = np.isfinite(height)
        offsets = np.array(_offsets(limit.base_m / self.window.step_m))
        common = self._common_rise_m(height, sigma, limit)
        probability = _rise_probability(height, sigma**2, offsets, limit.rise_m, common)
        # Three standard deviations of the rays are in the ceiling already.
        ceiling = np.where(known, np.inf, self.rays.ceiling(np.zeros(height.shape)))
        chords = _largest_excess(height, sigma, ceiling, offsets, limit.rise_m)
        larger: FloatArray = np.maximum(probability, ndtr(chords))
        return larger

    def _common_rise_m(self, height: FloatArray, sigma: FloatArray, limit: RiseLimit) -> float:
        """Return the scatter of rises over the base [m], less that of their errors."""
        n = max(round(limit.base_m / self.window.step_m), 1)
        rises = (height[n:] - height[:-n], height[:, n:] - height[:, :-n])
        errors = (np.hypot(sigma[n:], sigma[:-n]), np.hypot(sigma[:, n:], sigma[:, :-n]))
        rise, error = (np.concatenate([a.ravel(), b.ravel()]) for a, b in (rises, errors))
        known = np.isfinite(rise)
        least = _LEAST_SHARE * limit.rise_m
        if known.sum() < _LEAST_PAIRS:
            return _USUAL_SHARE * limit.rise_m
        scatter = _TO_SIGMA * float(np.median(np.abs(rise[known])))
        return float(np.sqrt(max(scatter**2 - np.median(error[known] ** 2), least**2)))

    def gaps(self, limit: RiseLimit, nearby: BoolArray) -> BoolArray:
        """Return which nodes (H, W) are within the base of a dip nearby that may be a gap whose bottom cannot be seen.

        A scanner sees less of the depth of a gap the farther it is away. A dip is at most `DIP_M` wide, and lies lower than the ground on
        both sides by more than 0.15 m and five times the scatter of such depths. The distance of a base is kept, as gaps end in tips that are
        too narrow to be seen.
        """
        height, _ = self.heights()
        depth = _dip_depth(height, max(round(0.5 * DIP_M / self.window.step_m), 1))
        known = depth[np.isfinite(depth)]
        if len(known) == 0:
            return np.zeros(height.shape, dtype=bool)
        scatter = _TO_SIGMA * float(np.median(np.abs(known - np.median(known))))
        deep = depth > float(np.median(known)) + max(_LEAST_DIP_M, _DIP_SIGMAS * scatter)
        deep &= nearby
        if not deep.any():
            return deep
        near: BoolArray = distance_transform_edt(~deep) * self.window.step_m <= limit.base_m
        return near


def _dip_depth(height: FloatArray, reach: int) -> FloatArray:
    """Return how far each node (H, W) lies below the lower of two nodes on opposite sides, the largest of four directions [m]."""
    padded = np.pad(height, reach, constant_values=np.nan)
    rows, columns = height.shape
    depth = np.full(height.shape, np.nan)
    for k in range(1, reach + 1):
        for south, east in ((0, k), (k, 0), (k, k), (k, -k)):
            sides = [
                padded[reach + v : reach + v + rows, reach + u : reach + u + columns]
                for v, u in ((south, east), (-south, -east))
            ]
            depth = np.fmax(depth, np.minimum(*sides) - height)
    return depth


def steep_terrain(height: FloatArray, step_m: float, limit: RiseLimit, gap_m: float = 0.3) -> BoolArray:
    """Return on which nodes (H, W) of exact heights [m] a rover stands on a rise beyond the limit; tracks bridge gaps narrower than `gap_m`.

    >>> steep_terrain(np.array([[0.0, 0.0, 0.0, 1.0, 1.0, 1.0]]), 0.5, RiseLimit(25.0, 0.5))
    array([[False, False,  True,  True, False, False]])
    """
    n = int(gap_m / step_m + 1e-9) + 1
    closed = grey_closing(height, (n, n))
    return _largest_rise(closed, np.array(_offsets(limit.base_m / step_m))) > limit.rise_m


@cache
def _offsets(reach: float) -> tuple[tuple[int, int], ...]:
    n = int(reach + 1e-9)
    return tuple(
        (south, east)
        for south in range(n + 1)
        for east in range(-n, n + 1)
        if (south, east) > (0, 0) and south**2 + east**2 <= (reach + 1e-9) ** 2
    )


@njit(cache=True, inline="always")
def _beyond(rise: float, variance: float, limits: tuple[float, float]) -> float:
    """Return the probability that a rise that was measured with a variance is beyond the first limit; the second is the common scatter."""
    limit, common = limits
    total = chance = 0.0
    for k in range(2):
        prior = common * common if k == 0 else (_HAZARD_RISES * limit) ** 2
        share = 1.0 - _HAZARD_SHARE if k == 0 else _HAZARD_SHARE
        weight = share * np.exp(-0.5 * rise * rise / (prior + variance)) / np.sqrt(prior + variance)
        gain = prior / (prior + variance)
        spread = np.sqrt(gain * variance)
        total += weight
        chance += weight * 0.5 * math.erfc((limit - gain * rise) / (spread * np.sqrt(2.0)))
    return float(chance / total) if total > 0.0 else 1.0 * (rise > limit)


@njit(cache=True, inline="always")
def _mark_middle(found: FloatArray, a: tuple[int, int], b: tuple[int, int], value: float) -> None:
    """Raise the nodes around the middle between two nodes to a value: a rover stands there with its ends at the two."""
    for v in range((a[0] + b[0]) // 2, (a[0] + b[0] + 1) // 2 + 1):
        for u in range((a[1] + b[1]) // 2, (a[1] + b[1] + 1) // 2 + 1):
            found[v, u] = max(found[v, u], value)


@njit(cache=True)
def _rise_probability(
    height: FloatArray, variance: FloatArray, offsets: IntArray, rise_m: float, common_m: float
) -> FloatArray:
    """Return the largest probability (H, W) that a rise in the middle of which a node lies is beyond the limit."""
    rows, columns = height.shape
    found = np.zeros((rows, columns))
    for j in range(rows):
        for i in range(columns):
            if not np.isfinite(height[j, i]):
                continue
            for k in range(len(offsets)):
                v, u = j + offsets[k, 0], i + offsets[k, 1]
                if v < 0 or u < 0 or v >= rows or u >= columns or not np.isfinite(height[v, u]):
                    continue
                rise = abs(height[j, i] - height[v, u])
                # A rise of a third of the limit is far more likely common ground that was badly seen.
                if rise > rise_m / 3.0:
                    chance = _beyond(rise, variance[j, i] + variance[v, u], (rise_m, common_m))
                    _mark_middle(found, (j, i), (v, u), chance)
    return found


@njit(cache=True)
def _largest_rise(height: FloatArray, offsets: IntArray) -> FloatArray:
    """Return the largest rise (H, W) between two nodes in the middle of which a node lies [m]."""
    rows, columns = height.shape
    found = np.zeros((rows, columns))
    for j in range(rows):
        for i in range(columns):
            for k in range(len(offsets)):
                v, u = j + offsets[k, 0], i + offsets[k, 1]
                if 0 <= v < rows and 0 <= u < columns:
                    _mark_middle(found, (j, i), (v, u), abs(height[j, i] - height[v, u]))
    return found


@njit(cache=True)
def _largest_excess(
    height: FloatArray, sigma: FloatArray, ceiling: FloatArray, offsets: IntArray, rise_m: float
) -> FloatArray:
    """Return by how many standard deviations a rise from below a ceiling, in the middle of which a node (H, W) lies, is beyond the limit."""
    rows, columns = height.shape
    found = np.full((rows, columns), -np.inf)
    for j in range(rows):
        for i in range(columns):
            if not np.isfinite(height[j, i]):
                continue
            for k in range(2 * len(offsets)):
                sign = 1 if k % 2 else -1
                v, u = j + sign * offsets[k // 2, 0], i + sign * offsets[k // 2, 1]
                if v < 0 or u < 0 or v >= rows or u >= columns or not np.isfinite(ceiling[v, u]):
                    continue
                excess = (height[j, i] - ceiling[v, u] - rise_m) / sigma[j, i]
                _mark_middle(found, (j, i), (v, u), excess)
    return found


@njit(cache=True)
def _store(places: FloatArray, z: FloatArray, sigma_m: FloatArray, rings: tuple[Any, Any, Any]) -> None:
    """Put heights into the rings of the nearest nodes; `rings` are heights, counts, and means of the newest ones' variances."""
    height, count, variance = rings
    n_kept, rows, columns = height.shape
    for k in range(len(z)):
        i, j = int(np.floor(places[k, 0] + 0.5)), int(np.floor(places[k, 1] + 0.5))
        if i < 0 or j < 0 or i >= columns or j >= rows:
            continue
        n = count[j, i]
        height[n % n_kept, j, i] = z[k]
        variance[j, i] += (sigma_m[k] ** 2 - variance[j, i]) / min(n + 1, n_kept)
        count[j, i] = n + 1


@njit(cache=True)
def _medians(height: Any, count: Any, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return medians and standard deviations; a spread is known from three returns on, stated errors from one on."""
    n_kept, rows, columns = height.shape
    median, sigma = np.full((rows, columns), np.nan), np.full((rows, columns), np.nan)
    values = np.empty(n_kept)
    for j in range(rows):
        for i in range(columns):
            n = min(count[j, i], n_kept)
            if n < _LEAST_RETURNS:
                continue
            for k in range(n):
                values[k] = height[k, j, i]
            middle = np.median(values[:n])
            spread = _TO_SIGMA * np.median(np.abs(values[:n] - middle)) if n > 2 else 0.0
            median[j, i] = middle
            # Scans of one stretch share the error of their pose: stated variances are not divided by the number.
            sigma[j, i] = np.sqrt(variance[j, i] + (_OF_MEDIAN * spread) ** 2 / n)
    return median, sigma

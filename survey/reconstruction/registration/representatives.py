"""Representative returns: one return for each cell of ground and visit."""

from collections.abc import Iterable, Iterator

import numpy as np

from survey.core.arrays import BoolArray, FloatArray, IntArray
from survey.reconstruction.line_of_sight.ghost_returns import LEAST_M
from survey.reconstruction.registration.config import ScanPointsConfig
from survey.reconstruction.registration.registered_scans import RegisteredReturns

_STRETCH_M = 5.0
# Views of one place that are closer to each other on the way share the errors of the path.
_VISIT_M = 40.0
# A vehicle that stands still scans the same ground; the memory of a stretch is bounded by this number of scans.
_MOST_SCANS = 50
_SIGMAS, _QUARTILES_TO_SIGMA = 4.0, 1.349


def representatives_of_stretches(
    scans: Iterable[RegisteredReturns], config: ScanPointsConfig
) -> Iterator[RegisteredReturns]:
    """Yield, for each stretch of 5 m of the way or 50 scans, one return for each cell that has enough of them.

    It is the one nearest to the middle of the cell's returns, of those whose height is usual among them. Its height does
    not decide, so that the points have the relief of the ground: returns of median height would have less of it, and a
    map of them would claim too small an error.
    """
    stretch: list[RegisteredReturns] = []
    travelled_m, last = 0.0, None
    for scan in scans:
        place = scan.origin[0]
        travelled_m += 0.0 if last is None else float(np.linalg.norm(place - last))
        last = place
        if stretch and (travelled_m >= _STRETCH_M or len(stretch) == _MOST_SCANS):
            yield _representatives(RegisteredReturns.joined(stretch), config)
            stretch, travelled_m = [], 0.0
        stretch.append(scan)
    if stretch:
        yield _representatives(RegisteredReturns.joined(stretch), config)


def _representatives(returns: RegisteredReturns, config: ScanPointsConfig) -> RegisteredReturns:
    """Return the return of usual height nearest to the middle of the others in each cell."""
    order, first, count = _by_cell(returns.xyz[:, :2], returns.xyz[:, 2], config.cell_m)
    xyz, cell = returns.xyz[order], np.repeat(np.arange(len(first)), count)
    middle = np.column_stack([np.bincount(cell, axis) / count for axis in xyz[:, :2].T])
    away_m = np.hypot(*(xyz[:, :2] - middle[cell]).T)
    nearest = np.lexsort((away_m, ~_usual(xyz[:, 2], first, count), cell))[first]
    enough = count >= config.least_returns
    return returns.select(order[nearest[enough]])._replace(n_returns=count[enough])


def _usual(height: FloatArray, first: IntArray, count: IntArray) -> BoolArray:
    """Return which heights, in order within each cell, lie within 0.3 m or four standard deviations of its median."""
    lower, middle, upper = (height[first + (share * count) // 4] for share in (1, 2, 3))
    allowed = np.maximum(LEAST_M, _SIGMAS * (upper - lower) / _QUARTILES_TO_SIGMA)
    usual: BoolArray = np.abs(height - np.repeat(middle, count)) <= np.repeat(allowed, count)
    return usual


def best_of_visits(returns: RegisteredReturns, cell_m: float) -> IntArray:
    """Return the numbers of the return, of those in order of time, that stands for the most others in each cell and visit.

    These are near ones as a rule. Blown snow above ground that the scanner does not see gives few. A visit ends where a
    cell is not seen over 40 m of the way.
    """
    steps = np.r_[0.0, np.linalg.norm(np.diff(returns.origin, axis=0), axis=1)]
    travel = np.cumsum(steps)
    order, first, _ = _by_cell(returns.xyz[:, :2], travel, cell_m)
    begins = np.zeros(len(order), dtype=np.bool_)
    begins[first] = True
    begins[1:] |= np.diff(travel[order]) > _VISIT_M
    visit = np.cumsum(begins)
    best = np.lexsort((returns.range_m[order], -returns.n_returns[order], visit))
    chosen = best[np.r_[True, np.diff(visit[best]) > 0]]
    return np.sort(order[chosen])


def thinned(returns: RegisteredReturns, config: ScanPointsConfig) -> RegisteredReturns:
    """Return the best returns of all visits, in cells that grow until there are no more than wanted."""
    returns = returns.select(np.argsort(returns.time_s, kind="stable"))
    cell_m = config.cell_m
    while len(chosen := best_of_visits(returns, cell_m)) > config.most_points:
        cell_m *= max(1.05, float(np.sqrt(len(chosen) / config.most_points)))
    return returns.select(chosen)


def _by_cell(xy: FloatArray, then: FloatArray, cell_m: float) -> tuple[IntArray, IntArray, IntArray]:
    """Return the order of points by their cell and by another value, and first place and number of each cell's."""
    cell = np.floor((xy - xy.min(axis=0)) / cell_m).astype(np.int64)
    key = cell[:, 0] * (int(cell[:, 1].max()) + 1) + cell[:, 1]
    order = np.lexsort((then, key))
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    return order, first, count

"""Covariances of many pairs of near points, looked up by their distance.

Neighbourhoods of a few hundred points need a covariance for each pair, for millions of neighbourhoods the same function of
one distance. A cubic spline between its values costs a fraction of exponentials and Bessel functions.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numba import njit
from scipy.interpolate import CubicSpline

from survey.core import FloatArray
from survey.reconstruction.gp.families import parts_of
from survey.reconstruction.gp.kernels import Kernel, Stationary

_N_CELLS = 8192
# Cells to the shortest length scale. The spline then errs by less than 1e-5 of the variance for Whittle's kernel, whose second
# derivative is infinite at 0, and by less than 1e-9 for the others.
_FEWEST_TO_LENGTH = 100


@dataclass(frozen=True)
class CovarianceTable:
    """Covariances of a kernel, looked up by the distance in the metric that all its parts share.

    Exact ones where they share none, and where distances are so many length scales that a table would be coarse.
    """

    kernel: Kernel

    def among(self, xy: FloatArray) -> FloatArray:
        """Return the covariance (N, N) [m²] of places (N, 2) [m] in column order; only its lower triangle is meant."""
        places = self._stretched(xy)
        reach_m = _reach_m(places)
        if not self._is_fine(reach_m):
            return self.kernel.covariance(xy, xy).T
        return _look_up_pairs(places, _table(self.kernel, reach_m), _N_CELLS / reach_m).T

    def between(self, xy: FloatArray, others: FloatArray) -> FloatArray:
        """Return the covariance (N, M) [m²] between places (N, 2) and (M, 2) [m], in column order."""
        places = self._stretched(np.concatenate([xy, others]))
        reach_m = _reach_m(places)
        if not self._is_fine(reach_m):
            return self.kernel.covariance(others, xy).T
        n, table = len(xy), _table(self.kernel, reach_m)
        return _look_up(places[n:], places[:n], table, _N_CELLS / reach_m).T

    def _stretched(self, xy: FloatArray) -> FloatArray:
        """Return places (N, 2) along the axes of the anisotropy, stretched so that their plain distances count."""
        if not self._parts or self._parts[0].anisotropy == 1.0:
            return xy
        return self._parts[0].stretched(xy)

    def _is_fine(self, reach_m: float) -> bool:
        """Return whether a table of distances is fine beside the shortest length scale."""
        shortest_m = min((part.length_scale_m for part in self._parts), default=0.0)
        return reach_m * _FEWEST_TO_LENGTH <= shortest_m * _N_CELLS

    @cached_property
    def _parts(self) -> list[Stationary]:
        """The parts of the kernel where they share one metric, or none."""
        parts = [part for part in parts_of(self.kernel) if isinstance(part, Stationary)]
        metrics = {(part.anisotropy, part.anisotropy != 1.0 and part.angle_deg) for part in parts}
        return parts if len(metrics) == 1 and len(parts) == len(parts_of(self.kernel)) else []


def _reach_m(places: FloatArray) -> float:
    """Return a power of two above every distance between places [m], so that few tables are needed."""
    diagonal = max(float(np.hypot(*np.ptp(places, axis=0))), 1e-6)
    return float(2.0 ** (np.floor(np.log2(diagonal)) + 1.0))


@lru_cache(maxsize=16)
def _table(kernel: Kernel, reach_m: float) -> FloatArray:
    """Return the coefficients (8192, 4) of the covariance within each cell of the distance, from 0 to 1 of the cell."""
    distance_m = np.linspace(0.0, reach_m, _N_CELLS + 1)
    values = np.sum(
        [
            part.covariance_of_squared(distance_m**2)
            for part in parts_of(kernel)
            if isinstance(part, Stationary)
        ],
        axis=0,
    )
    spline = CubicSpline(np.arange(_N_CELLS + 1.0), values)
    return np.ascontiguousarray(spline.c[::-1].T)


@njit(cache=True)
def _look_up(a: FloatArray, b: FloatArray, table: FloatArray, cells_per_m: float) -> FloatArray:
    """Return the covariance (A, B) between places."""
    covariance = np.empty((len(a), len(b)))
    for i in range(len(a)):
        _look_up_row(a[i], b, table, cells_per_m, covariance[i])
    return covariance


@njit(cache=True)
def _look_up_pairs(a: FloatArray, table: FloatArray, cells_per_m: float) -> FloatArray:
    """Return the upper triangle of the covariance (A, A) of places."""
    covariance = np.empty((len(a), len(a)))
    for i in range(len(a)):
        _look_up_row(a[i], a[i:], table, cells_per_m, covariance[i, i:])
    return covariance


@njit(cache=True)
def _look_up_row(
    place: FloatArray, others: FloatArray, table: FloatArray, cells_per_m: float, row: FloatArray
) -> None:
    for j in range(len(others)):
        east, north = others[j, 0] - place[0], others[j, 1] - place[1]
        at = np.sqrt(east * east + north * north) * cells_per_m
        cell = int(at)
        u = at - cell
        row[j] = table[cell, 0] + u * (table[cell, 1] + u * (table[cell, 2] + u * table[cell, 3]))

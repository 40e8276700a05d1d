"""Structures of a variogram: spherical, Gaussian and Matérn, and their selection for an empirical variogram."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from survey.core.arrays import FloatArray

_N_RANGES = 24
_MOST_STRUCTURES = 5
# Ranges beyond the largest observed lag cannot be estimated.
_LONGEST = 1.5


def _spherical(s: FloatArray) -> FloatArray:
    near = np.minimum(s, 1.0)
    result: FloatArray = 1.5 * near - 0.5 * near**3
    return result


def _gaussian(s: FloatArray) -> FloatArray:
    return -np.expm1(-3.0 * s**2)


def _matern(s: FloatArray) -> FloatArray:
    """Return the Matérn correlation of smoothness 3/2."""
    at = 4.744 * s
    result: FloatArray = 1.0 - (1.0 + at) * np.exp(-at)
    return result


SHAPES: dict[str, Callable[[FloatArray], FloatArray]] = {
    "spherical": _spherical,
    "gaussian": _gaussian,
    "matern-3/2": _matern,
}
"""Structures of sill 1, by the lag over the range, at which they reach all, or 95 %, of their sill."""


class Structure(NamedTuple):
    """Structure of a variogram.

    Parameters
    ----------
    family : {"spherical", "gaussian", "matern-3/2"}
        Its shape: linear at short lags, or smooth.
    range_m : float
        Distance at which it reaches its sill, or 95 % of it where it has no end [m].
    sill_m2 : float
        Its variance [m²].
    """

    family: str
    range_m: float
    sill_m2: float = 1.0

    def at(self, lag_m: FloatArray) -> FloatArray:
        """Return its part of the variogram at the distances [m], as [m²].

        Parameters
        ----------
        lag_m : ndarray
            Distances [m].

        Returns
        -------
        ndarray
            Of the shape of `lag_m` [m²].
        """
        shape = SHAPES[self.family]
        gamma: FloatArray = self.sill_m2 * shape(lag_m / self.range_m)
        return gamma

    def correlation(self, lag_m: FloatArray) -> FloatArray:
        """Return its correlation at the distances [m].

        Parameters
        ----------
        lag_m : ndarray
            Distances [m].

        Returns
        -------
        ndarray
            Of the shape of `lag_m`.
        """
        correlation: FloatArray = 1.0 - SHAPES[self.family](lag_m / self.range_m)
        return correlation


def fitted(
    lags: FloatArray, gamma: FloatArray, weight: FloatArray, shortest_m: float
) -> tuple[float, tuple[Structure, ...]]:
    """Return the nugget [m²] and the structures that explain an empirical variogram.

    Structures of all families over a ladder of ranges are added one at a time, the one that explains most
    first, with all sills by non-negative least squares; until the next one would not lower the Bayesian
    information criterion. Structures that chance alone suggests are thus left out: a long range of a
    thousandth of the variance would decide the error of a mean.

    Parameters
    ----------
    lags, gamma, weight : (B,) ndarray
        Mean distance [m], half the mean squared difference [m²], and weight of the bins.
    shortest_m : float
        Shortest range [m].
    """
    ranges = np.geomspace(shortest_m, _LONGEST * max(lags[-1], shortest_m), _N_RANGES)
    tried = [Structure(family, float(reach)) for family in SHAPES for reach in ranges]
    columns = np.column_stack([np.ones_like(lags), *(one.at(lags) for one in tried)]) * weight[:, None]
    used, sills = _selected(columns, gamma * weight)
    found = [
        tried[k - 1]._replace(sill_m2=float(sill))
        for k, sill in zip(used[1:], sills[1:], strict=True)
        if sill > 0.0
    ]
    return float(sills[0]), tuple(sorted(found, key=lambda one: one.range_m))


def _selected(columns: FloatArray, values: FloatArray) -> tuple[list[int], FloatArray]:
    """Return the columns used, the nugget first, and their sills, by forward selection."""
    n, used = len(values), [0]
    sills, misfit = _sills(columns, used, values)
    while len(used) <= _MOST_STRUCTURES:
        others: Sequence[int] = [k for k in range(1, columns.shape[1]) if k not in used]
        found = [_sills(columns, [*used, k], values) for k in others]
        best = int(np.argmin([left for _, left in found]))
        # A structure has a sill and a range: n log of the squared misfit has to fall by 2 log n.
        if n * np.log(max(misfit, 1e-300) / max(found[best][1], 1e-300)) < np.log(n):
            break
        used.append(others[best])
        sills, misfit = found[best]
    return used, sills


def _sills(columns: FloatArray, used: list[int], values: FloatArray) -> tuple[FloatArray, float]:
    """Return sills of 0 or more and the misfit that they leave; the matrix is small enough for any rounding."""
    sills, misfit = nnls(columns[:, used], values, maxiter=100 * len(used))
    return sills, float(misfit)

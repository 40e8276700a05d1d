"""Variogram of the errors of an elevation difference, estimated on unchanged ground.

A `Variogram` is a nugget and a sum of spherical, Gaussian and Matérn 3/2 structures. The empirical variogram
comes from the autocorrelation of the known cells by FFT; `fit_variogram` selects as few structures as explain its
bins. `SumErrors` gives the standard deviation of a weighted sum of correlated errors, with Satterthwaite's
(1946) degrees of freedom for the 95 % interval by Student's t.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.optimize import nnls
from scipy.special import stdtrit

from survey.core import BoolArray, FloatArray, InputError

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

    `family`: its shape: linear at short lags, or smooth. `range_m`: distance at which it reaches its sill, or
    95 % of it where it has no end [m]. `sill_m2`: its variance [m²].
    """

    family: str
    range_m: float
    sill_m2: float = 1.0

    def at(self, lag_m: FloatArray) -> FloatArray:
        """Return its part of the variogram at the distances [m], as [m²].

        `lag_m`: distances [m]. Returns: of the shape of `lag_m` [m²].
        """
        shape = SHAPES[self.family]
        gamma: FloatArray = self.sill_m2 * shape(lag_m / self.range_m)
        return gamma

    def correlation(self, lag_m: FloatArray) -> FloatArray:
        """Return its correlation at the distances [m].

        `lag_m`: distances [m].
        """
        correlation: FloatArray = 1.0 - SHAPES[self.family](lag_m / self.range_m)
        return correlation


def fit_variogram(
    lags: FloatArray, gamma: FloatArray, weight: FloatArray, shortest_m: float
) -> tuple[float, tuple[Structure, ...]]:
    """Return the nugget [m²] and the structures that explain an empirical variogram.

    Structures of all families over a ladder of ranges are added one at a time, the one that explains most
    first, with all sills by non-negative least squares; until the next one would not lower the Bayesian
    information criterion. Structures that chance alone suggests are thus left out: a long range of a
    thousandth of the variance would decide the error of a mean.

    `lags`, `gamma`, `weight` (B,): mean distance [m], half the mean squared difference [m²], and weight of
    the bins. `shortest_m`: shortest range [m].
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


LARGEST_CELLS = 16_000_000
"""Rasters beyond this are thinned or cut before their variogram is taken."""
_N_LEAST = 100
_N_BINS = 30
# Pairs farther apart than this share of the known ground's extent are too few and too alike to estimate a variogram from.
_FARTHEST_SHARE = 0.5


@dataclass(frozen=True)
class Variogram:
    r"""A nugget and structures of several families and ranges.

    .. math::  \gamma(h) = c_0\,[h > 0] + \sum_k c_k \, g_k(h / a_k)

    `nugget_m2`: variance of what is independent from cell to cell [m²]. `structures` (K,): spherical ones,
    linear at short lags, and smooth ones, Gaussian and Matérn 3/2.
    """

    nugget_m2: float
    structures: tuple[Structure, ...] = ()

    @property
    def variance_m2(self) -> float:
        """Variance of one cell's error [m²]."""
        return self.nugget_m2 + sum(structure.sill_m2 for structure in self.structures)

    def at(self, lag_m: FloatArray) -> FloatArray:
        """Return half the mean square difference of two cells at the distances [m], as [m²].

        `lag_m`: distances [m]. Returns: of the shape of `lag_m` [m²].
        """
        gamma: FloatArray = np.where(lag_m > 0.0, self.nugget_m2, 0.0)
        for structure in self.structures:
            gamma = gamma + structure.at(lag_m)
        return gamma

    def covariance(self, lag_m: FloatArray) -> FloatArray:
        """Return the covariance of the errors of two cells at the distances [m], as [m²].

        `lag_m`: distances [m]. Returns: of the shape of `lag_m` [m²].
        """
        return self.variance_m2 - self.at(lag_m)

    @classmethod
    def of(cls, difference: FloatArray, known: BoolArray, step_m: float) -> Self:
        """Learn from a raster of errors (H, W) [m] on the cells that are known.

        Every pair of cells counts, by their Fourier transforms; bins of distance are as wide
        as they are far, so that the number of pairs in a bin grows as its independent pairs grow fewer, and all
        weigh alike relative to their value.

        `difference` (H, W): errors [m]; any value where not known. `known` (H, W) bool: cells to use.
        `step_m`: width of a cell, the unit of the distances [m].

        Errors that are correlated over more than half the known ground cannot be separated from a
        common offset and are not included. Remove blunders first.

        >>> white = np.random.default_rng(1).normal(0.0, 0.5, (60, 60))
        >>> variogram = Variogram.of(white, np.ones((60, 60), dtype=bool), 2.0)
        >>> bool(abs(variogram.variance_m2 - 0.25) < 0.02)
        True
        """
        n = int(known.sum())
        if n < _N_LEAST:
            raise InputError(
                f"{n} cells of unchanged ground are known; {_N_LEAST} are needed to learn how errors go together."
            )
        lags, gamma, weight = _empirical(difference, known, step_m)
        return cls(*fit_variogram(lags, gamma, weight, 2.0 * step_m))


@dataclass(frozen=True)
class ErrorOfSum:
    """Standard deviation of a weighted sum of errors, and the degrees of freedom behind its estimate."""

    std: float
    n_free: float

    @property
    def half_width_95(self) -> float:
        """Half the 95 % interval: Student's t, for the standard deviation is itself estimated."""
        return float(stdtrit(max(self.n_free, 1.0), 0.975)) * self.std


class SumErrors:
    r"""Errors of weighted sums of a raster's errors, with their correlation.

    .. math::  \operatorname{var} \sum_i w_i e_i = \sum_{ij} w_i w_j \, C(|x_i - x_j|) = \sum_k v_k, \qquad
               \nu = \Big(\frac{\sum_k v_k}{\sum_k v_k / \sqrt{\nu_k}}\Big)^2, \qquad
               \nu_k = \frac{n^2 C_k(0)^2}{\sum_{ij} C_k(|x_i - x_j|)^2}

    over all pairs of cells exactly, by Fourier transforms; k runs over the structures of the
    variogram, and ν is Satterthwaite's (1946) number of degrees of freedom: how many
    independent errors of each range the n cells have shown from which the variogram was learnt.
    The sills of one fit err together, so that their deviations add up, not their variances.

    `variogram`: of the errors. `estimated_on` (H, W) bool: the cells that it was estimated on. `step_m`: width of a
    cell [m].
    """

    def __init__(self, variogram: Variogram, estimated_on: BoolArray, step_m: float) -> None:
        self._shape = _padded(estimated_on.shape)
        self._n = float(estimated_on.sum())
        lags = _lag_lengths(self._shape, step_m)
        cells = self._power(estimated_on.astype(np.float64))
        self._variance_m2 = variogram.variance_m2
        self._parts: list[tuple[float, FloatArray, float]] = []
        correlation = np.zeros_like(lags)
        structures = [(variogram.nugget_m2, None), *((one.sill_m2, one) for one in variogram.structures)]
        for sill, structure in structures:
            rho = np.where(lags > 0.0, 0.0, 1.0) if structure is None else structure.correlation(lags)
            n_free = self._n**2 / float((cells * self._spectrum(rho**2)).sum())
            self._parts.append((sill, self._spectrum(rho), n_free))
            correlation += sill / max(self._variance_m2, 1e-300) * rho
        bounded = np.clip(correlation, -1.0, 1.0)
        self._excess = self._spectrum(np.arcsin(bounded) - bounded)

    def of(self, weights: FloatArray) -> ErrorOfSum:
        """Return the error of the sum of the errors weighted by (H, W).

        Where the weights add up to 0 (the mean of a glacier less that of the ground around it), what all cells share
        cancels.

        >>> all_cells = np.ones((3, 3), dtype=bool)
        >>> SumErrors(Variogram(4.0), all_cells, 1.0).of(all_cells / 9.0)
        ErrorOfSum(std=0.667, n_free=9.0)
        """
        power = self._power(weights)
        parts = np.array([max(0.0, sill * float((power * rho).sum())) for sill, rho, _ in self._parts])
        free = np.array([n_free for *_, n_free in self._parts])
        variance = float(parts.sum())
        if variance == 0.0:
            return ErrorOfSum(0.0, self._n)
        return ErrorOfSum(float(np.sqrt(variance)), (variance / float((parts / np.sqrt(free)).sum())) ** 2)

    def median_excess_m(self, weights: FloatArray) -> float:
        r"""Return the standard deviation that a median has beyond the mean with the weights (H, W) [m].

        .. math::  \operatorname{var}(median) - \operatorname{var}(mean)
                   = C(0) \sum_{ij} w_i w_j \, (\arcsin \rho_{ij} - \rho_{ij})

        for normal errors of correlation ρ, because signs of errors have the covariance (2 / π) arcsin ρ (Sheppard 1899).
        The median's error is as correlated with all other errors as the mean's, so that this part is independent of them.

        >>> all_cells = np.ones((20, 20), dtype=bool)
        >>> excess_m = SumErrors(Variogram(4.0), all_cells, 1.0).median_excess_m(all_cells / 400.0)
        >>> round(400.0 * (excess_m**2 + 4.0 / 400.0) / 4.0, 3)
        1.571
        """
        return float(
            np.sqrt(max(self._variance_m2 * float((self._power(weights) * self._excess).sum()), 0.0))
        )

    def _power(self, raster: FloatArray) -> FloatArray:
        """Return the power spectrum, scaled so that its product with `_spectrum` sums up over pairs of cells."""
        power = np.abs(rfft2(raster, self._shape)) ** 2
        # Half of the spectrum is held; the columns that stand for both halves count twice.
        twice = np.full(power.shape[1], 2.0)
        twice[0] = 1.0
        if self._shape[1] % 2 == 0:
            twice[-1] = 1.0
        scaled: FloatArray = power * (twice / (self._shape[0] * self._shape[1]))
        return scaled

    def _spectrum(self, of_lags: FloatArray) -> FloatArray:
        """Return the Fourier transform of an even function of the lag, which is real."""
        spectrum: FloatArray = rfft2(of_lags).real
        return spectrum


def _padded(shape: tuple[int, ...]) -> tuple[int, int]:
    rows, columns = (next_fast_len(2 * n - 1, real=True) for n in shape)
    return rows, columns


def _lag_lengths(shape: tuple[int, int], step_m: float) -> FloatArray:
    rows, columns = (np.minimum(np.arange(n), n - np.arange(n)) for n in shape)
    lengths: FloatArray = step_m * np.hypot(rows[:, None], columns[None, :])
    return lengths


def _empirical(
    difference: FloatArray, known: BoolArray, step_m: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the mean lag, γ and weight of each bin, over all pairs of known cells."""
    mask = known.astype(np.float64)
    z = np.where(known, difference - difference[known].mean(), 0.0)
    shape = _padded(z.shape)
    f_mask, f_z, f_square = (rfft2(a, shape) for a in (mask, z, z * z))
    pairs = irfft2(f_mask * f_mask.conj(), shape)
    squares = irfft2(2.0 * (f_square * f_mask.conj()).real - 2.0 * (f_z * f_z.conj()).real, shape)
    lags = _lag_lengths(shape, step_m)
    rows, columns = np.nonzero(known.any(axis=1))[0], np.nonzero(known.any(axis=0))[0]
    extent_m = step_m * float(np.hypot(np.ptp(rows) + 1, np.ptp(columns) + 1))
    edges = _edges(step_m, _FARTHEST_SHARE * extent_m)
    use = (pairs > 0.5) & (lags > 0.0) & (lags < edges[-1])
    index = np.digitize(lags[use], edges) - 1
    n_pairs, total, reach = (
        np.bincount(index, weights, minlength=len(edges) - 1)
        for weights in (pairs[use], squares[use], pairs[use] * lags[use])
    )
    filled = n_pairs > 0.5
    gamma = 0.5 * total[filled] / n_pairs[filled]
    # The value of a bin scatters in proportion to itself, more where its pairs are few.
    weight = 1.0 / np.maximum(gamma, 1e-12 + 1e-6 * gamma.max())
    return reach[filled] / n_pairs[filled], np.maximum(gamma, 0.0), weight


def _edges(step_m: float, farthest_m: float) -> FloatArray:
    """Return the edges of the bins of distance: every step at first, then growing."""
    return np.geomspace(0.5 * step_m, max(farthest_m, 4.0 * step_m), _N_BINS + 1)

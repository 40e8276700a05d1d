r"""Kernels of many surveys that sampled the same places: searched on a lattice that all of them share.

A covariance is a cell of the lattice: a family, a length scale and the ratio q of noise variance to
terrain variance. Everything expensive, the factorization of

.. math::  C = \rho_\ell(X, X) + q I = L L^T,

depends on the places X and on the cell alone, so it is done once for all surveys; their heights are the
columns of one matrix. The variance of the terrain follows from each survey in closed form, with a
constant mean μ integrated out:

.. math::  \hat s^2 = \frac{(y - \mu)^T C^{-1} (y - \mu)}{n - 1}, \qquad
           -2 \log p = (n - 1) \log \hat s^2 + \log |C| + \log 1^T C^{-1} 1 + \mathrm{const}

(glacier paper, Eq. 9; restricted likelihood, Patterson and Thompson 1971).
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from scipy.linalg import lapack
from scipy.spatial.distance import cdist

from survey.arrays import BoolArray, FloatArray, IntArray
from survey.errors import InputError
from survey.reconstruction.gp.kernels import Kernel, Matern32, Matern52, SquaredExponential, Whittle
from survey.reconstruction.gp.stationary import Stationary

Family = Literal["squared-exponential", "matern-5/2", "matern-3/2", "whittle"]

SEARCHED: tuple[Family, ...] = ("squared-exponential", "matern-5/2", "matern-3/2")
"""Families that a search compares unless told otherwise."""

ALL: tuple[Family, ...] = (*SEARCHED, "whittle")
"""Every family that can be searched, the smoothest first."""

_KINDS: dict[Family, type[Stationary]] = {
    "squared-exponential": SquaredExponential,
    "matern-5/2": Matern52,
    "matern-3/2": Matern32,
    "whittle": Whittle,
}
_PER_DOUBLING = 4
"""Length scales of the lattice per doubling."""
_LEAST_RATIO = -28
"""Exponent of 2 of the least ratio of variances: a perfect sensor errs by 0.3 mm where the terrain varies by 5 m."""
_MOST_SEARCHED = 160
"""Places from which a kernel is learned; more change the length scale by less than a step of the lattice."""
_NOISE_DOUBT = 0.2
"""How far the real noise may lie from the stated one: one standard deviation of its logarithm."""
_COARSE = (4, 3)
_FINE = ((2, 1), (1, 1))
_WITHIN = 6.0
"""Families this much less likely than the best [nats] are searched no further."""


class Cell(NamedTuple):
    """A covariance up to its variance: family, length scale 2^(length/4) m, ratio 2^ratio."""

    family: Family
    length: float
    ratio: float

    @classmethod
    def of(cls, family: Family, length_scale_m: float, ratio: float) -> "Cell":
        """Return the cell of a given covariance; its length scale and ratio need not lie on the lattice."""
        length = _PER_DOUBLING * float(np.log2(length_scale_m))
        return cls(family, length, max(float(np.log2(max(ratio, 1e-300))), _LEAST_RATIO))

    @property
    def length_scale_m(self) -> float:
        """Length scale [m]."""
        return float(2.0 ** (self.length / _PER_DOUBLING))

    def kernel(self, variance_m2: float) -> Stationary:
        """Return the covariance function with this variance."""
        return _KINDS[self.family](variance_m2, self.length_scale_m)

    def correlation(self, squared_m2: FloatArray) -> FloatArray:
        """Return the correlation at squared distances [m²]."""
        return self.kernel(1.0)._correlation(squared_m2 / self.length_scale_m**2)

    def factor(self, xy: FloatArray) -> FloatArray | None:
        """Return the lower factor L (N, N) of the samples' correlation, or None where rounding makes it indefinite."""
        matrix = np.empty((len(xy), len(xy)))
        for rows in _blocks(len(xy)):
            # The factorization reads one triangle alone.
            matrix[rows, rows.start :] = self.correlation(cdist(xy[rows], xy[rows.start :], "sqeuclidean"))
        matrix[np.diag_indices(len(xy))] += 2.0**self.ratio
        return _factorized(matrix)


@dataclass(frozen=True)
class Likelihood:
    """Log likelihood (B,) and terrain variance (B,) [m²] of one cell, survey by survey."""

    log: FloatArray
    variance_m2: FloatArray


_Wish = tuple[Cell, BoolArray]
"""A cell, and the surveys (B,) that want it looked at."""


@dataclass(frozen=True)
class FoundKernel:
    """The likeliest covariance of one survey: its cell, and the terrain's variance [m²]."""

    cell: Cell
    variance_m2: float

    @property
    def kernel(self) -> Kernel:
        """The covariance function [m²]."""
        return self.cell.kernel(self.variance_m2)

    @property
    def noise_m(self) -> float:
        """Standard deviation of a sample that goes with it [m]."""
        return float(np.sqrt(2.0**self.cell.ratio * self.variance_m2))


@dataclass(eq=False)
class KernelSearch:
    """Looks for the kernels of B surveys that sampled the same N places.

    Parameters
    ----------
    xy : (N, 2) ndarray
        Places [m].
    heights : (N, B) ndarray
        What each survey measured there [m].
    noise_m : float
        Stated standard deviation of a measurement [m]; the fit may depart from it by some 20 %.
        0 is a perfect sensor.
    families : tuple of str
        What to compare.

    Notes
    -----
    Isotropic families of one scale only. The lattice has four length scales per doubling and
    ratios in powers of two; no survey's result depends on which others are searched with it.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> xy = rng.uniform(0.0, 600.0, (120, 2))
    >>> drawn = np.linalg.cholesky(SquaredExponential(9.0, 100.0).covariance(xy, xy) + 1e-4 * np.eye(120))
    >>> found = KernelSearch(xy, drawn @ rng.standard_normal((120, 2)), noise_m=0.01).found()
    >>> [(one.cell.family, round(one.cell.length_scale_m)) for one in found]
    [('squared-exponential', 91), ('squared-exponential', 108)]
    """

    xy: FloatArray
    heights: FloatArray
    noise_m: float
    families: tuple[Family, ...] = SEARCHED
    seen: dict[Cell, Likelihood] = field(default_factory=dict, repr=False)
    _asked: dict[Cell, BoolArray] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        if len(self.xy) < 3:
            raise InputError(f"{len(self.xy)} samples cannot tell a covariance; take more of them.")
        if not set(self.families) <= set(_KINDS):
            raise InputError(
                f"a search knows the families {', '.join(_KINDS)}, not {', '.join(self.families)}; name some of these."
            )

    def found(self) -> list[FoundKernel]:
        """Return the likeliest kernel of each survey."""
        self._look(self._coarse())
        for steps in _FINE:
            while self._look(self._neighbours(steps)):
                pass
        best, _ = self._best(self.families)
        return [FoundKernel(cell, float(self.seen[cell].variance_m2[b])) for b, cell in enumerate(best)]

    def plausible(self, within: float = 4.0) -> list[tuple[FoundKernel, float]]:
        """Return the kernels of the first survey that are nearly as likely as its best, with weights that sum to 1.

        Parameters
        ----------
        within : float
            How much less likely than the best one [nats].
        """
        self.found()
        while self._look(self._around(within)):
            pass
        # Every second length and every ratio: the lattice of equal spacing that all were searched on.
        even = [cell for cell in self.seen if cell.length % 2 == 0]
        logs = np.array([self.seen[cell].log[0] for cell in even])
        weights = np.exp(logs - logs.max())
        kept = [
            (FoundKernel(cell, float(self.seen[cell].variance_m2[0])), float(weight))
            for cell, weight in zip(even, weights, strict=True)
            if weight > np.exp(-within)
        ]
        total = sum(weight for _, weight in kept)
        return [(found, weight / total) for found, weight in sorted(kept, key=lambda pair: -pair[1])]

    @cached_property
    def _part(self) -> FloatArray:
        """Heights (n, B) about their mean at the places searched."""
        part = self.heights[self._chosen]
        centred: FloatArray = part - part.mean(axis=0)
        return centred

    @cached_property
    def _squared_m2(self) -> FloatArray:
        xy = self.xy[self._chosen]
        squared: FloatArray = cdist(xy, xy, "sqeuclidean")
        return squared

    @cached_property
    def _chosen(self) -> IntArray:
        indices: IntArray = np.linspace(0, len(self.xy) - 1, min(len(self.xy), _MOST_SEARCHED)).astype(int)
        return indices

    @cached_property
    def _lengths(self) -> tuple[int, int]:
        """First and last length scale: from a thirtieth of the extent to twice it."""
        extent = float(np.ptp(self.xy, axis=0).max())
        low, high = (round(_PER_DOUBLING * np.log2(share * extent)) for share in (1.0 / 30.0, 2.0))
        return low, high

    @cached_property
    def _ratios(self) -> IntArray:
        """First and last ratio (2, B): the stated noise beside a terrain from 1/8 to 256 times as variable as the samples."""
        n_surveys = self.heights.shape[1]
        if self.noise_m == 0.0:
            return np.full((2, n_surveys), _LEAST_RATIO)
        spread = np.maximum(self._part.var(axis=0), 1e-12)
        middle = np.floor(np.log2(self.noise_m**2 / spread)).astype(np.int64)
        limits: IntArray = np.clip(np.stack([middle - 8, middle + 3]), _LEAST_RATIO, 3)
        return limits

    def _coarse(self) -> Iterator[_Wish]:
        low, high = self._lengths
        step_l, step_q = _COARSE
        first, last = self._ratios
        for family in self.families:
            for length in range(low - low % step_l, high + 1, step_l):
                for ratio in range(first.min() // step_q * step_q, last.max() + step_q, step_q):
                    at = min(max(ratio, _LEAST_RATIO), 3)
                    yield Cell(family, length, at), (first - step_q < at) & (at < last + step_q)

    def _neighbours(self, steps: tuple[int, int]) -> Iterator[_Wish]:
        """Cells around the best one of every family that is still in the race, for each survey its own."""
        found = [self._best((family,)) for family in self.families]
        most = np.max([logs for _, logs in found], axis=0)
        for best, logs in found:
            for cell in dict.fromkeys(best):
                mine = np.array([one == cell for one in best]) & (logs > most - _WITHIN)
                if mine.any():
                    yield from ((beside, mine) for beside in self._beside(cell, *steps))

    def _around(self, within: float) -> Iterator[_Wish]:
        most = max(seen.log[0] for seen in self.seen.values())
        everyone = np.ones(self.heights.shape[1], dtype=bool)
        for cell in [c for c, s in self.seen.items() if s.log[0] > most - within]:
            odd = cell.length % 2
            for length in (cell.length - odd, cell.length + odd):
                even = cell._replace(length=length)
                yield even, everyone
                yield from ((beside, everyone) for beside in self._beside(even, 2, 1))

    def _beside(self, cell: Cell, step_l: int, step_q: int) -> Iterator[Cell]:
        low, high = self._lengths
        first, last = self._ratios
        for d_length, d_ratio in ((-step_l, 0), (step_l, 0), (0, -step_q), (0, step_q)):
            length, ratio = cell.length + d_length, cell.ratio + d_ratio
            if low <= length <= high and first.min() <= ratio <= last.max():
                yield Cell(cell.family, length, ratio)

    def _look(self, wishes: Iterable[_Wish]) -> bool:
        """Evaluate cells for the surveys that want them; tell whether one saw something new."""
        news = False
        for cell, mine in list(wishes):
            if cell not in self.seen:
                self.seen[cell], self._asked[cell] = self._likelihood(cell), np.zeros_like(mine)
            news |= bool((mine & ~self._asked[cell]).any())
            self._asked[cell] |= mine
        return news

    def _best(self, families: tuple[Family, ...]) -> tuple[list[Cell], FloatArray]:
        """Return each survey's best cell among those that it asked for, and how likely it is."""
        cells = [cell for cell in self.seen if cell.family in families]
        logs = np.array([np.where(self._asked[cell], self.seen[cell].log, -np.inf) for cell in cells])
        return [cells[index] for index in logs.argmax(axis=0)], logs.max(axis=0)

    def _likelihood(self, cell: Cell) -> Likelihood:
        y = self._part
        n, n_surveys = y.shape
        matrix = cell.correlation(self._squared_m2)
        matrix[np.diag_indices(n)] += 2.0**cell.ratio
        factor = _factorized(matrix)
        if factor is None:
            return Likelihood(np.full(n_surveys, -np.inf), np.ones(n_surveys))
        half = _solved(factor, np.column_stack([np.ones(n), y]))
        ones, rest = half[:, 0], half[:, 1:]
        weight = float(ones @ ones)
        about_mean = rest - np.outer(ones, ones @ rest / weight)
        variance = np.maximum(np.square(about_mean).sum(axis=0) / (n - 1), 1e-12)
        log = -0.5 * (n - 1) * np.log(variance) - np.log(np.diag(factor)).sum() - 0.5 * np.log(weight)
        if self.noise_m > 0.0:
            implied = 0.5 * np.log(2.0**cell.ratio * variance / self.noise_m**2)
            log = log - 0.5 * np.square(implied / _NOISE_DOUBT)
        return Likelihood(log, variance)


def mapped(
    xy: FloatArray, heights: FloatArray, found: list[FoundKernel], nodes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the maps of B surveys of the same places, surveys with the same kernel factorized once.

    Parameters
    ----------
    xy, heights : (N, 2) and (N, B) ndarray
        Places and measured heights [m].
    found : list of FoundKernel
        One for each survey.
    nodes : (M, 2) ndarray
        Where the terrain is wanted [m].

    Returns
    -------
    mean : (M, B) ndarray
        Most likely heights [m], the constant mean by generalised least squares.
    rmse_m : (B,) ndarray
        Root mean square of the standard deviation over every ninth node: what the map says it errs.
    """
    mean, claimed = np.empty((len(nodes), heights.shape[1])), np.empty(heights.shape[1])
    for cell in dict.fromkeys(one.cell for one in found):
        mine = [b for b, one in enumerate(found) if one.cell == cell]
        mean[:, mine], share = _mapped_alike(xy, heights[:, mine], cell, nodes)
        claimed[mine] = np.sqrt(share * np.array([found[b].variance_m2 for b in mine]))
    return mean, claimed


def _mapped_alike(
    xy: FloatArray, heights: FloatArray, cell: Cell, nodes: FloatArray
) -> tuple[FloatArray, float]:
    """Return the maps (M, B) of surveys with one kernel, and the mean share of the variance that is left."""
    factor = cell.factor(xy)
    if factor is None:
        raise InputError("the covariance of the samples is singular; take them farther apart.")
    half = _solved(factor, np.column_stack([np.ones(len(xy)), heights]))
    ones, rest = half[:, 0], half[:, 1:]
    centre = ones @ rest / (ones @ ones)
    weights = _solved(factor, rest - np.outer(ones, centre), transposed=True)
    mean = np.empty((len(nodes), heights.shape[1]))
    for rows in _blocks(len(nodes)):
        mean[rows] = centre + cell.correlation(cdist(nodes[rows], xy, "sqeuclidean")) @ weights
    explained = _solved(factor, cell.correlation(cdist(xy, nodes[::9], "sqeuclidean")))
    gap = 1.0 - ones @ explained
    left = 1.0 - np.square(explained).sum(axis=0) + np.square(gap) / (ones @ ones)
    return mean, float(np.maximum(left, 0.0).mean())


def _blocks(n: int, size: int = 64) -> Iterator[slice]:
    """Rows that are worked on together, so that they stay in the processor's cache."""
    return (slice(start, min(start + size, n)) for start in range(0, n, size))


def _solved(factor: FloatArray, columns: FloatArray, *, transposed: bool = False) -> FloatArray:
    """L⁻¹ B, or L⁻ᵀ B; a factor of a positive definite matrix has no zero that could fail."""
    solved: FloatArray = lapack.dtrtrs(factor, columns, lower=1, trans=int(transposed))[0]
    return solved


def _factorized(matrix: FloatArray) -> FloatArray | None:
    """Lower Cholesky factor, or None where rounding makes the matrix indefinite."""
    factor, failed = lapack.dpotrf(matrix.T, lower=1, overwrite_a=1, clean=1)
    return None if failed else factor

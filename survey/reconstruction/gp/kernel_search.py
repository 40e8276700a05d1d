r"""Kernels and maps of many surveys that sampled the same places, by likelihood on a lattice that all of them share.

A covariance is a cell of the lattice: a family, a length scale and the ratio q of noise variance to
terrain variance. Everything expensive, the factorization of

.. math::  C = \rho_\ell(X, X) + q I = L L^T,

depends on the places X and on the cell alone, so it is done once for all surveys; their heights are the
columns of one matrix. The variance of the terrain follows from each survey in closed form, with a
constant mean μ integrated out:

.. math::  \hat s^2 = \frac{(y - \mu)^T C^{-1} (y - \mu)}{n - 1}, \qquad
           -2 \log p = (n - 1) \log \hat s^2 + \log |C| + \log 1^T C^{-1} 1 + \mathrm{const}

(glacier paper, Eq. 9; restricted likelihood, Patterson and Thompson 1971). `KernelSearch` finds the likeliest cell of each
survey; `map_surveys` returns the maps of all surveys.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack
from scipy.spatial.distance import cdist

from survey.core import BoolArray, FloatArray, InputError, IntArray
from survey.reconstruction.gp.families import SEARCHABLE, SearchedFamily
from survey.reconstruction.gp.kernels import KINDS, Stationary

PER_DOUBLING = 4
"""Length scales of the lattice per doubling."""


LEAST_RATIO = -28
"""Exponent of 2 of the least ratio of variances: a perfect sensor errs by 0.3 mm where the terrain varies by 5 m."""


class Cell(NamedTuple):
    """A covariance up to its variance: family, length scale 2^(length/4) m, ratio 2^ratio."""

    family: SearchedFamily
    length: float
    ratio: float

    @classmethod
    def of(cls, family: SearchedFamily, length_scale_m: float, ratio: float) -> "Cell":
        """Return the cell of a given covariance; its length scale and ratio need not lie on the lattice."""
        length = PER_DOUBLING * float(np.log2(length_scale_m))
        return cls(family, length, max(float(np.log2(max(ratio, 1e-300))), LEAST_RATIO))

    @property
    def length_scale_m(self) -> float:
        """Length scale [m]."""
        return float(2.0 ** (self.length / PER_DOUBLING))

    @property
    def kind(self) -> type[Stationary]:
        """Class of the covariance function."""
        return KINDS[self.family]

    def kernel(self, variance_m2: float) -> Stationary:
        """Return the covariance function with this variance."""
        return self.kind(variance_m2, self.length_scale_m)

    def correlation(self, squared_m2: FloatArray) -> FloatArray:
        """Return the correlation at squared distances [m²]."""
        return self.kernel(1.0)._correlation(squared_m2 / self.length_scale_m**2)

    def factor(self, xy: FloatArray) -> FloatArray | None:
        """Return L (N, N) of the samples' correlation in a lower triangle, or None where rounding makes it indefinite."""
        return self.factor_of(triangle(xy))

    def factor_of(self, triangle: Iterable[tuple[slice, FloatArray]]) -> FloatArray | None:
        """Return the factor from squared distances [m²], given some rows at a time from the diagonal on."""
        correlation, scale = self.kernel(1.0)._correlation, self.length_scale_m**-2
        blocks = [(rows, correlation(scale * squared_m2)) for rows, squared_m2 in triangle]
        n = blocks[-1][0].stop
        matrix = np.empty((n, n))
        for rows, block in blocks:
            matrix[rows, rows.start :] = block
        matrix.flat[:: n + 1] += 2.0**self.ratio
        return factorize(matrix)


@dataclass(frozen=True)
class Likelihood:
    """Log likelihood (B,) and terrain variance (B,) [m²] of one cell, survey by survey."""

    log: FloatArray
    variance_m2: FloatArray


Request = tuple[Cell, BoolArray]
"""A cell, and the surveys (B,) that request its likelihood."""


@dataclass(frozen=True)
class FoundKernel:
    """The likeliest covariance of one survey: its cell, and the terrain's variance [m²]."""

    cell: Cell
    variance_m2: float

    @property
    def kernel(self) -> Stationary:
        """The covariance function [m²]."""
        return self.cell.kernel(self.variance_m2)

    @property
    def noise_m(self) -> float:
        """Standard deviation of a sample that goes with it [m]."""
        return float(np.sqrt(2.0**self.cell.ratio * self.variance_m2))


def blocks(n: int, size: int = 64) -> Iterator[slice]:
    """Return the rows that are worked on together, so that they stay in the processor's cache."""
    return (slice(start, min(start + size, n)) for start in range(0, n, size))


def triangle(xy: FloatArray) -> Iterator[tuple[slice, FloatArray]]:
    """Squared distances [m²] of some rows at a time, from the diagonal on: a factorization reads one triangle alone."""
    return ((rows, cdist(xy[rows], xy[rows.start :], "sqeuclidean")) for rows in blocks(len(xy)))


def solve_triangle(factor: FloatArray, columns: FloatArray, *, transposed: bool = False) -> FloatArray:
    """Return L⁻¹ B, or L⁻ᵀ B; a factor of a positive definite matrix has no zero that could fail."""
    solved: FloatArray = lapack.dtrtrs(factor, columns, lower=1, trans=int(transposed))[0]
    return solved


def factorize(matrix: FloatArray) -> FloatArray | None:
    """Return the Cholesky factor in the lower triangle, or None where rounding makes the matrix indefinite."""
    factor, failed = lapack.dpotrf(matrix.T, lower=1, overwrite_a=1, clean=0)
    return None if failed else factor


_NOISE_DOUBT = 0.2
"""How far the real noise may lie from the stated one: one standard deviation of its logarithm."""


@dataclass(eq=False)
class LikelihoodView:
    """Likelihoods of the cells that were evaluated for B surveys of some places, and the surveys that requested each."""

    xy: FloatArray
    heights: FloatArray
    noise_m: float
    seen: dict[Cell, Likelihood] = field(default_factory=dict)
    requested: dict[Cell, BoolArray] = field(default_factory=dict)

    def thinned(self, n: int) -> "LikelihoodView":
        """Return a view from so many of the places."""
        few = np.linspace(0, len(self.xy) - 1, min(n, len(self.xy))).astype(int)
        return LikelihoodView(self.xy[few], self.heights[few], self.noise_m)

    def look(self, requests: Iterable[Request]) -> bool:
        """Evaluate cells for the surveys that request them, and return whether any was new to its survey."""
        news = False
        for cell, mine in list(requests):
            if not mine.any():
                continue
            if cell not in self.seen:
                self.seen[cell], self.requested[cell] = self._likelihood(cell), np.zeros_like(mine)
            news |= bool((mine & ~self.requested[cell]).any())
            self.requested[cell] |= mine
        return news

    def saw(self, cells: Iterable[Cell]) -> BoolArray:
        """Return which surveys (B,) requested one of these cells."""
        requested: BoolArray = np.zeros(self.heights.shape[1], dtype=bool)
        for cell in cells:
            requested |= self.requested[cell]
        return requested

    def best(self, cells: Iterable[Cell]) -> tuple[list[Cell], FloatArray]:
        """Return each survey's best cell among those that it requested, and how likely it is."""
        cells = list(cells)
        logs = np.array([np.where(self.requested[cell], self.seen[cell].log, -np.inf) for cell in cells])
        return [cells[index] for index in logs.argmax(axis=0)], logs.max(axis=0)

    def tops(self, cells: Sequence[Cell]) -> Iterator[Request]:
        """Return the best of these cells, each with the surveys whose best it is."""
        if cells:
            best, logs = self.best(cells)
            for top in dict.fromkeys(best):
                yield top, np.array([one == top for one in best]) & (logs > -np.inf)

    def racing(self, families: Sequence[SearchedFamily], within: float) -> Iterator[Request]:
        """Return the best cell of every family for the surveys that it makes nearly as likely as any [nats]."""
        mine = {family: [cell for cell in self.seen if cell.family == family] for family in families}
        bests = [self.best(cells) for cells in mine.values() if cells]
        most = np.max([logs for _, logs in bests], axis=0)
        for best, logs in bests:
            for top in dict.fromkeys(best):
                yield top, np.array([one == top for one in best]) & (logs > -np.inf) & (logs >= most - within)

    @cached_property
    def _triangle(self) -> list[tuple[slice, FloatArray]]:
        return list(triangle(self.xy))

    @cached_property
    def _columns(self) -> FloatArray:
        """Ones, and the heights about their mean (n, 1 + B)."""
        return np.column_stack([np.ones(len(self.xy)), self.heights - self.heights.mean(axis=0)])

    def _likelihood(self, cell: Cell) -> Likelihood:
        n, n_surveys = self.heights.shape
        factor = cell.factor_of(self._triangle)
        if factor is None:
            return Likelihood(np.full(n_surveys, -np.inf), np.ones(n_surveys))
        half = solve_triangle(factor, self._columns)
        ones, rest = half[:, 0], half[:, 1:]
        weight = float(ones @ ones)
        about_mean = rest - np.outer(ones, ones @ rest / weight)
        variance = np.maximum(np.square(about_mean).sum(axis=0) / (n - 1), 1e-12)
        log = -0.5 * (n - 1) * np.log(variance) - np.log(np.diag(factor)).sum() - 0.5 * np.log(weight)
        if self.noise_m > 0.0:
            implied = 0.5 * np.log(2.0**cell.ratio * variance / self.noise_m**2)
            log = log - 0.5 * np.square(implied / _NOISE_DOUBT)
        return Likelihood(log, variance)


SEARCHED: tuple[SearchedFamily, ...] = ("squared-exponential", "matern-5/2", "matern-3/2")
"""Families that a search compares by default."""

ALL: tuple[SearchedFamily, ...] = SEARCHABLE
"""Every family that can be searched, the smoothest first."""

_MOST_SEARCHED = 160
"""Places from which a kernel is learned; more change the length scale by less than a step of the lattice."""
_FEW = 64
"""Places from which the lattice is looked through first, to know where to look from all of them."""
_COARSE = (4, 3)
"""Steps of the coarse lattice: an octave of length, and a factor of 8 of the ratio."""
_WITHIN_NATS = 60.0
"""How much less likely than the best a family can be beside its top and yet be the likeliest at its top [nats].

On smooth terrain a step of length beside the top costs tens of nats, an octave hundreds: which family is the
likeliest is decided near the maxima alone.
"""


@dataclass(eq=False)
class KernelSearch:
    """Looks for the kernels of B surveys that sampled the same N places.

    `xy` (N, 2): places [m]. `heights` (N, B): what each survey measured there [m]. `noise_m`: stated standard
    deviation of a measurement [m]; the fit may depart from it by some 20 %. 0 is a perfect sensor.
    `families`: what to compare. `most`: from how many of the places to learn; they are taken evenly.

    Isotropic families of one scale only. The lattice has four length scales per doubling and
    ratios in powers of two; no survey's result depends on which others are searched with it.

    >>> from survey.reconstruction.gp.kernels import SquaredExponential
    >>> rng = np.random.default_rng(1)
    >>> xy = rng.uniform(0.0, 600.0, (120, 2))
    >>> drawn = np.linalg.cholesky(SquaredExponential(9.0, 100.0).covariance(xy, xy) + 1e-4 * np.eye(120))
    >>> found = KernelSearch(xy, drawn @ rng.standard_normal((120, 2)), noise_m=0.01).search()
    >>> [(one.cell.family, round(one.cell.length_scale_m)) for one in found]
    [('squared-exponential', 91), ('squared-exponential', 108)]
    """

    xy: FloatArray
    heights: FloatArray
    noise_m: float
    families: tuple[SearchedFamily, ...] = SEARCHED
    most: int = _MOST_SEARCHED

    def __post_init__(self) -> None:
        if len(self.xy) < 3:
            raise InputError(f"{len(self.xy)} samples are too few for a covariance; take more of them.")
        unknown = int((~np.isfinite(self.heights)).sum())
        if unknown:
            raise InputError(f"{unknown} heights are NaN or infinite; leave their samples out.")
        if not set(self.families) <= set(ALL):
            raise InputError(
                f"a search takes the families {', '.join(ALL)}, not {', '.join(self.families)}; name some of these."
            )

    def search(self) -> list[FoundKernel]:
        """Return the likeliest kernel of each survey."""
        few = self._all.thinned(_FEW)
        few.look(self._coarse())
        self._climb(few, step=2, within=np.inf)
        self._all.look(few.racing(self.families, np.inf))
        self._climb(self._all, step=1, within=_WITHIN_NATS)
        seen = self._all.seen
        best, _ = self._all.best(seen)
        return [FoundKernel(cell, float(seen[cell].variance_m2[b])) for b, cell in enumerate(best)]

    def plausible(self, within: float = 4.0) -> list[tuple[FoundKernel, float]]:
        """Return the kernels of the first survey that are nearly as likely as its best, with weights that sum to 1.

        `within`: how much less likely than the best one [nats].
        """
        self.search()
        while self._all.look(self._around(within)):
            pass
        # Every second length and every ratio: the lattice of equal spacing that all were searched on.
        even = {cell: seen for cell, seen in self._all.seen.items() if cell.length % 2 == 0}
        most = max(seen.log[0] for seen in even.values())
        kept = [
            (FoundKernel(cell, float(seen.variance_m2[0])), float(np.exp(seen.log[0] - most)))
            for cell, seen in even.items()
            if seen.log[0] > most - within
        ]
        total = sum(weight for _, weight in kept)
        return [(found, weight / total) for found, weight in sorted(kept, key=lambda pair: -pair[1])]

    @cached_property
    def _all(self) -> "LikelihoodView":
        """What all places that are searched say."""
        chosen = np.linspace(0, len(self.xy) - 1, min(len(self.xy), self.most)).astype(int)
        return LikelihoodView(self.xy[chosen], self.heights[chosen], self.noise_m)

    @cached_property
    def _lengths(self) -> tuple[int, int]:
        """First and last length scale: from a thirtieth of the extent to twice it."""
        extent = float(np.ptp(self.xy, axis=0).max())
        low, high = (round(PER_DOUBLING * np.log2(share * extent)) for share in (1.0 / 30.0, 2.0))
        return low, high

    @cached_property
    def _ratios(self) -> IntArray:
        """First and last ratio (2, B): the stated noise beside a terrain from 1/8 to 256 times as variable as the samples."""
        if self.noise_m == 0.0:
            return np.full((2, self.heights.shape[1]), LEAST_RATIO)
        spread = np.maximum(self._all.heights.var(axis=0), 1e-12)
        middle = np.floor(np.log2(self.noise_m**2 / spread)).astype(np.int64)
        # The first is on the coarse lattice, so that none of its cells lies where no step may lead.
        limits: IntArray = np.clip(np.stack([(middle - 8) // 3 * 3, middle + 3]), LEAST_RATIO, 3)
        return limits

    def _coarse(self) -> Iterator[Request]:
        low, high = self._lengths
        step_l, step_q = _COARSE
        first, last = self._ratios
        for family in self.families:
            for length in range(low - low % step_l, high + 1, step_l):
                for ratio in range(first.min() // step_q * step_q, last.max() + 1, step_q):
                    # The least ratio need not be a multiple of the step.
                    yield (
                        Cell(family, length, max(ratio, LEAST_RATIO)),
                        (first - step_q < ratio) & (ratio <= last),
                    )

    def _climb(self, view: "LikelihoodView", step: int, within: float) -> None:
        """Look beside the best of every family that is still in the race until nothing there is better."""
        while view.look(self._neighbours(view, step, within)):
            pass

    def _neighbours(self, view: "LikelihoodView", step: int, within: float) -> Iterator[Request]:
        """Return the cells around the best of every family, for each survey its own.

        A longer scale goes with a larger variance, thus with a smaller ratio: a ridge that no step along one
        axis follows. So neighbouring lengths are compared by the likeliest ratio of each.
        """
        low, high = self._lengths
        first, last = self._ratios
        for best, mine in view.racing(self.families, within):
            for length in (best.length, best.length - step, best.length + step):
                if not low <= length <= high:
                    continue
                there = [cell for cell in view.seen if cell.family == best.family and cell.length == length]
                yield best._replace(length=length), mine & ~view.saw(there)
                if self.noise_m == 0.0:
                    continue
                for top, its in view.tops(there):
                    for ratio in (top.ratio - 1, top.ratio + 1):
                        yield top._replace(ratio=ratio), its & mine & (first <= ratio) & (ratio <= last)

    def _around(self, within: float) -> Iterator[Request]:
        """Return the cells beside those of the first survey that are nearly as likely as its best."""
        low, high = self._lengths
        first, last = self._ratios[:, 0]
        alone = np.arange(self.heights.shape[1]) == 0
        most = max(seen.log[0] for seen in self._all.seen.values())
        for cell in [c for c, seen in self._all.seen.items() if seen.log[0] > most - within]:
            odd = cell.length % 2
            for length in (cell.length - odd, cell.length + odd):
                for d_length, d_ratio in ((0, 0), (-2, 0), (2, 0), (0, -1), (0, 1)):
                    beside = Cell(cell.family, length + d_length, cell.ratio + d_ratio)
                    if low <= beside.length <= high and first <= beside.ratio <= last:
                        yield beside, alone


def map_surveys(
    xy: FloatArray, heights: FloatArray, found: list[FoundKernel], nodes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the maps of B surveys of the same places, surveys with the same kernel factorized once.

    `xy`, `heights` (N, 2) and (N, B): places and measured heights [m]. `nodes` (M, 2): where the terrain is
    wanted [m]. Returns `mean` (M, B): most likely heights [m], the constant mean by generalised least
    squares. `rmse_m` (B,): root mean square of the standard deviation over every ninth node: what the map
    says it errs.
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
    half = solve_triangle(factor, np.column_stack([np.ones(len(xy)), heights]))
    ones, rest = half[:, 0], half[:, 1:]
    centre = ones @ rest / (ones @ ones)
    weights = solve_triangle(factor, rest - np.outer(ones, centre), transposed=True)
    mean = np.empty((len(nodes), heights.shape[1]))
    for rows in blocks(len(nodes)):
        mean[rows] = centre + cell.correlation(cdist(nodes[rows], xy, "sqeuclidean")) @ weights
    explained = solve_triangle(factor, cell.correlation(cdist(xy, nodes[::9], "sqeuclidean")))
    gap = 1.0 - ones @ explained
    left = 1.0 - np.square(explained).sum(axis=0) + np.square(gap) / (ones @ ones)
    return mean, float(np.maximum(left, 0.0).mean())

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

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from survey.core.arrays import FloatArray, IntArray
from survey.core.errors import InputError
from survey.reconstruction.gp.covariance.families import SEARCHABLE, SearchedFamily
from survey.reconstruction.gp.selection.cells import (
    LEAST_RATIO,
    PER_DOUBLING,
    Cell,
    FoundKernel,
    Wish,
)
from survey.reconstruction.gp.selection.likelihoods import LikelihoodView

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
_TOLD = 60.0
"""How much less likely than the best a family can be beside its top and yet be the likeliest at its top [nats].

On smooth terrain a step of length beside the top costs tens of nats, an octave hundreds: which family is the
likeliest is decided near the maxima alone.
"""


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
    most : int
        From how many of the places to learn; they are taken evenly.

    Notes
    -----
    Isotropic families of one scale only. The lattice has four length scales per doubling and
    ratios in powers of two; no survey's result depends on which others are searched with it.

    Examples
    --------
    >>> from survey.reconstruction.gp.covariance.kernels import SquaredExponential
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

    def found(self) -> list[FoundKernel]:
        """Return the likeliest kernel of each survey."""
        few = self._all.thinned(_FEW)
        few.look(self._coarse())
        self._climb(few, step=2, within=np.inf)
        self._all.look(few.racing(self.families, np.inf))
        self._climb(self._all, step=1, within=_TOLD)
        seen = self._all.seen
        best, _ = self._all.best(seen)
        return [FoundKernel(cell, float(seen[cell].variance_m2[b])) for b, cell in enumerate(best)]

    def plausible(self, within: float = 4.0) -> list[tuple[FoundKernel, float]]:
        """Return the kernels of the first survey that are nearly as likely as its best, with weights that sum to 1.

        Parameters
        ----------
        within : float
            How much less likely than the best one [nats].
        """
        self.found()
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

    def _coarse(self) -> Iterator[Wish]:
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

    def _neighbours(self, view: "LikelihoodView", step: int, within: float) -> Iterator[Wish]:
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

    def _around(self, within: float) -> Iterator[Wish]:
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

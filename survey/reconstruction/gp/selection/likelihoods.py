"""Likelihoods of the cells that a kernel search has evaluated."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.reconstruction.gp.covariance.families import SearchedFamily
from survey.reconstruction.gp.selection.cells import (
    Cell,
    Likelihood,
    Wish,
    solved,
    triangle,
)

_NOISE_DOUBT = 0.2
"""How far the real noise may lie from the stated one: one standard deviation of its logarithm."""


@dataclass(eq=False)
class LikelihoodView:
    """How likely B surveys of some places make the cells that were looked at, and which survey asked for which."""

    xy: FloatArray
    heights: FloatArray
    noise_m: float
    seen: dict[Cell, Likelihood] = field(default_factory=dict)
    asked: dict[Cell, BoolArray] = field(default_factory=dict)

    def thinned(self, n: int) -> "LikelihoodView":
        """Return a view from so many of the places."""
        few = np.linspace(0, len(self.xy) - 1, min(n, len(self.xy))).astype(int)
        return LikelihoodView(self.xy[few], self.heights[few], self.noise_m)

    def look(self, wishes: Iterable[Wish]) -> bool:
        """Evaluate cells for the surveys that request them, and return whether any was new to its survey."""
        news = False
        for cell, mine in list(wishes):
            if not mine.any():
                continue
            if cell not in self.seen:
                self.seen[cell], self.asked[cell] = self._likelihood(cell), np.zeros_like(mine)
            news |= bool((mine & ~self.asked[cell]).any())
            self.asked[cell] |= mine
        return news

    def saw(self, cells: Iterable[Cell]) -> BoolArray:
        """Return which surveys (B,) asked for one of these cells."""
        asked: BoolArray = np.zeros(self.heights.shape[1], dtype=bool)
        for cell in cells:
            asked |= self.asked[cell]
        return asked

    def best(self, cells: Iterable[Cell]) -> tuple[list[Cell], FloatArray]:
        """Return each survey's best cell among those that it asked for, and how likely it is."""
        cells = list(cells)
        logs = np.array([np.where(self.asked[cell], self.seen[cell].log, -np.inf) for cell in cells])
        return [cells[index] for index in logs.argmax(axis=0)], logs.max(axis=0)

    def tops(self, cells: Sequence[Cell]) -> Iterator[Wish]:
        """Return the best of these cells, each with the surveys whose best it is."""
        if cells:
            best, logs = self.best(cells)
            for top in dict.fromkeys(best):
                yield top, np.array([one == top for one in best]) & (logs > -np.inf)

    def racing(self, families: Sequence[SearchedFamily], within: float) -> Iterator[Wish]:
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
        half = solved(factor, self._columns)
        ones, rest = half[:, 0], half[:, 1:]
        weight = float(ones @ ones)
        about_mean = rest - np.outer(ones, ones @ rest / weight)
        variance = np.maximum(np.square(about_mean).sum(axis=0) / (n - 1), 1e-12)
        log = -0.5 * (n - 1) * np.log(variance) - np.log(np.diag(factor)).sum() - 0.5 * np.log(weight)
        if self.noise_m > 0.0:
            implied = 0.5 * np.log(2.0**cell.ratio * variance / self.noise_m**2)
            log = log - 0.5 * np.square(implied / _NOISE_DOUBT)
        return Likelihood(log, variance)

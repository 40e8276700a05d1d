"""Allocation of further lines to the gaps between driven ones."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

_OUTER_SHARE = 0.35


def gaps_filled(
    driven: Sequence[float], width_m: float, n_lines: int, growth: float
) -> list[tuple[float, float]]:
    r"""Lay further lines (offset, spacing) [m], each where it saves the most.

    What a strip of width w between two lines adds to the squared error is taken to grow as :math:`w^{2 \nu + 1}`
    for a terrain of smoothness ν. Lines in a gap lie at equal distances, the outermost
    0.35 of a spacing from the border.

    Parameters
    ----------
    driven : sequence of float
        Offsets of the lines driven [m].
    width_m : float
        Width of the area [m].
    n_lines : int
        How many lines to lay.
    growth : float
        The exponent 2 ν + 1.

    Examples
    --------
    >>> [round(offset) for offset, _ in gaps_filled([100.0], 600.0, 3, 4.0)]
    [249, 399, 548]
    """
    gaps = _gaps(driven, width_m)
    for _ in range(n_lines):
        saved = [gap.cost(growth) - gap.with_another().cost(growth) for gap in gaps]
        most = int(np.argmax(saved))
        gaps[most] = gaps[most].with_another()
    return sorted(line for gap in gaps for line in gap.lines)


class _Gap(NamedTuple):
    """A strip of the area, whether each side is a border of it, and how many lines are laid in it."""

    low_m: float
    high_m: float
    is_border: tuple[bool, bool]
    n_lines: int = 0

    @property
    def ends(self) -> tuple[float, float]:
        """Distances of the strip's sides from its outermost lines, in spacings."""
        low, high = (_OUTER_SHARE if border else 1.0 for border in self.is_border)
        return low, high

    @property
    def spacing_m(self) -> float:
        """Distance between lines that lie evenly; with no line, what would leave the strip as it is."""
        n_spacings = self.n_lines - 1 + sum(self.ends)
        return (self.high_m - self.low_m) / (n_spacings if n_spacings > 0.0 else 0.5 * _OUTER_SHARE)

    @property
    def lines(self) -> list[tuple[float, float]]:
        """Offset and spacing of the lines [m]."""
        first = self.low_m + self.ends[0] * self.spacing_m
        return [(first + k * self.spacing_m, self.spacing_m) for k in range(self.n_lines)]

    def with_another(self) -> "_Gap":
        """Return the strip with one more line."""
        return self._replace(n_lines=self.n_lines + 1)

    def cost(self, growth: float) -> float:
        """Return the squared error of the strip, up to a factor."""
        n_strips = self.n_lines + 1 - sum(0.5 for border in self.is_border if border)
        return float(max(n_strips, 0.5) * self.spacing_m**growth)


def _gaps(driven: Sequence[float], width_m: float) -> list[_Gap]:
    """Return the strips between the lines driven, and between them and the borders."""
    sides = [0.0, *sorted(driven), width_m]
    last = len(sides) - 2
    return [_Gap(low, high, (index == 0, index == last)) for index, (low, high) in enumerate(pairwise(sides))]

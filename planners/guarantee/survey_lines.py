"""Lines across an area, addressed by their distance from its edge: counts that are tried, and lines for the gaps.

`SurveyLines` gives the swath on the line at an offset, and the offsets of the lines of a route. `swath_counts` lists
the numbers of swaths that are considered, and `fewest` searches for the smallest number that is enough. `gaps_filled`
lays further lines between those already driven, each where it lowers the squared error most.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from planners.guarantee.requirement import MapRequirement
from planners.patterns.lawnmower import LawnmowerConfig
from planners.patterns.wavy import WavyConfig, wavy
from planners.planning import plan
from planners.routes.rover import Rover
from planners.routes.shortest_paths import FreeGround, shared_ground
from planners.swaths.decomposition import clip_lines
from planners.swaths.heading import across_marked_grain
from planners.swaths.reference_lines import axes_of, shortened, shortest_m
from planners.swaths.worth_driving import worth_driving
from survey import Dem, Route, SurveyArea
from survey.core import FloatArray, IntArray

_INSET_SHARE = 0.25


class SurveyLines:
    """Lines across an area that swaths may be laid on, addressed by their distance from its edge.

    `area`: the free ground. `heading_deg`: of the lines [deg]; across the narrowest width when left out.
    """

    def __init__(self, area: SurveyArea, heading_deg: float | None = None) -> None:
        self.area = area
        axis = plan(area, None, LawnmowerConfig(swaths=2, heading_deg=heading_deg)).swaths[0].axis
        east, north = axis[1] - axis[0]
        self.along, self.left = axes_of(float(np.degrees(np.arctan2(north, east))))
        outline = np.array(area.free.convex_hull.exterior.coords)
        self.u, self.v = outline @ self.along, outline @ self.left
        self.width_m = float(np.ptp(self.v))

    @cached_property
    def ground(self) -> FreeGround:
        """The free ground with its ways."""
        return shared_ground(self.area.free)

    def swath(self, offset_m: float, spacing_m: float, wavelength_m: float) -> list[FloatArray]:
        """Return what is driven (N, 2) on the line at an offset, piece by piece along the line [m]."""
        reach = np.array([self.u.min() - 1.0, self.u.max() + 1.0])
        line = reach[:, None] * self.along + (self.v.min() + offset_m) * self.left
        axes = [shortened(axis, _INSET_SHARE * spacing_m) for axis in clip_lines(self.ground, [line])]
        if not axes:
            return []
        config = WavyConfig(spacing_m=spacing_m)
        swaths = wavy(axes, self.area, config, spacing_m, wavelength_m)
        least_m = shortest_m(config, spacing_m, Rover().turn_m)
        return [swath.xy for swath in worth_driving(swaths, self.ground, least_m)]

    def offsets_of(self, route: Route, apart_m: float) -> list[float]:
        """Return the offsets of the lines driven [m]; pieces of one line, as about a hole, count once."""
        edge = float(self.v.min())
        found: list[float] = []
        for leg in route.swaths:
            offset = float(leg.axis.mean(axis=0) @ self.left) - edge
            if all(abs(offset - other) > apart_m for other in found):
                found.append(offset)
        return found

    def nearest(self, xy: FloatArray, offsets: Sequence[float]) -> IntArray:
        """Return the index (N,) of the offset that each place (N, 2) is nearest to."""
        offset = xy @ self.left - float(self.v.min())
        nearest: IntArray = np.argmin(np.abs(offset[:, None] - np.array(offsets)), axis=1)
        return nearest


_OUTER_SHARE = 0.35


def gaps_filled(
    driven: Sequence[float], width_m: float, n_lines: int, growth: float
) -> list[tuple[float, float]]:
    r"""Lay further lines (offset, spacing) [m], each where it saves the most.

    What a strip of width w between two lines adds to the squared error is taken to grow as :math:`w^{2 \nu + 1}`
    for a terrain of smoothness ν. Lines in a gap lie at equal distances, the outermost
    0.35 of a spacing from the border.

    `driven`: offsets of the lines driven [m]. `width_m`: width of the area [m].

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


_MOST_SWATHS = 30
LONGEST_M = 2e6
"""About the longest drive that is considered unless a number of swaths is stated: 200 days of 10 km [m]."""
# Relief that is longer than five cells is all that a prior shows well.
_WIDEST_CELLS = 5.0


def heading_and_width(area: SurveyArea, prior: Dem) -> tuple[float, float]:
    """Return the heading of swaths across a marked grain of a prior [deg], and the area's width across them [m]."""
    # A covariance that is alike in all directions does not show ridges that run beside the swaths.
    heading_deg = across_marked_grain(area.free, prior)
    return heading_deg, SurveyLines(area, heading_deg).width_m


def smallest_sufficient(is_enough: Callable[[int], bool], *, first: int, most: int) -> int | None:
    """Return the smallest number from 1 to `most` that is enough, sought from `first` on; None where none is.

    >>> smallest_sufficient(lambda n: n >= 7, first=5, most=30)
    7
    """
    low, high, step = 0, min(max(first, 1), most), 1
    if is_enough(high):
        while high - step > low:
            if not is_enough(high - step):
                low = high - step
                break
            high, step = high - step, 2 * step
    else:
        while not is_enough(high):
            if high >= most:
                return None
            low, high, step = high, min(high + step, most), 2 * step
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if is_enough(middle) else (middle, high)
    return high


def swath_counts(
    width_m: float, cell_m: float, requirement: MapRequirement, area_m2: float = 0.0
) -> tuple[int, ...]:
    """Return the numbers of swaths that are considered, from the least coverage to the most.

    Swaths are at most five cells of the prior apart, for relief that is longer is all that the prior shows well, and
    at least two samples, or 30 of them on a narrow area, and no more than some 2,000 km to drive where fewer are at most
    five cells apart. Beyond fifteen, numbers grow by a tenth.

    `width_m`: width of the area across the swaths [m]. `cell_m`: width of a cell of the prior [m]. `area_m2`: of the area
    [m²]; 0 for any distance.

    >>> swath_counts(600.0, 30.0, MapRequirement(0.4572, max_swaths=16))
    (4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16)
    """
    dense = max(_MOST_SWATHS, int(width_m / (2.0 * requirement.sample_step_m)))
    least = max(int(np.ceil(width_m / (_WIDEST_CELLS * cell_m))), 2)
    longest = max(least, int(LONGEST_M * width_m / max(area_m2, 1e-9)))
    most = requirement.max_swaths or min(dense, longest)
    counts = [min(least, most)]
    while counts[-1] < most:
        counts.append(min(max(counts[-1] + 1, round(1.1 * counts[-1])), most))
    return tuple(counts)

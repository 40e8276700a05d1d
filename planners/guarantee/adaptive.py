r"""A survey that plans itself while it is driven, and ends when its promise holds.

The first swaths are laid as far apart as the prior makes one hope for. Then family, length scale and noise
are learned from the samples taken so far, and the cheapest further swaths are sought that are predicted to
keep the promise: every gap between driven swaths is cut into equal parts, none wider than a spacing D, and D is
made smaller until the chance is as wanted. The nearest of these swaths is driven next, so that a sweep goes
on where it is and gaps are filled while they are near; then all is thought over again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from planners.config import LawnmowerConfig, WavyConfig
from planners.ground.transit import FreeGround
from planners.guarantee.assurance import (
    LEARNED,
    Assurance,
    Assured,
    KernelPosterior,
    belief_from_survey,
    fewest,
)
from planners.planning import plan
from planners.swaths.decomposition import clipped
from planners.swaths.swaths import axes_of, shortened
from planners.swaths.wavy import wavy
from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.route import Leg, Route

MeasureHeights = Callable[[FloatArray], FloatArray]
"""Drives to the places (N, 2) [m] and returns the heights measured there (N,) [m]."""

_OUTER_SHARE = 0.35
_INSET_SHARE = 0.25
_MOST_SWATHS = 30
# A survey is given up after no fewer swaths, unless the densest one has less than this chance.
_LEAST_SEEN = 6
_HOPE = 0.05


@dataclass(frozen=True)
class AdaptiveConfig:
    """What an adaptive survey is asked for.

    Parameters
    ----------
    limit_m : float
        Largest root mean square error of the map [m].
    probability : float
        How sure it is to be, between 0 and 1.
    noise_m, localization_m : float
        Stated error of a sample's height, and of the rover's place east and north [m].
    sample_step_m : float
        Distance between samples [m].
    n_first : int
        Swaths that are driven before anything is learned from them.
    first_probability : float
        Chance, as the prior has it, that the first swaths' spacing would be enough. A gap that proves too
        wide costs a swath that halves it.
    heading_deg : float, optional
        Of the swaths, counter-clockwise from east [deg]; across the narrowest width when left out. What is promised
        takes the terrain to vary alike in all directions: let swaths run across a marked grain
        (`planners.swaths.heading.across_marked_grain`), not along it.
    """

    limit_m: float
    probability: float = 0.9
    noise_m: float = 0.1
    localization_m: float = 0.0
    sample_step_m: float = 10.0
    n_first: int = 2
    first_probability: float = 0.8
    heading_deg: float | None = None


@dataclass(frozen=True)
class AdaptiveSurvey:
    """What was driven, None if nothing was, and what it promises.

    ``holds`` tells whether the promise holds; where it does not, no survey of the swaths allowed would
    keep it, and ``assured`` tells what the densest one would reach.
    """

    route: Route | None
    samples: FloatArray
    belief: KernelPosterior
    assured: Assured
    holds: bool


class Swathes:
    """Lines across an area that swaths may be laid on, told by their distance from its edge.

    Parameters
    ----------
    area : SurveyArea
        The free ground.
    heading_deg : float, optional
        Of the lines [deg]; across the narrowest width when left out.
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
        return FreeGround(self.area.free)

    def swath(self, offset_m: float, spacing_m: float, wavelength_m: float) -> list[FloatArray]:
        """Return what is driven (N, 2) on the line at an offset, piece by piece along the line [m]."""
        reach = np.array([self.u.min() - 1.0, self.u.max() + 1.0])
        line = reach[:, None] * self.along + (self.v.min() + offset_m) * self.left
        axes = [shortened(axis, _INSET_SHARE * spacing_m) for axis in clipped(self.ground, [line])]
        if not axes:
            return []
        config = WavyConfig(spacing_m=spacing_m)
        return [swath.xy for swath in wavy(axes, self.area, config, spacing_m, wavelength_m)]


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
        """Squared error of the strip, up to a factor."""
        n_strips = self.n_lines + 1 - sum(0.5 for border in self.is_border if border)
        return float(max(n_strips, 0.5) * self.spacing_m**growth)


def _gaps(driven: Sequence[float], width_m: float) -> list[_Gap]:
    """Return the strips between the lines driven, and between them and the borders."""
    sides = [0.0, *sorted(driven), width_m]
    last = len(sides) - 2
    return [_Gap(low, high, (index == 0, index == last)) for index, (low, high) in enumerate(pairwise(sides))]


def survey_adaptively(
    area: SurveyArea, belief: KernelPosterior, config: AdaptiveConfig, measure: MeasureHeights
) -> AdaptiveSurvey:
    """Drive a survey that plans itself, until its promise holds or cannot be kept.

    Parameters
    ----------
    area : SurveyArea
        What is to be mapped.
    belief : Belief
        What the prior tells of the terrain.
    config : AdaptiveConfig
        What is promised, and what the samples err.
    measure : callable
        Drives along places and returns the heights measured there.

    Returns
    -------
    AdaptiveSurvey
        Everything driven, in driving order.

    Raises
    ------
    InputError
        An area that no swath meets.
    """
    state = _State(area, belief, config)
    lines = state.further(config.first_probability)
    while lines is not None:
        state.drive(state.nearest(lines), measure)
        if len(state.offsets) >= config.n_first:
            state.learn()
            if state.assured.probability >= config.probability:
                break
            lines = state.further(config.probability)
        else:
            lines = state.further(config.first_probability)
    route = Route(tuple(state.legs), area.crs, "adaptive") if state.legs else None
    return AdaptiveSurvey(route, state.samples, state.belief, state.assured, lines is not None)


def first_swaths(area: SurveyArea, belief: KernelPosterior, config: AdaptiveConfig) -> Route:
    """Return the swaths that are driven before anything is learned from them.

    Raises
    ------
    InputError
        No survey of the swaths allowed would keep the promise on what the prior tells of.
    """
    state = _State(area, belief, config)
    for _ in range(config.n_first):
        lines = state.further(config.first_probability)
        if lines is None:
            raise InputError(
                f"no survey of up to {_MOST_SWATHS} swaths would keep {config.limit_m:g} m here; its densest would err "
                f"{state.assured.rmse_m:.2f} m, ask for less."
            )
        state.drive(state.nearest(lines), _unmeasured)
    return Route(tuple(state.legs), area.crs, "adaptive")


def next_swath(
    area: SurveyArea, driven: Route, xy: FloatArray, heights: FloatArray, config: AdaptiveConfig
) -> AdaptiveSurvey:
    """Return the swath to drive next, after what was driven and measured.

    Parameters
    ----------
    area : SurveyArea
        What is to be mapped.
    driven : Route
        Everything driven so far, by one rover.
    xy, heights : (N, 2) and (N,) ndarray
        Places and measured heights of all samples [m].
    config : AdaptiveConfig
        What is promised, and what the samples err.

    Returns
    -------
    AdaptiveSurvey
        ``route`` is the way to the next swath and along it, None when no more is needed (``holds``) or none would
        do. ``assured`` is the promise of all swaths that are planned to follow.
    """
    belief = belief_from_survey(xy, heights, noise_m=config.noise_m, localization_m=config.localization_m)
    state = _State(area, belief, config)
    state.legs, state.samples, state.heights = list(driven.legs), xy, heights
    left, edge = state.lines.left, float(state.lines.v.min())
    state.offsets = [float(leg.axis.mean(axis=0) @ left) - edge for leg in driven.swaths]
    state.assured = state.assurance.of(xy, belief)
    if state.assured.probability >= config.probability:
        return AdaptiveSurvey(None, xy, belief, state.assured, True)
    lines = state.further(config.probability)
    if lines is None:
        return AdaptiveSurvey(None, xy, belief, state.assured, False)
    state.drive(state.nearest(lines), _unmeasured)
    route = Route(tuple(state.legs[len(driven.legs) :]), area.crs, "adaptive")
    return AdaptiveSurvey(route, xy, belief, state._assured(lines), True)


def _unmeasured(xy: FloatArray) -> FloatArray:
    return np.full(len(xy), np.nan)


def _nearest(lines: Sequence[tuple[float, float]], offset_m: float) -> tuple[float, float]:
    return min(lines, key=lambda line: abs(line[0] - offset_m))


class _State:
    """What was driven and measured, and what it teaches."""

    def __init__(self, area: SurveyArea, belief: KernelPosterior, config: AdaptiveConfig) -> None:
        self.config, self.belief = config, belief
        self.lines = Swathes(area, config.heading_deg)
        self.assurance = Assurance(area, config.limit_m, config.sample_step_m, LEARNED)
        self.offsets: list[float] = []
        self.n_further = 0
        self.legs: list[Leg] = []
        self.samples, self.heights = np.empty((0, 2)), np.empty(0)
        self.assured = Assured(0.0, float(np.sqrt(belief.likeliest.variance_m2)))

    @property
    def here(self) -> FloatArray | None:
        """Where the rover is [m], None before it has driven."""
        return self.legs[-1].xy[-1] if self.legs else None

    def offset_of(self, place: FloatArray | None) -> float:
        """Distance of a place, the start at first, from the area's edge [m]."""
        starts = self.lines.area.starts
        if place is None and not len(starts):
            return 0.0
        place = starts[0] if place is None else place
        return float(place @ self.lines.left - self.lines.v.min())

    def nearest(self, lines: Sequence[tuple[float, float]]) -> tuple[float, float]:
        """Return the line nearest to the rover; the first one is nearest to the edge where it starts."""
        return _nearest(lines, self.offset_of(self.here))

    @property
    def wavelength_m(self) -> float:
        """Length of the waves of the swaths to come [m]."""
        scales = WavyConfig(swaths=1).wavelength_scales
        return scales * self.belief.slope_length_m

    def further(self, probability: float) -> list[tuple[float, float]] | None:
        """Return the fewest further lines that are predicted to be enough; None where none are.

        A prior, or a swath or two, may make the terrain look rougher than it is: while there is hope, some swaths are
        laid over the whole area before it is given up.
        """
        most = _MOST_SWATHS - len(self.offsets)
        if most < 1:
            return None

        def is_enough(n_lines: int) -> bool:
            self.assured = self._assured(self._filled(n_lines))
            return self.assured.probability >= probability

        # The swath just driven has made the last plan one shorter, more or less: begin there.
        found = fewest(is_enough, first=self.n_further - 1, most=most)
        if found is None:
            found = _LEAST_SEEN - len(self.offsets)
            if found < 1 or self.assured.probability < _HOPE:
                return None
        self.n_further = found
        return self._filled(found)

    def _filled(self, n_lines: int) -> list[tuple[float, float]]:
        return gaps_filled(self.offsets, self.lines.width_m, n_lines, self.belief.growth)

    def _assured(self, lines: Sequence[tuple[float, float]]) -> Assured:
        """Return what is promised once the lines are driven too, and the ways to them."""
        here = self.here
        left, planned = list(lines), [self.samples]
        while left:
            line = _nearest(left, self.offset_of(here))
            left.remove(line)
            for piece in self._pieces(line, here):
                driven = piece if here is None else np.vstack([here, piece])
                planned.append(places_along(driven, self.config.sample_step_m))
                here = piece[-1]
        if here is None:
            raise InputError("no swath meets the free ground of the area; ask for another area.")
        return self.assurance.of(np.vstack(planned), self.belief)

    def drive(self, line: tuple[float, float], measure: MeasureHeights) -> None:
        """Drive to a line and along it, and take samples all the way."""
        for piece in self._pieces(line, self.here):
            before = len(self.legs)
            if self.legs and np.hypot(*(piece[0] - self.legs[-1].xy[-1])) > 0.0:
                self.legs.append(Leg("transit", self.lines.ground.way(self.legs[-1].xy[-1], piece[0])))
            self.legs.append(Leg("swath", piece, axis=piece[[0, -1]]))
            driven = np.vstack([leg.xy for leg in self.legs[before:]])
            xy = places_along(driven, self.config.sample_step_m)
            self.samples = np.vstack([self.samples, xy])
            self.heights = np.append(self.heights, measure(xy))
        self.offsets.append(line[0])

    def _pieces(self, line: tuple[float, float], here: FloatArray | None) -> list[FloatArray]:
        """Return what is driven on a line, piece by piece from the end that is nearer."""
        pieces = self.lines.swath(*line, self.wavelength_m)
        if here is None or not pieces:
            return pieces
        is_forth = np.hypot(*(pieces[0][0] - here)) <= np.hypot(*(pieces[-1][-1] - here))
        return pieces if is_forth else [xy[::-1] for xy in pieces[::-1]]

    def learn(self) -> None:
        """Learn family, length, variance and noise from all samples, and what they promise."""
        config = self.config
        self.belief = belief_from_survey(
            self.samples,
            self.heights,
            noise_m=config.noise_m,
            localization_m=config.localization_m,
        )
        self.assured = self.assurance.of(self.samples, self.belief)


def places_along(xy: FloatArray, step_m: float) -> FloatArray:
    """Return places (M, 2) every `step_m` along a polyline (N, 2), its start included [m]."""
    distance = np.r_[0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T))]
    at = np.arange(0.0, distance[-1] + 1e-9, step_m)
    return np.column_stack([np.interp(at, distance, xy[:, 0]), np.interp(at, distance, xy[:, 1])])

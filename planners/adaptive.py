r"""A survey that plans itself while it is driven, and ends when its promise holds.

The first swaths are laid as far apart as the prior makes one hope for. Then family, length scale and noise
are learned from the samples taken so far, and the cheapest further swaths are sought that are predicted to
keep the promise: every gap between driven swaths is cut into equal parts, none wider than a spacing D, and D is
made smaller until the chance is as wanted. The nearest of these swaths is driven next, so that a sweep goes
on where it is and gaps are filled while they are near; then all is thought over again.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from planners.assurance import Assurance, Assured, Belief, belief_from_survey
from planners.config import LawnmowerConfig, WavyConfig
from planners.decomposition import clipped
from planners.planning import plan
from planners.swaths import axes_of, shortened
from planners.transit import FreeGround
from planners.wavy import wavy
from survey.area import SurveyArea
from survey.arrays import FloatArray
from survey.errors import InputError
from survey.route import Leg, Route

Measure = Callable[[FloatArray], FloatArray]
"""Drives to the places (N, 2) [m] and returns the heights measured there (N,) [m]."""

_OUTER_SHARE = 0.35
_INSET_SHARE = 0.25
# A gap may be this much wider than the spacing before another swath is laid into it.
_SLACK = 0.15
_SPACINGS = np.geomspace(1.2, 0.025, 60)
_MOST_SWATHS = 30


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
    """

    limit_m: float
    probability: float = 0.9
    noise_m: float = 0.1
    localization_m: float = 0.0
    sample_step_m: float = 10.0
    n_first: int = 2
    first_probability: float = 0.8


@dataclass(frozen=True)
class AdaptiveSurvey:
    """What was driven, None if nothing was, and what it promises.

    ``holds`` tells whether the promise holds; where it does not, no survey of the swaths allowed would
    keep it, and ``assured`` tells what the densest one would reach.
    """

    route: Route | None
    samples: FloatArray
    belief: Belief
    assured: Assured
    holds: bool


class Swathes:
    """Lines across an area that swaths may be laid on, told by their distance from its edge.

    Parameters
    ----------
    area : SurveyArea
        The free ground.
    """

    def __init__(self, area: SurveyArea) -> None:
        self.area = area
        axis = plan(area, None, LawnmowerConfig(swaths=2)).swaths[0].axis
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


def gaps_filled(driven: Sequence[float], width_m: float, spacing_m: float) -> list[tuple[float, float]]:
    """Return further lines (offset, spacing) [m] that leave no gap wider than a spacing.

    Examples
    --------
    >>> [round(offset) for offset, _ in gaps_filled([100.0], 600.0, 200.0)]
    [26, 313, 526]
    """
    lines: list[tuple[float, float]] = []
    places = sorted(driven)
    if not places:
        n = max(int(np.ceil(width_m / spacing_m + 1.0 - 2.0 * _OUTER_SHARE - _SLACK)), 1)
        between = width_m / (n - 1 + 2.0 * _OUTER_SHARE)
        return [(float(_OUTER_SHARE * between + k * between), float(between)) for k in range(n)]
    for border, sign in ((places[0], -1.0), (width_m - places[-1], 1.0)):
        n = int(np.ceil(border / spacing_m - _OUTER_SHARE - _SLACK))
        if n > 0:
            between = border / (n + _OUTER_SHARE)
            edge = places[0] if sign < 0 else places[-1]
            lines += [(edge + sign * k * between, between) for k in range(1, n + 1)]
    for low, high in pairwise(places):
        n = int(np.ceil((high - low) / spacing_m - _SLACK)) - 1
        between = (high - low) / (n + 1) if n > 0 else 0.0
        lines += [(low + k * between, between) for k in range(1, n + 1)]
    return sorted(lines)


def survey_adaptively(
    area: SurveyArea, belief: Belief, config: AdaptiveConfig, measure: Measure
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
        state.drive(_nearest(lines, state), measure)
        if len(state.offsets) >= config.n_first:
            state.learn()
            if state.assured.probability >= config.probability:
                break
            lines = state.further(config.probability)
        else:
            lines = state.further(config.first_probability)
    route = Route(tuple(state.legs), area.crs, "adaptive") if state.legs else None
    return AdaptiveSurvey(route, state.samples, state.belief, state.assured, lines is not None)


def first_swaths(area: SurveyArea, belief: Belief, config: AdaptiveConfig) -> Route:
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
        state.drive(_nearest(lines, state), _unmeasured)
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
    state.drive(_nearest(lines, state), _unmeasured)
    route = Route(tuple(state.legs[len(driven.legs) :]), area.crs, "adaptive")
    return AdaptiveSurvey(route, xy, belief, state._assured(lines), True)


def _unmeasured(xy: FloatArray) -> FloatArray:
    return np.full(len(xy), np.nan)


def _nearest(lines: Sequence[tuple[float, float]], state: "_State") -> tuple[float, float]:
    """Return the line nearest to the rover; the first one is nearest to the edge where it starts."""
    here = state.offset_here
    return min(lines, key=lambda line: abs(line[0] - here))


class _State:
    """What was driven and measured, and what it teaches."""

    def __init__(self, area: SurveyArea, belief: Belief, config: AdaptiveConfig) -> None:
        self.config, self.belief = config, belief
        self.lines = Swathes(area)
        self.assurance = Assurance(area, config.limit_m, config.sample_step_m)
        self.offsets: list[float] = []
        self.n_further = 0
        self.legs: list[Leg] = []
        self.samples, self.heights = np.empty((0, 2)), np.empty(0)
        self.assured = Assured(0.0, float(np.sqrt(belief.likeliest.variance_m2)))

    @property
    def offset_here(self) -> float:
        """Distance of the rover from the area's edge [m]."""
        area = self.lines.area
        if self.legs:
            here = self.legs[-1].xy[-1]
        elif len(area.starts):
            here = area.starts[0]
        else:
            return 0.0
        return float(here @ self.lines.left - self.lines.v.min())

    @property
    def wavelength_m(self) -> float:
        """Length of the waves of the swaths to come [m]."""
        scales = WavyConfig(swaths=1).wavelength_scales
        return scales * self.belief.slope_length_m

    def further(self, probability: float) -> list[tuple[float, float]] | None:
        """Return the fewest further lines that are predicted to be enough; None where none are."""
        plans = list(self._plans())
        # The swath just driven has made the last set one shorter, more or less: begin there.
        low, high = 0, min(max(self.n_further - 2, 0), len(plans))
        while high < len(plans):
            self.assured = self._assured(plans[high])
            if self.assured.probability >= probability:
                break
            low, high = high + 1, max(high + 1, min(2 * high, len(plans) - 1))
        else:
            return None
        while low < high:
            middle = (low + high) // 2
            if self._assured(plans[middle]).probability >= probability:
                high = middle
            else:
                low = middle + 1
        self.n_further = len(plans[high])
        return plans[high]

    def _plans(self) -> Iterator[list[tuple[float, float]]]:
        """Yield sets of further lines, by their growing number."""
        n_before = 0
        for share in _SPACINGS:
            lines = gaps_filled(self.offsets, self.lines.width_m, share * self.lines.width_m)
            if len(lines) > n_before and len(lines) + len(self.offsets) <= _MOST_SWATHS:
                n_before = len(lines)
                yield lines

    def _assured(self, lines: Sequence[tuple[float, float]]) -> Assured:
        pieces = [
            xy for offset, spacing in lines for xy in self.lines.swath(offset, spacing, self.wavelength_m)
        ]
        if not pieces:
            raise InputError("no swath meets the free ground of the area; ask for another area.")
        planned = [places_along(xy, self.config.sample_step_m) for xy in pieces]
        return self.assurance.of(np.vstack([self.samples, *planned]), self.belief)

    def drive(self, line: tuple[float, float], measure: Measure) -> None:
        """Drive to a line and along it, and take samples all the way."""
        pieces = self.lines.swath(*line, self.wavelength_m)
        for piece in pieces if self._is_nearer_start(pieces) else [xy[::-1] for xy in pieces[::-1]]:
            before = len(self.legs)
            if self.legs and np.hypot(*(piece[0] - self.legs[-1].xy[-1])) > 0.0:
                self.legs.append(Leg("transit", self.lines.ground.way(self.legs[-1].xy[-1], piece[0])))
            self.legs.append(Leg("swath", piece, axis=piece[[0, -1]]))
            driven = np.vstack([leg.xy for leg in self.legs[before:]])
            xy = places_along(driven, self.config.sample_step_m)
            self.samples = np.vstack([self.samples, xy])
            self.heights = np.append(self.heights, measure(xy))
        self.offsets.append(line[0])

    def _is_nearer_start(self, pieces: Sequence[FloatArray]) -> bool:
        if not self.legs:
            return True
        here = self.legs[-1].xy[-1]
        return bool(np.hypot(*(pieces[0][0] - here)) <= np.hypot(*(pieces[-1][-1] - here)))

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

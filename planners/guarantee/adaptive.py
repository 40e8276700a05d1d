r"""Adaptive survey: planned swath by swath while it is driven, until the guarantee holds.

The first swaths are spaced by the prior. Then family, length scale and noise are fitted to the samples taken so
far, and the fewest further swaths are sought that are predicted to meet the requirement: every gap between driven
swaths is cut into equal parts, none wider than a spacing D, and D is reduced until the probability is sufficient.
The nearest of these swaths is driven next; then all is planned again.

The survey may be looked at after each swath. Let A be the event that the map made at the stopping time τ meets the limit.
By the law of total expectation

.. math::  P(A) = E\left[ P(A \mid \text{samples until } \tau) \right] \ge p

where the survey stops only at a probability of p or more, whatever else the rule depends on and however often it is
evaluated: a posterior probability keeps its meaning under optional stopping (Rouder 2014, Psychonomic Bulletin & Review 21,
301; Hendriksen, de Heide and Grünwald 2021, Bayesian Analysis 16, 961). That needs a posterior that is right on average:
the roughness is therefore checked on lines left out (`planners.prediction.kernel_posterior`), and what remains is a spread
measured on real ground.

`AdaptiveState` holds what was driven and measured, with the posterior. `next_swath` plans one swath from it, and
`survey_adaptively` drives all of them with a function that measures heights.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
import shapely

from planners.capacity import MOST_SAMPLES, require_samples
from planners.config import settings_factor
from planners.guarantee.requirement import ErrorLimit, MapRequirement
from planners.guarantee.survey_lines import SurveyLines, gaps_filled, smallest_sufficient
from planners.patterns.wavy import WavyConfig
from planners.prediction.error_distribution import FITTED_KERNEL_INFLATION, MapPrediction, MapPredictor
from planners.prediction.kernel_posterior import KernelPosterior, checked_by_lines, posterior_from_survey
from planners.prediction.prior_cells import PriorCells
from planners.routes.traversability import on_free_ground
from planners.swaths.heading import across_marked_grain
from survey import Dem, InputError, Leg, Route, SurveyArea
from survey.core import FloatArray

MeasureHeights = Callable[[FloatArray], FloatArray]
"""Drives to the places (N, 2) [m] and returns the heights measured there (N,) [m]."""

MOST_SWATHS = 30
SURVEY_SPREAD = 0.17
"""Scale of the logarithm of actual over predicted roughness, with the covariance fitted to a survey (Student's distribution).

From adaptive surveys of the development landscapes of ``python -m benchmarks.promise_on_real_ground``.
"""
# A survey is given up where the densest one has less than this probability: first by the prior, then by so many swaths.
_HOPELESS = 1e-3
_HOPE = 0.1
_LEAST_SEEN = 6
_LONG_SHARE = 0.7
"""Share of the longest swath that the first ones have at least."""


@dataclass(frozen=True)
class AdaptiveConfig(ErrorLimit):
    """Settings of an adaptive survey.

    `limit_m`: largest root mean square error of the map [m]. `probability`: probability with which the limit
    has to be met, above 0.5 and at most 0.999. `noise_m`, `localization_m`: stated error of a sample's
    height, and of the rover's place east and north [m]. `sample_step_m`: distance between samples [m].
    `n_first`: swaths that are driven before the covariance is fitted. `first_probability`: probability, from
    the prior, that the spacing of the first swaths is enough. A gap that proves too wide takes one more
    swath. `heading_deg`: heading of the swaths, counter-clockwise from east [deg]; across the narrowest width
    when left out. The prediction assumes terrain that varies alike in all directions: let swaths run across a
    marked grain (`planners.swaths.heading.across_marked_grain`), not along it. `shared_m`: standard deviation
    of an error of height that all samples share, as of the path [m]. `max_swaths`: most swaths to drive; by
    default as many as are two samples apart, 30 or more. `cells`: cells of the prior that the map is made with, as in
    `planners.prediction.error_model.ErrorModel`; without them the map is that of the samples alone.
    """

    n_first: int = 2
    first_probability: float = 0.8
    heading_deg: float | None = None
    cells: PriorCells | None = None

    @classmethod
    def of(cls, requirement: ErrorLimit, heading_deg: float | None = None) -> Self:
        """Take limit, probability and errors of the samples from a requirement.

        `heading_deg`: heading of the swaths [deg].
        """
        names = [one.name for one in fields(ErrorLimit)]
        return cls(**{name: getattr(requirement, name) for name in names}, heading_deg=heading_deg)

    @classmethod
    def of_prior(cls, requirement: MapRequirement, area: SurveyArea, prior: Dem) -> Self:
        """Take limit, probability and errors from a requirement, and cells of a prior with a heading across its marked grain."""
        config = cls.of(requirement, across_marked_grain(area.free, prior))
        return replace(config, cells=PriorCells.of(prior, area, requirement.prior_sigma_m))


def nearest_line(lines: Sequence[tuple[float, float]], offset_m: float) -> tuple[float, float]:
    """Return the line (offset, spacing) [m] that is nearest to an offset."""
    return min(lines, key=lambda line: abs(line[0] - offset_m))


class AdaptiveState:
    """State of an adaptive survey: what was driven and measured, and the posterior from it."""

    def __init__(self, area: SurveyArea, posterior: KernelPosterior, config: AdaptiveConfig) -> None:
        self.config, self.posterior = config, posterior
        self.lines = SurveyLines(area, config.heading_deg)
        self.predictor = MapPredictor(area, config.sample_step_m, FITTED_KERNEL_INFLATION, config.cells)
        self.most = config.max_swaths or max(
            MOST_SWATHS, int(self.lines.width_m / (2.0 * config.sample_step_m))
        )
        self.offsets: list[float] = []
        self.n_further, self.is_fitted = 0, False
        self.legs: list[Leg] = []
        self.samples, self.heights = np.empty((0, 2)), np.empty(0)
        self.predicted = MapPrediction(0.0, float(np.sqrt(posterior.likeliest.variance_m2)))

    @classmethod
    def driven(
        cls, area: SurveyArea, route: Route, xy: FloatArray, heights: FloatArray, config: AdaptiveConfig
    ) -> Self:
        """Return the state after a route with samples (N, 2) and heights (N,) [m]; lengths are grid metres."""
        found = _fitted(xy, heights, config)
        state = cls(area, found, config)
        state.legs, state.samples, state.heights = list(route.legs), xy, heights
        state.offsets = state.lines.offsets_of(route, 0.1 * config.sample_step_m)
        state._check(found)
        return state

    @property
    def here(self) -> FloatArray | None:
        """Where the rover is [m], None before it has driven."""
        return self.legs[-1].xy[-1] if self.legs else None

    def offset_of(self, place: FloatArray | None) -> float:
        """Return the distance of a place, the start at first, from the area's edge [m]."""
        starts = self.lines.area.starts
        if place is None and not len(starts):
            return 0.0
        place = starts[0] if place is None else place
        return float(place @ self.lines.left - self.lines.v.min())

    def nearest(self, lines: Sequence[tuple[float, float]]) -> tuple[float, float]:
        """Return the line nearest to the rover, or to the edge where it starts; at first, of those across the main body."""
        if not self.is_fitted:
            swaths = [self.lines.swath(*line, self.wavelength_m) for line in lines]
            lengths = [max((shapely.linestrings(xy).length for xy in swath), default=0.0) for swath in swaths]
            lines = [line for line, m in zip(lines, lengths, strict=True) if m >= _LONG_SHARE * max(lengths)]
        return nearest_line(lines, self.offset_of(self.here))

    @property
    def wavelength_m(self) -> float:
        """Length of the waves of the swaths to come [m]."""
        scales = WavyConfig(swaths=1).wavelength_scales
        return scales * self.posterior.slope_length_m

    @property
    def is_met(self) -> bool:
        """Whether the map of what was driven meets the limit with the required probability."""
        return self.predicted.probability >= self.config.probability

    def further(self, probability: float) -> list[tuple[float, float]] | None:
        """Return the fewest further lines that are predicted to be enough; None where not even the densest survey is.

        A prior, or a few swaths, may make the terrain look rougher than it is: while the probability is not
        negligible, the number of swaths is doubled and predicted again.
        """
        most = self.most - len(self.offsets)
        if most < 1:
            return None

        def is_enough(n_lines: int) -> bool:
            return self._planned_with(self._filled(n_lines)).probability >= probability

        # The swath just driven has made the last plan one shorter, more or less: begin there.
        found = smallest_sufficient(is_enough, first=self.n_further - 1, most=most)
        if found is None:
            self.predicted = self.predicted_with(self._filled(most))
            if self.predicted.probability < (_HOPE if len(self.offsets) >= _LEAST_SEEN else _HOPELESS):
                return None
            found = min(max(_LEAST_SEEN - len(self.offsets), len(self.offsets)), most)
        self.n_further = found
        return self._filled(found)

    def _filled(self, n_lines: int) -> list[tuple[float, float]]:
        return gaps_filled(self.offsets, self.lines.width_m, n_lines, self.posterior.growth)

    def predicted_with(self, lines: Sequence[tuple[float, float]]) -> MapPrediction:
        """Predict the map once the lines and the ways to them are driven too."""
        return self._predicted(self._samples_with(lines), self.posterior)

    def _planned_with(self, lines: Sequence[tuple[float, float]]) -> MapPrediction:
        """Predict the map as it will be judged once the lines are driven: they settle what samples leave open."""
        settled = replace(self.posterior, open_spread=0.0) if self.is_fitted else self.posterior
        return self._predicted(self._samples_with(lines), settled)

    def _predicted(self, xy: FloatArray, posterior: KernelPosterior) -> MapPrediction:
        """Predict the map of samples at places (N, 2) [m]."""
        found = self.predictor.distribution(xy, posterior).with_shared(self.config.shared_m)
        return MapPrediction(found.probability(self.config.limit_m), found.rmse_m)

    def _samples_with(self, lines: Sequence[tuple[float, float]]) -> FloatArray:
        """Return the places (N, 2) of the samples once the lines and the ways to them are driven too [m]."""
        here = self.here
        left, planned = list(lines), [self.samples]
        while left:
            line = nearest_line(left, self.offset_of(here))
            left.remove(line)
            for piece in self._pieces(line, here):
                driven = piece if here is None else np.vstack([here, piece])
                planned.append(places_along(driven, self.config.sample_step_m))
                here = piece[-1]
        if here is None:
            raise InputError("no swath meets the free ground of the area; ask for another area.")
        return np.vstack(planned)

    def drive(self, line: tuple[float, float], measure: MeasureHeights) -> None:
        """Drive to a line and along it, on free ground alone, and take samples all the way."""
        area, n_before = self.lines.area, len(self.legs)
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
        if len(self.legs) > n_before:
            on_free_ground(Route(tuple(self.legs[n_before:]), area.crs, "adaptive"), area.free)

    def _pieces(self, line: tuple[float, float], here: FloatArray | None) -> list[FloatArray]:
        """Return what is driven on a line, piece by piece from the end that is nearer."""
        pieces = self.lines.swath(*line, self.wavelength_m)
        if here is None or not pieces:
            return pieces
        is_forth = np.hypot(*(pieces[0][0] - here)) <= np.hypot(*(pieces[-1][-1] - here))
        return pieces if is_forth else [xy[::-1] for xy in pieces[::-1]]

    def learn(self) -> None:
        """Fit family, length, variance and noise to all samples, check them on lines left out, and predict the map."""
        self._check(_fitted(self.samples, self.heights, self.config))

    def _check(self, posterior: KernelPosterior) -> None:
        """Check covariances on lines left out, and predict the map of what was driven."""
        line = self.lines.nearest(self.samples, self.offsets)
        self.posterior = checked_by_lines(posterior, self.samples, self.heights, line)
        self.is_fitted = True
        self.predicted = self._predicted(self.samples, self.posterior)


def _fitted(xy: FloatArray, heights: FloatArray, config: AdaptiveConfig) -> KernelPosterior:
    """Return the covariances that samples at places (N, 2) make likely."""
    return posterior_from_survey(
        xy, heights, noise_m=config.noise_m, localization_m=config.localization_m, spread=SURVEY_SPREAD
    )


def places_along(xy: FloatArray, step_m: float) -> FloatArray:
    """Return places (M, 2) every `step_m` along a polyline (N, 2), its start included [m]."""
    require_samples(float(np.hypot(*np.diff(xy, axis=0).T).sum()), step_m, MOST_SAMPLES)
    distance = np.r_[0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T))]
    at = np.arange(0.0, distance[-1] + 1e-9, step_m)
    return np.column_stack([np.interp(at, distance, xy[:, 0]), np.interp(at, distance, xy[:, 1])])


@dataclass(frozen=True)
class AdaptiveSurvey:
    """Result of an adaptive survey.

    `route`: driven route; None if nothing was driven. `samples` (N, 2): places of the samples [m].
    `posterior`: covariances that prior and samples make likely. `predicted`: prediction for the map of the
    route; where the requirement is not met, for the densest survey allowed. `holds`: whether the requirement
    is met. Where it is not, no survey with the allowed swaths meets it.
    """

    route: Route | None
    samples: FloatArray
    posterior: KernelPosterior
    predicted: MapPrediction
    holds: bool


def survey_adaptively(
    area: SurveyArea, posterior: KernelPosterior, config: AdaptiveConfig, measure: MeasureHeights
) -> AdaptiveSurvey:
    """Drive an adaptive survey until its guarantee holds or cannot be reached."""
    state = AdaptiveState(area, posterior, config.in_grid_metres(settings_factor(area)))
    lines = state.further(config.first_probability)
    is_met = False
    while lines is not None and not is_met:
        state.drive(state.nearest(lines), measure)
        if len(state.offsets) >= config.n_first:
            state.learn()
            is_met = state.is_met
            lines = lines if is_met else state.further(config.probability)
        else:
            lines = state.further(config.first_probability)
    route = Route(tuple(state.legs), area.crs, "adaptive") if state.legs else None
    return AdaptiveSurvey(route, state.samples, state.posterior, state.predicted, is_met)


def first_swaths(area: SurveyArea, posterior: KernelPosterior, config: AdaptiveConfig) -> Route:
    """Return the swaths that are driven before the covariance is fitted to samples."""
    state = AdaptiveState(area, posterior, config.in_grid_metres(settings_factor(area)))
    for _ in range(config.n_first):
        lines = state.further(config.first_probability)
        if lines is None:
            raise InputError(
                f"no survey of up to {state.most} swaths is predicted to reach {config.limit_m:g} m here; the densest errs "
                f"{state.predicted.rmse_m:.2f} m, ask for a larger error."
            )
        state.drive(state.nearest(lines), _unmeasured)
    return Route(tuple(state.legs), area.crs, "adaptive")


def next_swath(
    area: SurveyArea, driven: Route, xy: FloatArray, heights: FloatArray, config: AdaptiveConfig
) -> AdaptiveSurvey:
    """Return the swath to drive next, after what was driven and measured.

    `xy`, `heights` (N, 2) and (N,): places and measured heights of all samples [m]. Returns: ``route`` leads
    to the next swath and along it; None when no more is needed (``holds``) or when none is enough.
    ``predicted`` includes all swaths that are planned to follow. The same swaths and samples give the same
    answer, however often they are asked about.
    """
    config = config.in_grid_metres(settings_factor(area))
    state = AdaptiveState.driven(area, driven, xy, heights, config)
    if state.is_met:
        return AdaptiveSurvey(None, xy, state.posterior, state.predicted, True)
    lines = state.further(config.probability)
    if lines is None:
        return AdaptiveSurvey(None, xy, state.posterior, state.predicted, False)
    state.drive(state.nearest(lines), _unmeasured)
    route = Route(tuple(state.legs[len(driven.legs) :]), area.crs, "adaptive")
    return AdaptiveSurvey(route, xy, state.posterior, state.predicted_with(lines), True)


def _unmeasured(xy: FloatArray) -> FloatArray:
    """Return NaN for every place."""
    return np.full(len(xy), np.nan)

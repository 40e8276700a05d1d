r"""Adaptive survey: planned swath by swath while it is driven, until the guarantee holds.

The first swaths are spaced by the prior. Then family, length scale and noise are fitted to the samples taken so
far, and the fewest further swaths are sought that are predicted to meet the requirement: every gap between driven
swaths is cut into equal parts, none wider than a spacing D, and D is reduced until the probability is sufficient.
The nearest of these swaths is driven next; then all is planned again.

The survey may be looked at after each swath. Let A be the event that the map made at the stopping time τ meets the limit.
By the law of total expectation

.. math::  P(A) = E\left[ P(A \mid \text{samples until } \tau) \right] \ge p

where the survey stops only at a probability of p or more, whatever else the rule depends on and however often it is
asked: a posterior probability keeps its meaning under optional stopping (Rouder 2014, Psychonomic Bulletin & Review 21,
301; Hendriksen, de Heide and Grünwald 2021, Bayesian Analysis 16, 961). That needs a posterior that is right on average:
the roughness is therefore checked on lines left out (`planners.guarantee.posterior.left_out`), and what remains is a spread
measured on real ground.
"""

from dataclasses import dataclass

import numpy as np

from planners.ground_metres import settings_factor
from planners.guarantee.adaptive_state import AdaptiveConfig, AdaptiveState, MeasureHeights
from planners.guarantee.posterior.kernel_posterior import KernelPosterior
from planners.guarantee.prediction import MapPrediction
from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.route import Route


@dataclass(frozen=True)
class AdaptiveSurvey:
    """Result of an adaptive survey.

    Parameters
    ----------
    route : Route or None
        Driven route; None if nothing was driven.
    samples : (N, 2) ndarray
        Places of the samples [m].
    posterior : KernelPosterior
        Covariances that prior and samples make likely.
    predicted : MapPrediction
        Prediction for the map of the route; where the requirement is not met, for the densest survey allowed.
    holds : bool
        Whether the requirement is met. Where it is not, no survey with the allowed swaths meets it.
    """

    route: Route | None
    samples: FloatArray
    posterior: KernelPosterior
    predicted: MapPrediction
    holds: bool


def survey_adaptively(
    area: SurveyArea, posterior: KernelPosterior, config: AdaptiveConfig, measure: MeasureHeights
) -> AdaptiveSurvey:
    """Drive an adaptive survey until its guarantee holds or cannot be reached.

    Parameters
    ----------
    area : SurveyArea
        What is to be mapped.
    posterior : KernelPosterior
        Covariances from the prior.
    config : AdaptiveConfig
        Requirement on the map, and errors of the samples.
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
    """Return the swaths that are driven before the covariance is fitted to samples.

    Parameters
    ----------
    area : SurveyArea
        What is to be mapped.
    posterior : KernelPosterior
        Covariances from the prior.
    config : AdaptiveConfig
        Requirement on the map, and errors of the samples.

    Returns
    -------
    Route
        The first `AdaptiveConfig.n_first` swaths with their transits.

    Raises
    ------
    InputError
        No survey of the swaths allowed is predicted to meet the requirement.
    """
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

    Parameters
    ----------
    area : SurveyArea
        What is to be mapped.
    driven : Route
        Everything driven so far, by one rover.
    xy, heights : (N, 2) and (N,) ndarray
        Places and measured heights of all samples [m].
    config : AdaptiveConfig
        Requirement on the map, and errors of the samples.

    Returns
    -------
    AdaptiveSurvey
        ``route`` leads to the next swath and along it; None when no more is needed (``holds``) or when none is
        enough. ``predicted`` includes all swaths that are planned to follow. The same swaths and samples give the
        same answer, however often they are asked about.

    Raises
    ------
    InputError
        Too few samples to fit a covariance, or an area that no swath meets.
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

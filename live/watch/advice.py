"""Next swath and its gain after what was measured, or the end of the survey.

The rule is that of `planners.guarantee.adaptive`: the survey ends when the probability that its map meets the limit is
large enough. It may be asked after every swath, since a posterior probability keeps its meaning under optional stopping.
"""

from typing import NamedTuple

import numpy as np

from planners.ground_metres import settings_factor
from planners.guarantee.adaptive_state import AdaptiveConfig, AdaptiveState
from planners.guarantee.prediction import MapPrediction
from survey.core.arrays import FloatArray
from survey.data.area import SurveyArea
from survey.data.route import Leg, Route
from survey.reconstruction.gp.kernels import Kernel


class Advice(NamedTuple):
    """What to do next.

    Parameters
    ----------
    now : MapPrediction
        Probability of the limit, and error, of the map of what was driven.
    with_next : MapPrediction or None
        The same with the next swath.
    with_all : MapPrediction or None
        The same with all swaths that are planned to follow.
    legs : tuple of Leg
        Way to the next swath and along it; empty where the survey ends.
    is_met : bool
        Whether the limit holds with the probability asked for.
    kernel : Kernel
        Likeliest covariance of the terrain.
    unseen_m2 : float
        Variance of relief so fine that samples show it as noise [m²].
    """

    now: MapPrediction
    with_next: MapPrediction | None
    with_all: MapPrediction | None
    legs: tuple[Leg, ...]
    is_met: bool
    kernel: Kernel
    unseen_m2: float


def advised(
    area: SurveyArea, driven: list[Leg], xy: FloatArray, heights: FloatArray, config: AdaptiveConfig
) -> Advice:
    """Return the next swath, or that the survey ends.

    Parameters
    ----------
    area : SurveyArea
        What is to be mapped.
    driven : list of Leg
        What was driven so far, by one rover.
    xy, heights : (N, 2) and (N,) ndarray
        Places and heights of the samples [m].
    config : AdaptiveConfig
        Requirement on the map, and errors of the samples.

    Returns
    -------
    Advice
        No legs and ``is_met`` False where no survey of the swaths allowed would do.

    Raises
    ------
    InputError
        Too few samples to fit a covariance.
    """
    in_grid = config.in_grid_metres(settings_factor(area))
    state = AdaptiveState.driven(area, Route(tuple(driven), area.crs, "adaptive"), xy, heights, in_grid)
    likeliest = state.posterior.likeliest
    now = state.predicted
    lines = None if state.is_met else state.further(in_grid.probability)
    if lines is None:
        return Advice(now, None, None, (), state.is_met, likeliest.kernel, likeliest.unseen_m2)
    line = state.nearest(lines)
    with_next, with_all = state.predicted_with([line]), state.predicted_with(lines)
    state.drive(line, _unmeasured)
    legs = tuple(state.legs[len(driven) :])
    return Advice(now, with_next, with_all, legs, False, likeliest.kernel, likeliest.unseen_m2)


def _unmeasured(xy: FloatArray) -> FloatArray:
    return np.full(len(xy), np.nan)

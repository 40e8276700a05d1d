"""Causes of wrong predictions beforehand: what of the roughness of a window its prior does not show.

The logarithm of actual over predicted error is compared with that of the roughness of the terrain over the one that the
covariances have. The roughness is the root mean square of second differences of heights, z(x - h) - 2 z(x) + z(x + h):
over half a cell of the prior (its level), from there to half the distance of the swaths (its growth), and across the swaths
over that in all directions (its grain).
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from benchmarks.promise_on_real_ground.surveys import Outcome, Task, requirement_of
from benchmarks.promise_on_real_ground.windows import site_of
from benchmarks.report import Row
from planners.guarantee.guarantee import posterior_of
from planners.guarantee.survey_lines import SurveyLines
from planners.prediction.kernel_posterior import KernelPosterior
from planners.swaths.heading import across_marked_grain
from survey.core.arrays import FloatArray
from survey.data.dem import Dem

_FAR = 0.6
"""Predicted over actual error, below which a window is one of those predicted worst."""
_NAMES = {
    "error": "error",
    "level": "roughness over half a cell",
    "growth": "growth of the roughness to the swaths",
    "grain": "roughness across the swaths",
}


@dataclass(frozen=True)
class Cause:
    """Logarithms of actual over predicted: of the error, of level and growth of the roughness, and of its grain."""

    error: float
    level: float
    growth: float
    grain: float


def cause_rows(causes: Sequence[Cause]) -> Iterator[Row]:
    """Yield how far each cause varies from window to window, how it goes with the error, and its mean where that is large."""
    values = {name: np.array([asdict(one)[name] for one in causes]) for name in asdict(causes[0])}
    is_far = values["error"] > -np.log(_FAR)
    for name, one in values.items():
        where = f"beforehand, log of actual over predicted {_NAMES[name]}"
        yield Row(f"{where}: standard deviation", float(one.std()), "")
        if name != "error":
            correlation = float(np.corrcoef(values["error"], one)[0, 1])
            yield Row(f"{where}: correlation with that of the error", correlation, "")
        if is_far.any():
            far = f"{int(is_far.sum())} windows predicted below {_FAR:g} of the error"
            yield Row(f"{where}: mean of {far}", float(one[is_far].mean()), "")


def cause_of(task: Task, outcome: Outcome) -> Cause:
    """Compare the roughness of a window with the one that its prior makes likely."""
    site = site_of(task.landscape, task.index)
    posterior = posterior_of(site.area, site.prior, requirement_of(site, task))
    heading_deg = across_marked_grain(site.area.free, site.prior)
    apart_m = SurveyLines(site.area, heading_deg).width_m / max(outcome.n_swaths, 1)
    lags_m = 0.5 * site.prior.step_m, 0.5 * apart_m
    level, at_swaths = (_log_actual(site.terrain, lag) - _log_predicted(posterior, lag) for lag in lags_m)
    along = _second_differences(site.terrain, lags_m[1])
    across = along[0] if abs(np.sin(np.radians(heading_deg))) < np.sqrt(0.5) else along[1]
    grain = float(np.log(across)) - _log_actual(site.terrain, lags_m[1])
    return Cause(float(np.log(outcome.rmse_m / outcome.predicted_m)), level, at_swaths - level, grain)


def _second_differences(terrain: Dem, lag_m: float) -> FloatArray:
    """Return the root mean square second difference north and east over a lag, to the nearest cell [m]."""
    n, heights = max(round(lag_m / terrain.step_m), 1), terrain.elevation
    found = [one[2 * n :] - 2.0 * one[n:-n] + one[: -2 * n] for one in (heights, heights.T)]
    return np.array([np.sqrt(np.mean(np.square(one))) for one in found])


def _log_actual(terrain: Dem, lag_m: float) -> float:
    """Return the logarithm of the roughness of the terrain over a lag [log m]."""
    return 0.5 * float(np.log(np.mean(np.square(_second_differences(terrain, lag_m)))))


def _log_predicted(posterior: KernelPosterior, lag_m: float) -> float:
    """Return the logarithm of the roughness of the covariances over a lag [log m]."""
    lags = np.array([[lag_m, 0.0], [2.0 * lag_m, 0.0]])
    logs = []
    for one in posterior.kernels:
        near, far = one.kernel.covariance_of_lag(lags)
        logs.append(0.5 * float(np.log(6.0 * one.variance_m2 - 8.0 * near + 2.0 * far)))
    return float(np.dot([one.weight for one in posterior.kernels], logs))

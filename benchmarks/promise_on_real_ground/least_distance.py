"""Least distance of surveys whose error is predicted with a spread: what a probability costs where nothing else is lost.

Let s be the standard deviation of the logarithm of actual over predicted error. A survey that meets a limit L with
probability p has a predicted error of at most L exp(-z s), with the normal quantile z of p. The shortest lawnmower whose actual error is
that small is the least distance: its planner knows the error of every lawnmower but for the spread s.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

import planners
from benchmarks.promise_on_real_ground.surveys import (
    STEP_M,
    Outcome,
    Task,
    measured,
    prior_map_error_m,
    stored,
)
from benchmarks.promise_on_real_ground.windows import site_of
from planners.prediction.places import places

_MOST_SWATHS = 30
_LEAST_SHARE = 0.38
"""Share of the limit at which no denser lawnmower is tried."""


@dataclass(frozen=True)
class Lawnmowers:
    """Lengths and actual errors [m] of lawnmowers of two, three and more swaths on a window."""

    lengths_m: list[float]
    errors_m: list[float]

    def least_m(self, limit_m: float) -> float:
        """Return the length of the first lawnmower that meets a limit [m]; of the last one where none does."""
        met = [
            length for length, error in zip(self.lengths_m, self.errors_m, strict=True) if error <= limit_m
        ]
        return met[0] if met else self.lengths_m[-1]


def lawnmowers_of(task: Task) -> Lawnmowers:
    """Return the lawnmowers of the window of a task, stored under its name."""
    name = f"{task.landscape}-{task.index}-lawnmowers".replace(" ", "_")
    return stored(name, lambda: _lawnmowers(task), lambda record: Lawnmowers(**record))  # type: ignore[arg-type]


def _lawnmowers(task: Task) -> Lawnmowers:
    """Survey a window by more and more swaths, until the error is far below the limit."""
    site = site_of(task.landscape, task.index)
    found = Lawnmowers([], [])
    for n in range(2, _MOST_SWATHS + 1):
        route = planners.plan(site.area, None, planners.LawnmowerConfig(swaths=n))
        xy = places(route, STEP_M)
        found.lengths_m.append(route.length_m)
        found.errors_m.append(
            prior_map_error_m(site, xy, measured(site, task, xy, "oracle", n), task.noise_m)
        )
        if found.errors_m[-1] <= _LEAST_SHARE * site.limit_m:
            break
    return found


def spread_of(outcomes: Sequence[Outcome]) -> float:
    """Return the standard deviation of the logarithm of actual over predicted error."""
    return float(np.std([np.log(one.rmse_m / one.predicted_m) for one in outcomes]))


def share_of_limit(probability: float, spread: float) -> float:
    """Return the predicted error over the limit at which the limit is met with a probability, exp(-z s).

    Examples
    --------
    >>> round(share_of_limit(0.95, 0.2), 2)
    0.72
    """
    return float(np.exp(-ndtri(probability) * spread))

r"""Velocity of a stake or of a receiver that stands on the ice, from a series of its positions, and its prediction.

Each coordinate follows a mean velocity, velocities u that come and go, and errors of the positions:

.. math::  x(t) = x_0 + \bar v t + \int_0^t u + \epsilon, \qquad \operatorname{cov}(u(s), u(t)) = \sigma_u^2 e^{-|s - t| / \tau}

Sizes and the time τ are not estimated: predictions are averaged over a grid of them, weighted by their evidence, so that a
short series does not claim that the ice is steady.
"""

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import softmax

from survey.core.arrays import FloatArray, checked
from survey.core.errors import InputError

# Changes of velocity over the mean speed, their times over the length of the series, and errors of positions [m].
_CHANGES, _TIMES, _ERRORS_M = (
    (0.003, 0.01, 0.03, 0.1, 0.3, 1.0),
    (0.03, 0.1, 0.3, 1.0, 3.0),
    (0.01, 0.03, 0.1, 0.3),
)
_ANY_M_PER_DAY, _ANY_M = 30.0, 1e4
# Positions that are used; more of them are thinned evenly.
_MOST = 160
_LEAST = 6


class PredictedPosition(NamedTuple):
    """Coordinates at times and the velocity between the first and the last of these.

    Parameters
    ----------
    position_m : (M,) ndarray
        Predicted readings [m].
    sigma_m : (M,) ndarray
        Standard deviations, errors of the readings included [m].
    velocity_m_per_day : float
        Mean velocity of the series that was observed [m/day].
    velocity_sigma_m_per_day : float
        Its standard deviation as the velocity of later times [m/day].
    """

    position_m: FloatArray
    sigma_m: FloatArray
    velocity_m_per_day: float
    velocity_sigma_m_per_day: float


@dataclass(frozen=True)
class _Model:
    """Sizes of one point of the grid: changes of velocity [m/day], their time [day], errors of positions [m]."""

    change: float
    time_days: float
    error_m: float

    def moved(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return the covariance (N, M) of the paths at times (N,) and (M,) [days]."""
        s, t, tau = a[:, None], b[None], self.time_days
        earlier = np.minimum(s, t)
        wandering = (
            2.0 * earlier / tau - 1.0 + np.exp(-s / tau) + np.exp(-t / tau) - np.exp(-np.abs(s - t) / tau)
        )
        covariance: FloatArray = (self.change * tau) ** 2 * wandering + _ANY_M**2 + _ANY_M_PER_DAY**2 * s * t
        return covariance

    def velocity(self, a: FloatArray) -> FloatArray:
        """Return the covariance (N,) of the paths with the mean velocity."""
        return _ANY_M_PER_DAY**2 * a


def predict_position(time_days: FloatArray, position_m: FloatArray, at_days: FloatArray) -> PredictedPosition:
    """Predict one coordinate of a stake at later times from a series of its positions.

    Parameters
    ----------
    time_days : (N,) array_like
        Increasing times [days].
    position_m : (N,) array_like
        Easting, northing or elevation [m]; at least 6.
    at_days : (M,) array_like
        Times of the prediction [days], not before the first one.

    Returns
    -------
    PredictedPosition
        Means and standard deviations of a mixture over all sizes.

    Raises
    ------
    InputError
        Too few positions, or times that do not increase.

    Examples
    --------
    >>> days = np.linspace(0.0, 4.0, 30)
    >>> found = predict_position(days, 1.5 * days, np.array([8.0]))
    >>> bool(abs(found.position_m[0] - 12.0) < 2.0 * found.sigma_m[0])
    True
    """
    times = checked(time_days, (None,), "the times of the series")
    places = checked(position_m, (len(times),), "the positions of the series")
    if len(times) < _LEAST or (np.diff(times) <= 0.0).any():
        raise InputError(
            f"a series of {len(times)} positions was given; at least {_LEAST} at increasing times are needed."
        )
    kept = np.unique(np.linspace(0, len(times) - 1, min(_MOST, len(times))).round().astype(int))
    first, level = times[0], places[0]
    span = times[-1] - first
    speed = max(abs(places[-1] - level) / span, 0.01)
    grid = [_Model(c * speed, t * span, e) for c, t, e in product(_CHANGES, _TIMES, _ERRORS_M)]
    seen = [
        _posterior(one, times[kept] - first, places[kept] - level, np.asarray(at_days) - first)
        for one in grid
    ]
    weights = softmax([evidence for evidence, _, _ in seen])
    means, variances = (np.array([part[k] for part in seen]) for k in (1, 2))
    mean = weights @ means
    spread = weights @ (variances + (means - mean) ** 2)
    sigma = np.sqrt(spread)
    return PredictedPosition(mean[:-1] + level, sigma[:-1], float(mean[-1]), float(sigma[-1]))


def _posterior(
    model: _Model, times: FloatArray, places: FloatArray, at: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Return the log evidence, and mean and variance of later readings and of the velocity."""
    covariance = model.moved(times, times) + model.error_m**2 * np.eye(len(times))
    factor = cho_factor(covariance, lower=True)
    solved = cho_solve(factor, places)
    evidence = -0.5 * float(places @ solved) - float(np.log(np.diag(factor[0])).sum())
    cross = np.column_stack([model.moved(times, at), model.velocity(times)])
    prior = np.r_[np.diag(model.moved(at, at)) + model.error_m**2, _ANY_M_PER_DAY**2 + model.change**2]
    mean = cross.T @ solved
    variance = prior - np.sum(cross * cho_solve(factor, cross), axis=0)
    return evidence, mean, np.maximum(variance, model.error_m**2 * 1e-6)

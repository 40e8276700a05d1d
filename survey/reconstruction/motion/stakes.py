r"""Velocity of the ice from positions of stakes: joint fit of repeated surveys, and prediction from the series of one.

A stake i at p_i of the epoch is surveyed at the time t with an error of σ:

.. math::  y = p_i + m(p_i, t) + \epsilon, \qquad m = \text{displacement, linear in the unknowns}

`motion_with_stakes` eliminates the positions by weighted means over each stake: the residuals about them depend on the
rates alone. Where stakes scatter about smooth fields by more than they err, as in crevassed ice, errors are widened.

`predict_position` takes the series of one stake, or of a receiver that stands on the ice. Each coordinate follows a
mean velocity, velocities u that come and go, and errors of the positions:

.. math::  x(t) = x_0 + \bar v t + \int_0^t u + \epsilon, \qquad \operatorname{cov}(u(s), u(t)) = \sigma_u^2 e^{-|s - t| / \tau}

Sizes and the time τ are not estimated: predictions are averaged over a grid of them, weighted by their evidence, so that a
short series does not claim that the ice is steady.
"""

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import chdtrc, softmax

from survey.core import FloatArray, InputError, checked
from survey.data import IceMotion
from survey.data.sensors.stakes import Stakes, StakeSurveys

# Scatter that is less probable than this is taken for that of the ice.
_UNLIKELY = 0.01


def mean_stakes(surveys: StakeSurveys) -> Stakes:
    """Return the mean place of each stake, at the mean time of its surveys."""
    weight, total = _weights(surveys)
    place = _sums(surveys, surveys.position * weight[:, None]) / total[:, None]
    time_s = _sums(surveys, surveys.time_s * weight) / total
    return Stakes(place, total**-0.5, time_s)


def motion_with_stakes(motion: IceMotion, surveys: StakeSurveys) -> IceMotion:
    """Return the motion after repeated surveys of stakes."""
    design, value = _relative(motion, surveys)
    scale = _widening(design, value, 3 * len(mean_stakes(surveys)))
    information = np.linalg.inv(motion.spread) + design.T @ design / scale
    spread: FloatArray = np.asarray(np.linalg.inv(information), dtype=np.float64)
    right = np.linalg.solve(motion.spread, motion.expected) + design.T @ value / scale
    posterior = motion.updated(np.asarray(spread @ right, dtype=np.float64), spread)
    return IceMotion.of(
        posterior.coefficients, posterior.covariance, epoch_s=motion.epoch_s, origin_m=motion.origin_m
    )


def _relative(motion: IceMotion, surveys: StakeSurveys) -> tuple[FloatArray, FloatArray]:
    """Return whitened rows (3 N, R) and values (3 N,) of the surveys about the means of their stakes."""
    at_stake = mean_stakes(surveys).position[surveys.index, :2]
    moved = motion.displacement(at_stake, surveys.time_s)
    by = motion.derivatives(at_stake, surveys.time_s).reshape(len(surveys), -1)
    value = _about_means(surveys, surveys.position - moved) / surveys.sigma_m[:, None]
    design = _about_means(surveys, by) / surveys.sigma_m[:, None]
    return design.reshape(3 * len(surveys), -1), value.ravel()


def _widening(design: FloatArray, value: FloatArray, n_eliminated: int) -> float:
    """Return the factor of the variances of the surveys: 1 unless they scatter by more than chance."""
    n_left = len(value) - n_eliminated - (int(np.linalg.matrix_rank(design)) if design.size else 0)
    if n_left < 1:
        return 1.0
    residual = value - design @ np.linalg.lstsq(design, value)[0] if design.size else value
    squared = float(residual @ residual)
    return squared / n_left if chdtrc(n_left, squared) < _UNLIKELY else 1.0


def _about_means(surveys: StakeSurveys, values: FloatArray) -> FloatArray:
    """Return values (N, D) less the weighted mean of their stake."""
    weight, total = _weights(surveys)
    mean = _sums(surveys, values * weight[:, None]) / total[:, None]
    about: FloatArray = values - mean[surveys.index]
    return about


def _weights(surveys: StakeSurveys) -> tuple[FloatArray, FloatArray]:
    """Return the weight of each survey (N,), and their sum for each stake (K,) [1/m²]."""
    weight: FloatArray = surveys.sigma_m**-2.0
    total = _sums(surveys, weight)
    if (total == 0.0).any():
        raise InputError(
            f"stake {int(np.flatnonzero(total == 0.0)[0])} was never surveyed; number the stakes from 0 without gaps."
        )
    return weight, total


def _sums(surveys: StakeSurveys, values: FloatArray) -> FloatArray:
    """Return the sums of values (N, …) over each stake (K, …)."""
    sums = np.zeros((int(surveys.index.max()) + 1, *values.shape[1:]))
    np.add.at(sums, surveys.index, values)
    return sums


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

    `position_m` (M,): predicted readings [m]. `sigma_m` (M,): standard deviations, errors of the readings
    included [m]. `velocity_m_per_day`: mean velocity of the series that was observed [m/day].
    `velocity_sigma_m_per_day`: its standard deviation as the velocity of later times [m/day].
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

    `time_days` (N,): increasing times [days]. `position_m` (N,): easting, northing or elevation [m]; at least
    6. `at_days` (M,): times of the prediction [days], not before the first one.

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

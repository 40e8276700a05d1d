r"""Velocity and lowering from stakes that were surveyed repeatedly.

A stake i at p_i of the epoch is surveyed at the time t with an error of σ:

.. math::  y = p_i + m(p_i, t) + \epsilon, \qquad m = \text{displacement, linear in the unknowns}

The positions are eliminated by weighted means over each stake: the residuals about them depend on the rates alone. Where stakes scatter about smooth fields by more than they err, as in crevassed ice, errors are widened.
"""

import numpy as np
from scipy.special import chdtrc

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.ice.motion import IceMotion
from survey.data.sensors.stakes import Stakes, StakeSurveys

# Scatter that is less probable than this is taken for that of the ice.
_UNLIKELY = 0.01


def mean_stakes(surveys: StakeSurveys) -> Stakes:
    """Return the mean place of each stake, at the mean time of its surveys.

    Parameters
    ----------
    surveys : StakeSurveys
        At least one of each stake.

    Returns
    -------
    Stakes
        With times; their errors do not correlate with those of a constant velocity.

    Raises
    ------
    InputError
        A stake without a survey.
    """
    weight, total = _weights(surveys)
    place = _sums(surveys, surveys.position * weight[:, None]) / total[:, None]
    time_s = _sums(surveys, surveys.time_s * weight) / total
    return Stakes(place, total**-0.5, time_s)


def motion_with_stakes(motion: IceMotion, surveys: StakeSurveys) -> IceMotion:
    """Return the motion after repeated surveys of stakes.

    Parameters
    ----------
    motion : IceMotion
        Prior.
    surveys : StakeSurveys
        Stakes that were surveyed once say nothing of the motion.

    Returns
    -------
    IceMotion
        Posterior; its unknowns are independent again.
    """
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

"""Conflicts between a prior elevation model and the points."""

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import chdtrc

from survey.core.arrays import FloatArray
from survey.reconstruction.prior.error_sizes import Innovations
from survey.reconstruction.prior.products import ErrorScale

# An offset beyond these many standard deviations is a conflict; so is a misfit less likely than this.
_SIGMAS, _LEAST_LIKELY = 3.0, 1e-3
# A fitted size of an error this many times larger than the product's is a conflict.
_TOO_LARGE = 3.0
# This share of priors have a level that their error model does not allow; the logarithm of such an offset is uniform
# between these sizes [m].
_WRONG_SHARE, _WRONG_M = 0.05, (0.1, 100.0)


class Level(NamedTuple):
    """Vertical offset of a prior from the points.

    Parameters
    ----------
    offset_m : float
        Prior less points, by generalized least squares [m].
    sigma_m : float
        Its standard deviation from points and cells [m].
    assumed_sigma_m : float
        Standard deviation that the prior's error model allows for an offset [m].
    """

    offset_m: float
    sigma_m: float
    assumed_sigma_m: float

    @property
    def in_sigmas(self) -> float:
        """Offset over its expected standard deviation."""
        return abs(self.offset_m) / float(np.hypot(self.sigma_m, self.assumed_sigma_m))

    @property
    def is_conflict(self) -> bool:
        """Whether the offset is beyond three standard deviations."""
        return self.in_sigmas > _SIGMAS

    @property
    def probability(self) -> float:
        """Probability that the error model of the prior holds, and the points err by as much.

        By Bayes' rule against a wrong level: one in twenty priors has one, of any size from 0.1 to 100 m.
        """
        sigma_m = float(np.hypot(self.sigma_m, self.assumed_sigma_m))
        allowed = np.exp(-0.5 * self.in_sigmas**2) / (np.sqrt(2.0 * np.pi) * sigma_m)
        size_m = float(np.clip(abs(self.offset_m), *_WRONG_M))
        wrong = 1.0 / (2.0 * size_m * np.log(_WRONG_M[1] / _WRONG_M[0]))
        return float(allowed * (1.0 - _WRONG_SHARE) / (allowed * (1.0 - _WRONG_SHARE) + wrong * _WRONG_SHARE))


def level(innovations: Innovations, assumed_sigma_m: float) -> Level:
    """Return the vertical offset of cells whose covariance leaves an offset out.

    Parameters
    ----------
    innovations : Innovations
        Cells less what points alone state, with the covariance of all errors but the offset.
    assumed_sigma_m : float
        Standard deviation that the error model allows for the offset [m].

    Returns
    -------
    Level
        The offset and its standard deviation.
    """
    factor = cho_factor(innovations.covariance, lower=True)
    ones = np.ones(len(innovations.value_m))
    weights = cho_solve(factor, ones)
    information = float(ones @ weights)
    return Level(float(weights @ innovations.value_m) / information, information**-0.5, assumed_sigma_m)


def conflicts(
    found: Level,
    innovations: Innovations,
    white_m: float,
    expected: ErrorScale,
    level_probability: float = 0.0,
) -> tuple[str, ...]:
    """Return one sentence for every conflict, with its size.

    Parameters
    ----------
    found : Level
        Vertical offset of the prior.
    innovations : Innovations
        Cells less what points alone state, with the covariance of all errors.
    white_m : float
        Independent error of a cell, as it was estimated [m].
    expected : ErrorScale
        The same as the product's class has it.
    level_probability : float
        Probability with which a level that contradicts the points is used all the same.

    Returns
    -------
    tuple of str
        Empty where prior and points agree.
    """
    sentences = []
    if found.is_conflict:
        used = (
            f"counts with a probability of {100.0 * level_probability:.0f} %"
            if level_probability
            else "is not used"
        )
        sentences.append(
            f"the prior lies {abs(found.offset_m):.2f} m {'above' if found.offset_m > 0.0 else 'below'} the points, "
            f"{found.in_sigmas:.1f} standard deviations of what is expected; its level {used}, check its vertical datum."
        )
    if np.isfinite(expected.log_sd) and white_m > _TOO_LARGE * expected.median_m:
        sentences.append(
            f"the prior's cells differ from the points by {white_m:.2f} m each, and {expected.median_m:.2f} m was expected of this "
            "class of product; they count with the larger value."
        )
    chance = misfit_chance(innovations)
    if not found.is_conflict and chance < _LEAST_LIKELY:
        sentences.append(
            f"the prior's cells contradict the points (chance {chance:.1e} under the error model); check place, date and "
            "class of the prior."
        )
    return tuple(sentences)


def misfit_chance(innovations: Innovations) -> float:
    """Return the chance that cells differ from the points by as much, by their χ².

    Parameters
    ----------
    innovations : Innovations
        Cells less what points alone state, with the covariance of all errors.

    Returns
    -------
    float
        Upper tail probability.
    """
    value: FloatArray = innovations.value_m
    squared = float(value @ cho_solve(cho_factor(innovations.covariance, lower=True), value))
    return float(chdtrc(len(value), squared))


def misfit_log_likelihood(innovations: Innovations) -> float:
    """Return the log likelihood of cells with an offset, up to a constant.

    Parameters
    ----------
    innovations : Innovations
        Cells less what points alone state, with the covariance of all errors but the offset.

    Returns
    -------
    float
        Log density of the innovations [nats].
    """
    factor, value = cho_factor(innovations.with_level, lower=True), innovations.value_m
    return float(-0.5 * value @ cho_solve(factor, value) - np.log(np.diag(factor[0])).sum())

"""Chance of the coverage of the worst of several maps, where the standard deviation of their levels is right."""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm

_QUANTILE = float(norm.ppf(0.975))
_FARTHEST = 8.0


def coverage_at(level: float, share: float) -> float:
    """Return the coverage of the 95 % interval on a map whose level is off by some of its standard deviations.

    Errors beside the level are independent from node to node and as large as stated.

    Parameters
    ----------
    level : float
        Error of the level over its standard deviation.
    share : float
        Share of the level in the variance of the map, from 0 to 1, 1 excluded.

    Examples
    --------
    >>> [round(coverage_at(level, 0.4), 2) for level in (0.0, 1.0, 2.0)]
    [0.99, 0.96, 0.81]
    """
    offset, rest = level * np.sqrt(share), np.sqrt(1.0 - share)
    return float(norm.cdf((_QUANTILE - offset) / rest) - norm.cdf((-_QUANTILE - offset) / rest))


def chance_of_worst(shares: Sequence[float], least: float) -> float:
    """Return the chance that every map has a coverage of at least a value.

    Levels are independent and normal, their standard deviations as stated. Where other errors are correlated over a
    map too, the chance is smaller.

    Parameters
    ----------
    shares : sequence of float
        Share of the level in the variance of each map, from 0 to 1, 1 excluded.
    least : float
        Coverage, below 0.95.

    Examples
    --------
    >>> [round(chance_of_worst([0.4] * n, 0.85), 2) for n in (1, 5, 10)]
    [0.93, 0.71, 0.5]
    """
    return float(np.prod([_chance(share, least) for share in shares]))


def _chance(share: float, least: float) -> float:
    """Return the chance that one map has at least this coverage, which falls with the error of the level."""
    if coverage_at(_FARTHEST, share) >= least:
        return 1.0
    farthest = brentq(lambda level: coverage_at(level, share) - least, 0.0, _FARTHEST)
    return float(2.0 * norm.cdf(farthest) - 1.0)

"""Confidence intervals of an RMSE."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy.special import gammaincinv

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.core.streams import stream

# A mean farther from 0 than this many of its standard errors counts as a bias.
_BIASED = 1.959964
_N_RESAMPLES = 4000


def rmse_factors(n: int, level: float = 0.95) -> tuple[float, float]:
    r"""Return what an observed RMSE is to be multiplied by for the ends of its interval.

    .. math::  \sqrt{n / \chi^2_{n,\,1-\alpha/2}} \quad\text{and}\quad \sqrt{n / \chi^2_{n,\,\alpha/2}}

    for normal, independent errors without bias. With n − 1 in place of n on both sides it is
    the interval of a standard deviation.

    Examples
    --------
    >>> [round(factor, 4) for factor in rmse_factors(20)]
    [0.7651, 1.4441]
    """
    if n < 1 or not 0.0 < level < 1.0:
        raise InputError(f"an interval at the level {level} of {n} errors does not exist; give one or more.")
    tail = 0.5 * (1.0 - level)
    low, high = 2.0 * gammaincinv(0.5 * n, [1.0 - tail, tail])  # quantiles of χ²
    return float(np.sqrt(n / low)), float(np.sqrt(n / high))


@dataclass(frozen=True)
class RmseInterval:
    """The 95 % interval of an RMSE.

    Parameters
    ----------
    low_m, high_m : float
        Its ends [m].
    method : str
        ``chi-square`` for errors whose mean does not differ from 0; ``bootstrap`` where it
        does, for then their squares follow no χ² distribution.
    """

    low_m: float
    high_m: float
    method: str

    @classmethod
    def of(cls, errors: Any) -> Self:
        """Return the interval of independent errors (N,) [m].

        Parameters
        ----------
        errors : (N,) array_like
            Independent errors [m].

        Returns
        -------
        RmseInterval
            Its ends and the method.

        Notes
        -----
        Nodes of one map are no independent errors: use this for checkpoints that lie apart.
        The bootstrap is too narrow for fewer than about ten errors. Equal errors give equal intervals.

        Examples
        --------
        >>> interval = RmseInterval.of([0.1, -0.1, 0.1, -0.1, 0.1])
        >>> round(interval.low_m, 4), round(interval.high_m, 4), interval.method
        (0.0624, 0.2453, 'chi-square')
        """
        e = np.asarray(errors, dtype=np.float64).ravel()
        n = len(e)
        low, high = rmse_factors(n)
        rmse = float(np.sqrt(np.mean(e**2)))
        if n < 3 or abs(e.mean()) <= _BIASED * e.std(ddof=1) / np.sqrt(n):
            return cls(low * rmse, high * rmse, "chi-square")
        return cls(*_resampled(e), "bootstrap")


def _resampled(e: FloatArray) -> tuple[float, float]:
    """Return the percentiles of the RMSE over samples drawn with replacement; always the same draws for equal errors."""
    rng = stream(len(e), "rmse bootstrap")
    squares = (e**2)[rng.integers(0, len(e), (_N_RESAMPLES, len(e)))].mean(axis=1)
    low, high = np.sqrt(np.percentile(squares, (2.5, 97.5)))
    return float(low), float(high)

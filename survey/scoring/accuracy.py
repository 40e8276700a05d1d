"""Error statistics of a map, and the calibration of its stated uncertainty."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy.special import ndtri

from survey.core.errors import InputError

NMAD_FACTOR = 1.4826
"""Makes the median absolute deviation of normal errors equal their standard deviation."""
LEVELS = (*(round(0.05 * k, 2) for k in range(1, 20)), 0.99)
"""Two-sided nominal levels at which the calibration is measured."""


@dataclass(frozen=True)
class ErrorStatistics:
    r"""Statistics of the errors *map minus reference*.

    Parameters
    ----------
    n : int
        Number of errors.
    rmse_m : float
        Root mean square, divided by n [m]; :math:`rmse^2 = bias^2 + std^2`.
    bias_m : float
        Mean [m]; positive when the map lies too high.
    std_m : float
        Standard deviation, divided by n [m].
    median_m : float
        Median [m].
    nmad_m : float
        :math:`1.4826 \cdot \mathrm{median}|e - \mathrm{median}(e)|` [m], Höhle and Höhle
        (2009): the standard deviation of normal errors, blind to outliers.
    p95_m : float
        95th percentile of \|e\| [m], interpolated linearly between ranks.
    worst_m : float
        Largest \|e\| [m].
    skewness : float
        Third standardised moment; NaN when all errors are equal.
    kurtosis : float
        Fourth standardised moment less 3, so that normal errors have 0; NaN likewise.
    """

    n: int
    rmse_m: float
    bias_m: float
    std_m: float
    median_m: float
    nmad_m: float
    p95_m: float
    worst_m: float
    skewness: float
    kurtosis: float

    @classmethod
    def of(cls, errors: Any) -> Self:
        """Summarise errors (N,) [m]; NaN is refused, for the caller must say what it leaves out.

        Parameters
        ----------
        errors : (N,) array_like
            Map minus reference [m].

        Returns
        -------
        ErrorStatistics
            Of all errors with equal weight.

        Notes
        -----
        Neighbouring nodes of a map err alike, so n is no number of independent checks.

        Examples
        --------
        >>> ErrorStatistics.of([3.0, -4.0, 0.0, 1.0]).rmse_m
        2.55
        """
        e = np.asarray(errors, dtype=np.float64).ravel()
        if len(e) == 0 or not np.isfinite(e).all():
            raise InputError(
                f"{int((~np.isfinite(e)).sum())} of {len(e)} errors are NaN or infinite; statistics need one or more finite ones."
            )
        bias, std, median = float(e.mean()), float(e.std()), float(np.median(e))
        shape = (e - bias) / std if std > 0.0 else np.full_like(e, np.nan)
        return cls(
            n=len(e),
            rmse_m=float(np.sqrt(np.mean(e**2))),
            bias_m=bias,
            std_m=std,
            median_m=median,
            nmad_m=NMAD_FACTOR * float(np.median(np.abs(e - median))),
            p95_m=float(np.percentile(np.abs(e), 95.0)),
            worst_m=float(np.abs(e).max()),
            skewness=float(np.mean(shape**3)),
            kurtosis=float(np.mean(shape**4)) - 3.0,
        )


@dataclass(frozen=True)
class Calibration:
    """Whether errors are as large as the map states.

    Parameters
    ----------
    levels : (K,) tuple of float
        Nominal two-sided levels, 0 to 1.
    shares : (K,) tuple of float
        Share of the errors within the normal interval of that level; equal to `levels` for
        a calibrated map, smaller where its standard deviations are too small.
    coverage_95 : float
        The share within ±1.96 standard deviations.
    z_rms : float
        Root mean square of error over stated standard deviation; 1 when it is right.
    n : int
        Nodes with a stated standard deviation; where it is 0 everything above is NaN.
    """

    levels: tuple[float, ...]
    shares: tuple[float, ...]
    coverage_95: float
    z_rms: float
    n: int = 0

    @classmethod
    def of(cls, errors: Any, std: Any, levels: tuple[float, ...] = LEVELS) -> Self:
        """Compare errors (N,) [m] with stated standard deviations (N,) [m]; NaN deviations do not count.

        Parameters
        ----------
        errors : (N,) array_like
            Map minus reference [m].
        std : (N,) array_like
            Stated standard deviations [m]; NaN where none is stated.
        levels : tuple of float
            Nominal two-sided levels, 0 to 1.

        Returns
        -------
        Calibration
            NaN throughout where no deviation is stated.

        Notes
        -----
        Errors of a map are correlated over the terrain's length scale: on one map the shares
        scatter about the truth far more than n suggests.

        Examples
        --------
        >>> errors = np.random.default_rng(1).normal(size=10_000)
        >>> calibration = Calibration.of(errors, np.ones(10_000))
        >>> round(calibration.coverage_95, 2), round(calibration.z_rms, 2)
        (0.95, 1.0)
        """
        deviation = np.asarray(std, dtype=np.float64).ravel()
        stated = np.isfinite(deviation)
        e, s = np.abs(np.asarray(errors, dtype=np.float64).ravel()[stated]), deviation[stated]
        if len(e) == 0:
            return cls(tuple(levels), (float("nan"),) * len(levels), float("nan"), float("nan"))
        if (s < 0.0).any():
            raise InputError(f"{int((s < 0.0).sum())} stated standard deviations are negative; correct them.")
        shares = tuple(_share_within(e, s, level) for level in levels)
        # An error where none is admitted counts as infinitely many deviations, no error as none.
        z = np.divide(e, s, out=np.where(e > 0.0, np.inf, 0.0), where=s > 0.0)
        return cls(tuple(levels), shares, _share_within(e, s, 0.95), float(np.sqrt(np.mean(z**2))), len(e))


def _share_within(size: Any, deviation: Any, level: float) -> float:
    """Return the share of errors that the central normal interval of a level holds."""
    return float(np.mean(size <= ndtri(0.5 + 0.5 * level) * deviation))

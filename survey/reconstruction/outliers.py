"""Detection of outliers by leave-one-out z-scores."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy.special import ndtri

from survey.core.arrays import FloatArray, IntArray

_SUSPECT_Z = 4.0
# Chance that a survey without a single outlier names one.
_FALSE_ALARM = 0.05
_TRUSTED_Z = 2.5
_N_NAMED = 20


@dataclass(frozen=True)
class Outliers:
    """Points whose leave-one-out z-score exceeds that of normal errors (`suspicious_z`), the worst first.

    Parameters
    ----------
    index : (K,) ndarray of int
        Rows of the points as they were given.
    z : (K,) ndarray
        Error of the others' prediction in its standard deviations, with its sign.
    treatment : str
        What was done about them.
    """

    index: IntArray
    z: FloatArray
    treatment: str = "retained"

    @classmethod
    def among(cls, z_scores: FloatArray, rows: IntArray, treatment: str = "retained") -> Self:
        """Return the suspicious points by the z-scores (N,) of the points in these rows."""
        worst = np.argsort(-np.abs(z_scores), kind="stable")
        worst = worst[np.abs(z_scores[worst]) > suspicious_z(len(z_scores))]
        return cls(rows[worst], z_scores[worst], treatment)

    def facts(self) -> dict[str, Any]:
        """Return their number and the worst twenty, for the record."""
        return {
            "n": len(self.index),
            "rows": self.index[:_N_NAMED],
            "z_scores": np.round(self.z[:_N_NAMED], 2),
            "treatment": self.treatment,
        }


def suspicious_z(n: int) -> float:
    """Return how many standard deviations make a point suspicious: 4, or more where n normal errors reach 4 by chance.

    Examples
    --------
    >>> [suspicious_z(100), round(suspicious_z(1_000_000), 2)]
    [4.0, 5.45]
    """
    return max(_SUSPECT_Z, -float(ndtri(0.5 * _FALSE_ALARM / n)))


def distrusted(variance: FloatArray, z_scores: FloatArray) -> FloatArray:
    """Return noise variances (N,) that grow with what lies beyond 2.5 standard deviations (Huber's weights).

    Examples
    --------
    >>> distrusted(np.ones(3), np.array([0.0, -2.5, 25.0]))
    array([ 1.,  1., 10.])
    """
    return variance * np.maximum(1.0, np.abs(z_scores) / _TRUSTED_Z)

"""Consistency of an estimate's covariances with its errors."""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from survey.core.arrays import FloatArray


@dataclass(frozen=True)
class Consistency:
    """Mean normalised squared error and the band of consistent covariances.

    For errors of D dimensions from N independent runs, N times the mean is χ²(N D) when
    the covariances are right; the band holds `probability` of that (Bar-Shalom et al.
    2001, section 5.4.2).
    """

    mean: float
    lowest: float
    highest: float

    @property
    def is_honest(self) -> bool:
        """Whether the mean lies inside the band."""
        return self.lowest <= self.mean <= self.highest


def consistency(errors: FloatArray, covariances: FloatArray, probability: float = 0.95) -> Consistency:
    """Test errors (N, D) against their claimed covariances (N, D, D).

    The errors must be of independent runs: poses of one drive share their drift, and the
    band would be far too narrow for them.

    Parameters
    ----------
    errors : (N, D) ndarray
        Errors of N independent runs.
    covariances : (N, D, D) ndarray
        Their claimed covariances.
    probability : float
        Probability of the band.

    Returns
    -------
    Consistency
        Mean and band.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> errors = rng.normal(0.0, 2.0, (200, 3))
    >>> consistency(errors, np.tile(4.0 * np.eye(3), (200, 1, 1))).is_honest
    True
    >>> consistency(errors, np.tile(1.0 * np.eye(3), (200, 1, 1))).is_honest
    False
    """
    n, dimensions = errors.shape
    squared = np.einsum("ni,ni->n", errors, np.linalg.solve(covariances, errors[:, :, None])[:, :, 0])
    tail = 0.5 * (1.0 - probability)
    # Quantiles of χ² with this many degrees of freedom.
    lowest, highest = 2.0 * gammaincinv(0.5 * n * dimensions, [tail, 1.0 - tail]) / n
    return Consistency(float(squared.mean()), float(lowest), float(highest))

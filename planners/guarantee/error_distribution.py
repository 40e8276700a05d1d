r"""Distribution of the error of a map: a mixture of gamma distributions of the mean squared error.

Under each covariance the mean squared error has the mean E and the variance V that its errors give, and about the
gamma distribution with these moments (Satterthwaite 1946). A factor of the error stands for ground unlike the
covariance. How much it differs from landscape to landscape is estimated from few of them, so that its logarithm for a
new one has Student's distribution, of four degrees of freedom, and heavier tails than the normal one (Geisser 1993,
Predictive Inference). It is integrated by Gauss-Legendre nodes of its distribution function.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import gammainc, gammaln, stdtrit

from survey.core.arrays import FloatArray

_FREEDOM = 4.0
_N_FACTORS = 64
_N_BISECTIONS = 60


class ErrorMoments(NamedTuple):
    """Mean [m²] and variance [m⁴] of the mean squared error under one covariance, and the covariance's weight."""

    mean: float
    variance: float
    weight: float


@dataclass(frozen=True)
class ErrorDistribution:
    """Distribution of the root mean square error of a map.

    Parameters
    ----------
    parts : sequence of ErrorMoments
        One for each covariance; weights sum to 1.
    spread : float
        Scale of the logarithm of a factor of the error, which has Student's distribution.
    """

    parts: Sequence[ErrorMoments]
    spread: float = 0.0

    def with_shared(self, shared_m: float) -> "ErrorDistribution":
        """Return the distribution with an error that all samples share, of a standard deviation [m]."""
        squared = shared_m**2
        parts = [
            part._replace(mean=part.mean + squared, variance=part.variance + 2.0 * squared**2)
            for part in self.parts
        ]
        return replace(self, parts=parts)

    def probability(self, limit_m: float) -> float:
        """Return the probability that the error is at most a limit [m]."""
        mean, shape, _ = self._gammas
        factors, shares = self._factors
        squared = np.square(limit_m / factors)[:, None]
        return float(shares @ gammainc(shape, shape * squared / mean) @ self._weights)

    @cached_property
    def rmse_m(self) -> float:
        """Expected error [m], at the median of the factor."""
        return float(self._weights @ self._gammas[2])

    def quantile_m(self, probability: float) -> float:
        """Return the error that the map stays within with a probability [m]."""
        low, high = 0.0, float(np.sqrt(max(part.mean for part in self.parts)))
        while self.probability(high) < probability:
            high *= 2.0
        for _ in range(_N_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if self.probability(middle) >= probability else (middle, high)
        return high

    @cached_property
    def _weights(self) -> FloatArray:
        return np.array([part.weight for part in self.parts])

    @cached_property
    def _gammas(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Mean square, shape, and mean of the square root, of each part."""
        mean = np.maximum([part.mean for part in self.parts], 1e-12)
        variance = np.maximum([part.variance for part in self.parts], 1e-6 * mean**2)
        shape = mean**2 / variance
        root = np.exp(gammaln(shape + 0.5) - gammaln(shape)) * np.sqrt(mean / shape)
        return mean, shape, root

    @cached_property
    def _factors(self) -> tuple[FloatArray, FloatArray]:
        """Factors of the error and their shares."""
        if self.spread == 0.0:
            return np.ones(1), np.ones(1)
        logs, shares = _student()
        return np.exp(self.spread * logs), shares


@cache
def _student() -> tuple[FloatArray, FloatArray]:
    """Values of a number with Student's distribution, and their shares."""
    nodes, weights = np.polynomial.legendre.leggauss(_N_FACTORS)
    logs: FloatArray = np.asarray(stdtrit(_FREEDOM, 0.5 * (1.0 + nodes)), dtype=np.float64)
    return logs, 0.5 * weights

r"""Distribution of the error of a map: a gamma distribution of the mean squared error, on ground of uncertain roughness.

Under each covariance the mean squared error has the mean E and the variance V that its errors give, and about the
gamma distribution with these moments (Satterthwaite 1946). On ground that is rougher than the covariance by a factor f
its mean is at most

.. math::  E(f) = f^2 \, T + N, \qquad T + N = E

with the part N of the noise of the samples and of relief finer than they are, which does not grow with the roughness:
the error of the best linear map is a concave function of the variance of the terrain, and this is its tangent. The
families of covariance stand for degrees of smoothness, and ground lies between them: T is their geometric mean, and its
standard deviation from family to family makes a normal factor, cut off at the roughest family, which grows the farther
the swaths are below what the prior shows. The other factors are two. How much ground differs from landscape to landscape is estimated from few of
them, so that the logarithm for a new one has Student's distribution, of four degrees of freedom, and heavier tails than
the normal one (Geisser 1993, Predictive Inference); what the cells of a prior or the samples of a survey leave open of
the roughness is normal. They are integrated by Gauss-Legendre nodes of their distribution
functions.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import gammainc, gammaln, ndtri, stdtrit

from survey.core.arrays import FloatArray

_FREEDOM = 4.0
_N_FACTORS = 28
_N_BISECTIONS = 40
_LEAST_SPREAD = 1e-6


class ErrorMoments(NamedTuple):
    """Mean [m²] and variance [m⁴] of the mean squared error under one covariance, and the covariance's weight.

    ``noise`` is the part of the mean that does not grow with the roughness of the terrain [m²].
    """

    mean: float
    variance: float
    weight: float
    noise: float = 0.0


@dataclass(frozen=True)
class ErrorDistribution:
    """Distribution of the root mean square error of a map.

    Parameters
    ----------
    parts : sequence of ErrorMoments
        One for each covariance; weights sum to 1.
    spread : float
        Scale of the logarithm of a factor of the roughness, which has Student's distribution.
    open_spread : float
        Standard deviation of the logarithm of another factor of the roughness, which is normal.
    """

    parts: Sequence[ErrorMoments]
    spread: float = 0.0
    open_spread: float = 0.0

    def with_shared(self, shared_m: float) -> "ErrorDistribution":
        """Return the distribution with an error that all samples share, of a standard deviation [m]."""
        squared = shared_m**2
        parts = [
            part._replace(
                mean=part.mean + squared,
                variance=part.variance + 2.0 * squared**2,
                noise=part.noise + squared,
            )
            for part in self.parts
        ]
        return replace(self, parts=parts)

    def probability(self, limit_m: float) -> float:
        """Return the probability that the error is at most a limit [m]."""
        terrain, noise, shape = self._moments
        factors, shares = self._factors
        means = np.square(factors) * terrain + noise
        return float(shares @ gammainc(shape, shape * limit_m**2 / means))

    @cached_property
    def rmse_m(self) -> float:
        """Expected error [m], at the median of the factors."""
        terrain, noise, shape = self._moments
        root = float(np.exp(gammaln(shape + 0.5) - gammaln(shape)))
        return root * float(np.sqrt((terrain + noise) / shape))

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
    def _log_terrain(self) -> FloatArray:
        """Half the logarithm of the terrain's part of the mean, for each covariance [log m]."""
        return 0.5 * np.log(np.maximum([part.mean - part.noise for part in self.parts], 1e-12))

    @cached_property
    def _moments(self) -> tuple[float, float, float]:
        """Terrain's and noise's part of the mean square [m²], and the shape of the gamma distribution."""
        mean = np.maximum([part.mean for part in self.parts], 1e-12)
        variance = np.maximum([part.variance for part in self.parts], 1e-6 * mean**2)
        shape = float(np.exp(self._weights @ np.log(mean**2 / variance)))
        noise = float(self._weights @ [part.noise for part in self.parts])
        return float(np.exp(2.0 * self._weights @ self._log_terrain)), noise, shape

    @cached_property
    def _factors(self) -> tuple[FloatArray, FloatArray]:
        """Factors of the roughness and their shares."""
        logs, shares = self._between
        for spread, nodes in ((self.spread, _student), (self.open_spread, _normal)):
            if spread > 0.0:
                values, weights = nodes()
                logs = np.add.outer(logs, spread * values).ravel()
                shares = np.multiply.outer(shares, weights).ravel()
        return np.exp(logs), shares

    @cached_property
    def _between(self) -> tuple[FloatArray, FloatArray]:
        """Logarithms of the factor from family to family, no rougher than the roughest, and their shares."""
        off = self._log_terrain - self._weights @ self._log_terrain
        spread = float(np.sqrt(self._weights @ np.square(off)))
        if spread < _LEAST_SPREAD:
            return np.zeros(1), np.ones(1)
        values, weights = _normal()
        return np.minimum(spread * values, off.max()), weights


@cache
def _student() -> tuple[FloatArray, FloatArray]:
    """Return the values of a number with Student's distribution, and their shares."""
    share, weights = _nodes()
    return np.asarray(stdtrit(_FREEDOM, share), dtype=np.float64), weights


@cache
def _normal() -> tuple[FloatArray, FloatArray]:
    """Return the values of a number with the normal distribution, and their shares."""
    share, weights = _nodes()
    return np.asarray(ndtri(share), dtype=np.float64), weights


def _nodes() -> tuple[FloatArray, FloatArray]:
    """Return the nodes of a distribution function from 0 to 1, and their weights."""
    nodes, weights = np.polynomial.legendre.leggauss(_N_FACTORS)
    return 0.5 * (1.0 + nodes), 0.5 * weights

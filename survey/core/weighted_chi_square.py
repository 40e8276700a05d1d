r"""Weighted sums of squared normal variables, by three moments.

The mean square of correlated normal errors is :math:`Q = \sum_k \lambda_k X_k^2` with the eigenvalues λ of
their covariance over their number. Its distribution is that of a shifted and scaled chi-square with the same
mean, variance and skewness (Hall 1983, Buckley and Eagleson 1988).
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.special import chdtr, chdtrc, chdtri

from survey.core.arrays import FloatArray


@dataclass(frozen=True)
class WeightedChiSquare:
    r"""Distribution of :math:`\sum_k \lambda_k X_k^2` for independent standard normal X.

    `mean`: sum of the weights. `variance`: twice the sum of their squares. `n_free`: degrees of freedom of
    the chi-square with the same skewness.

    Meant for the upper half: probabilities of 0.8 and more err by less than 0.01. Below the mean, where one
    weight outweighs the others, they do not hold.

    >>> plain = WeightedChiSquare.of(np.ones(3))
    >>> round(plain.below(7.815), 3), round(plain.quantile(0.95), 3)
    (0.95, 7.815)
    """

    mean: float
    variance: float
    n_free: float

    @classmethod
    def of(cls, weights: FloatArray) -> Self:
        """Return the distribution for weights (K,) of 0 or more, at least one of them above 0."""
        first, second, third = (float(np.sum(weights**power)) for power in (1, 2, 3))
        return cls(first, 2.0 * second, second**3 / third**2)

    @classmethod
    def of_mean_square(cls, covariance: FloatArray) -> Self:
        """Return the distribution of the mean square of normal errors with a covariance (M, M)."""
        size = len(covariance)
        squared = covariance @ covariance
        first, second = float(np.trace(covariance)), float(np.trace(squared))
        third = float(np.sum(squared * covariance))
        return cls(first / size, 2.0 * second / size**2, second**3 / third**2)

    @property
    def n_effective(self) -> float:
        """Number of independent errors of equal size whose mean square would scatter as much."""
        return 2.0 * self.mean**2 / self.variance

    def below(self, value: float) -> float:
        """Return the probability of a smaller sum."""
        return float(chdtr(self.n_free, max(self._standard(value), 0.0)))

    def above(self, value: float) -> float:
        """Return the probability of a larger sum."""
        return float(chdtrc(self.n_free, max(self._standard(value), 0.0)))

    def quantile(self, probability: float) -> float:
        """Return the value that the sum stays below with a probability; 0 at least."""
        standard = float(chdtri(self.n_free, 1.0 - probability))
        return max(self.mean + (standard - self.n_free) * self._step, 0.0)

    def _standard(self, value: float) -> float:
        return self.n_free + (value - self.mean) / self._step

    @property
    def _step(self) -> float:
        """Size of one unit of the chi-square."""
        return float(np.sqrt(self.variance / (2.0 * self.n_free)))

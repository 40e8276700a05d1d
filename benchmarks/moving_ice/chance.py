"""Coverage that an estimate reaches by chance where its errors are drawn from the covariance that it claims.

Errors of one map are correlated: the level is common to all of it. The coverage of a single calibrated map is then spread
widely about 95 %, and that of some maps less.
"""

from collections.abc import Sequence

import numpy as np
from scipy.stats import binom

from survey.core.arrays import FloatArray
from survey.reconstruction.joint.solution import JointSolution

N_DRAWS = 200
_Z95 = 1.959964


def drawn_coverages(solution: JointSolution, places: FloatArray, seed: int) -> list[float]:
    """Return the coverage of 95 % in draws of the error from the covariance of a map at places (M, 2).

    The same seed gives draws of equal numbers, so that surveys of one site err alike.
    """
    covariance = solution.terrain.covariance(places)
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    error = root @ np.random.default_rng(seed).standard_normal((len(places), N_DRAWS))
    sigma = np.sqrt(np.diag(covariance))[:, None]
    covered: list[float] = np.mean(np.abs(error) <= _Z95 * sigma, axis=0).tolist()
    return covered


def interval_of_mean(drawn: Sequence[Sequence[float]]) -> tuple[float, float]:
    """Return the 5 % and 95 % quantiles of the mean coverage of several maps."""
    low, high = np.quantile(np.mean(drawn, axis=0), (0.05, 0.95))
    return float(low), float(high)


def interval_of_share(n: int, share: float = 0.95) -> tuple[float, float]:
    """Return the 5 % and 95 % quantiles of the share of n independent intervals that hold."""
    low, high = binom.ppf((0.05, 0.95), n, share) / n
    return float(low), float(high)

r"""Check of the covariances of a survey on lines left out, one after the other.

A covariance is fitted to samples that are near one another along the lines, and the error of a map is made between them,
where the ground may be smoother or rougher. Each line is therefore predicted from all others. With the inverse A of the
covariance of all samples, about a constant mean, the residuals of line b and their covariance are

.. math::  e_b = A_{bb}^{-1} (A y)_b, \qquad C_b = A_{bb}^{-1}

(Dubrule 1983, Mathematical Geology 15, 687). The mean square of the residuals over that expected gives a factor of the
roughness; its logarithm is weighed against 0 by how many independent values the residuals hold.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from planners.guarantee.posterior.kernel_posterior import KernelPosterior, WeightedKernel
from survey.core.arrays import FloatArray, IntArray

_LEAST_LINES = 3
# Standard deviation of the logarithm of the factor before any line is left out.
_UNCHECKED_SPREAD = 0.25
_LEAST_SHARE = 0.05
_MOST_SAMPLES = 1500


class _Check(NamedTuple):
    """Mean square of residuals over that expected, its degrees of freedom, and the terrain's share of the expected."""

    ratio: float
    freedom: float
    terrain_share: float


def checked_by_lines(
    posterior: KernelPosterior, xy: FloatArray, heights: FloatArray, line: IntArray
) -> KernelPosterior:
    """Scale the roughness of each covariance by what lines that are left out show of it.

    Parameters
    ----------
    posterior : KernelPosterior
        Covariances fitted to the samples.
    xy, heights : (N, 2) and (N,) ndarray
        Places and measured heights [m].
    line : (N,) ndarray of int
        Line that each sample belongs to.

    Returns
    -------
    KernelPosterior
        With the uncertainty of the roughness as its ``open_spread``.
    """
    if len(np.unique(line)) < _LEAST_LINES:
        return KernelPosterior(posterior.kernels, posterior.spread, _UNCHECKED_SPREAD)
    every = slice(None, None, int(np.ceil(len(xy) / _MOST_SAMPLES)))
    found, open_share = [], 0.0
    for one in posterior.kernels:
        mean, variance = _log_factor(_check(one, xy[every], heights[every], line[every]))
        found.append(one._replace(variance_m2=one.variance_m2 * float(np.exp(2.0 * mean))))
        open_share += one.weight * variance
    return KernelPosterior(tuple(found), posterior.spread, float(np.sqrt(open_share)))


def _log_factor(check: _Check) -> tuple[float, float]:
    """Return mean and variance of the logarithm of the factor of the roughness."""
    share = max(check.terrain_share, _LEAST_SHARE)
    squared = max((check.ratio - (1.0 - share)) / share, _LEAST_SHARE)
    prior, own = _UNCHECKED_SPREAD**2, 0.5 / check.freedom / share**2
    return 0.5 * float(np.log(squared)) * prior / (prior + own), prior * own / (prior + own)


def _check(one: WeightedKernel, xy: FloatArray, heights: FloatArray, line: IntArray) -> _Check:
    """Predict each line from all others."""
    covariance = one.kernel.covariance(xy, xy)
    covariance[np.diag_indices(len(xy))] += one.noise_m**2 + 1e-9 * one.variance_m2
    inverse = cho_solve(cho_factor(covariance, lower=True), np.eye(len(xy)))
    ones = inverse.sum(axis=1)
    inverse -= np.outer(ones, ones) / ones.sum()
    weighted = inverse @ heights
    ratios, freedoms, shares = [], [], []
    for index in np.unique(line):
        chosen = np.flatnonzero(line == index)
        block = np.linalg.inv(inverse[np.ix_(chosen, chosen)])
        expected = float(np.trace(block))
        ratios.append(float(np.square(block @ weighted[chosen]).sum()) / expected)
        freedoms.append(expected**2 / float(np.square(block).sum()))
        shares.append(1.0 - len(chosen) * one.noise_m**2 / expected)
    weights = np.array(freedoms) / sum(freedoms)
    return _Check(float(weights @ ratios), sum(freedoms), float(weights @ shares))

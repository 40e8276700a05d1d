r"""Posterior of the longest length scale of a kernel, for the average of maps over it.

Points near one line show how steep landforms are, and hardly how long: length and variance may grow together. A map with
the likeliest length alone claims too little error where no points lie. With the other parts of the kernel fixed, values
have the covariance :math:`R + v\,C_\ell`; one eigendecomposition of C about R for each length ℓ gives the likelihood of every
variance v.
"""

from dataclasses import replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.spatial.distance import squareform
from scipy.special import logsumexp

from survey.core.arrays import FloatArray
from survey.reconstruction.gp.covariance.kernel_sum import Sum
from survey.reconstruction.gp.covariance.kernels import Kernel
from survey.reconstruction.gp.covariance.stationary import Stationary
from survey.reconstruction.gp.selection.kernel_fit import (
    LONGEST_SHARE,
    Hyperparameters,
    KernelFit,
)
from survey.reconstruction.gp.selection.kernel_terms import parts_of

# Lengths over the extent of the points, and variances over that of the fit.
_LENGTHS, _VARIANCES = np.geomspace(0.08, LONGEST_SHARE, 8), np.geomspace(1e-3, 1e3, 61)
# Length over the extent that a landform falls short of with a probability of 5 %.
_SHORTEST, _CHANCE = 0.08, 0.05
# Probabilities of lengths below those that are returned: the middles of three equal parts.
_QUANTILES = np.array([1.0, 3.0, 5.0]) / 6.0
# Lengths that differ by a smaller ratio count as one.
_DETERMINED = 1.25


def lengths_of(search: KernelFit, found: Hyperparameters) -> list[Hyperparameters]:
    r"""Return three kernels whose longest length scales are equally probable, each with the mean variance that goes with it.

    The length has the prior density :math:`\ell^{-2} e^{-\lambda / \ell}` of Fuglstad et al. (J. Am. Stat. Assoc. 114,
    2019), with 5 % below 8 % of the extent of the points; the logarithm of the variance is uniform.

    Parameters
    ----------
    search : KernelFit
        Likelihood of the points.
    found : Hyperparameters
        Its maximum, with the longest scale as its first part; returned alone where its length is determined within a
        quarter, and where its kernel has another form.
    """
    longest, *others = parts_of(found.kernel)
    if not isinstance(longest, Stationary):
        return [found]
    lengths = search.extent_m * _LENGTHS
    logs = _log_likelihoods(search, longest, others, found.nugget_m, lengths)
    rate = -np.log(_CHANCE) * _SHORTEST * search.extent_m
    density = logsumexp(logs, axis=1) - rate / lengths - np.log(lengths)
    mean_variance = longest.variance_m2 * np.exp(
        logsumexp(logs, axis=1, b=_VARIANCES) - logsumexp(logs, axis=1)
    )
    log_length = _quantiles(np.log(lengths), density)
    if log_length[-1] - log_length[0] < np.log(_DETERMINED):
        return [found]
    log_variance = np.interp(log_length, np.log(lengths), np.log(mean_variance))
    return [
        _with_longest(found, longest, others, float(np.exp(length)), float(np.exp(variance)))
        for length, variance in zip(log_length, log_variance, strict=True)
    ]


def _with_longest(
    found: Hyperparameters, longest: Stationary, others: list[Kernel], length_m: float, variance_m2: float
) -> Hyperparameters:
    part = replace(longest, length_scale_m=length_m, variance_m2=variance_m2)
    return replace(found, kernel=Sum(part, *others) if others else part)


def _log_likelihoods(
    search: KernelFit, longest: Stationary, others: list[Kernel], nugget_m: float, lengths_m: FloatArray
) -> FloatArray:
    """Return the log likelihood (L, V) of lengths and of variances, an unknown constant integrated out."""
    pairs = np.sum([part.covariance_of_lag(search.lags_m) for part in others], axis=0) + np.zeros(
        len(search.lags_m)
    )
    diagonal = sum(part.variance_m2 for part in others) + search.noise_m2 + nugget_m**2
    half = cholesky(search.covariance_matrix(pairs, diagonal), lower=True)
    sides = solve_triangular(half, np.column_stack([search.values, np.ones(len(search.values))]), lower=True)
    return np.array([_of_variances(search, longest, float(length), half, sides) for length in lengths_m])


def _of_variances(
    search: KernelFit, longest: Stationary, length_m: float, half: FloatArray, sides: FloatArray
) -> FloatArray:
    """Return the log likelihood (V,) of the variances for one length, up to a constant."""
    shape = replace(longest, length_scale_m=length_m, variance_m2=1.0)
    correlation = squareform(shape.covariance_of_lag(search.lags_m), checks=False)
    np.fill_diagonal(correlation, 1.0)
    whitened = solve_triangular(half, solve_triangular(half, correlation, lower=True).T, lower=True)
    value, vector = np.linalg.eigh(0.5 * (whitened + whitened.T))
    y, ones = (vector.T @ sides).T
    total = 1.0 + longest.variance_m2 * _VARIANCES[:, None] * np.maximum(value, 0.0)
    weight, about = (ones**2 / total).sum(axis=1), (ones * y / total).sum(axis=1)
    misfit = (y**2 / total).sum(axis=1) - about**2 / weight
    likelihood: FloatArray = -0.5 * (misfit + np.log(total).sum(axis=1) + np.log(weight))
    return likelihood


def _quantiles(at: FloatArray, log_density: FloatArray) -> FloatArray:
    """Return the places at which a density, whose logarithm is interpolated, reaches the shares of `_QUANTILES`."""
    fine = np.linspace(at[0], at[-1], 400)
    density = np.exp(np.interp(fine, at, log_density - log_density.max()))
    share = np.cumsum(density) / density.sum()
    return np.interp(_QUANTILES, share, fine)

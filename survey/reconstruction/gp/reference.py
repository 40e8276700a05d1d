r"""Gaussian process regression in the order of the glacier paper, Eqs. 1 to 9, with nothing but NumPy.

Read this file first: it is the method, and the tests hold every engine to it. It solves dense systems, so that work
grows with N³ and memory with N²: it is meant for some hundreds of points. Symbols: X (N, 2) places of the measurements
[m], Y (N,) their elevations [m], X* (Q, 2) places of the map, and :math:`\Sigma_{S,T}` the covariance function between
all places of S and T [m²]. In print, Eqs. 4 and 5 exchange measured and mapped places; here they are as in Rasmussen
and Williams (2006), Eqs. 2.23 and 2.24.
"""

from collections.abc import Callable

import numpy as np

from survey.core import FloatArray

Covariance = Callable[[FloatArray, FloatArray], FloatArray]
"""Covariance function: places (N, 2) and (M, 2) [m] to covariances (N, M) [m²]."""
MeanFunction = Callable[[FloatArray], FloatArray]
"""Mean function: places (N, 2) [m] to elevations (N,) [m], such as those of a satellite DEM (III-C)."""


def squared_exponential(alpha_m2: float, gamma_m2: float) -> Covariance:
    r"""Return the squared exponential covariance function, :math:`\alpha e^{-\|x_i - x_j\|^2 / 2\gamma}` (Eq. 1).

    `gamma_m2` is the square of the length scale [m²], as the paper's Γ has the elements 1/γ.
    """

    def covariance(x_i: FloatArray, x_j: FloatArray) -> FloatArray:
        squared_m2 = ((x_i[:, None, :] - x_j[None, :, :]) ** 2).sum(axis=-1)
        return np.asarray(alpha_m2 * np.exp(-0.5 * squared_m2 / gamma_m2))

    return covariance


def marginal(mean: FloatArray, covariance: FloatArray, kept: slice) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance of some of jointly Gaussian values: the others are left out (Eq. 2)."""
    return mean[kept], covariance[kept, kept]


def elevation_variance(landmark_covariance_m2: FloatArray) -> FloatArray:
    """Return the variances of elevation (N,) [m²] of landmarks (N, 3, 3), with x and y integrated out (Eq. 7)."""
    return landmark_covariance_m2[:, 2, 2]


def measured_covariance(covariance: Covariance, places_m: FloatArray, sigma_m: FloatArray) -> FloatArray:
    """Return the covariance of measurements (N, N) [m²]: that of the terrain and their own errors (Eq. 6)."""
    return covariance(places_m, places_m) + np.diag(sigma_m**2)


def condition(
    covariance: Covariance,
    mean: MeanFunction,
    measured: tuple[FloatArray, FloatArray, FloatArray],
    map_places_m: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    r"""Return the posterior mean (Q,) [m] and covariance (Q, Q) [m²] of a map (Eqs. 3 to 5).

    .. math::  \mu^* = \mu_{X^*} + \Sigma_{X^*,X} \Sigma_{Y,Y}'^{-1} (Y - \mu_X), \qquad
               \Sigma^* = \Sigma_{X^*,X^*} - \Sigma_{X^*,X} \Sigma_{Y,Y}'^{-1} \Sigma_{X^*,X}^T

    `measured` holds the places X (N, 2) [m], the elevations Y (N,) [m] and their standard deviations (N,) [m].
    """
    places_m, elevation_m, sigma_m = measured
    of_measured = measured_covariance(covariance, places_m, sigma_m)
    crossed = covariance(map_places_m, places_m)
    weights = np.linalg.solve(of_measured, crossed.T).T
    map_mean_m = mean(map_places_m) + weights @ (elevation_m - mean(places_m))
    return map_mean_m, covariance(map_places_m, map_places_m) - weights @ crossed.T


def log_marginal_likelihood(
    covariance: Covariance, mean: MeanFunction, measured: tuple[FloatArray, FloatArray, FloatArray]
) -> float:
    r"""Return the logarithm of the density of the measurements under a covariance function (Eq. 9).

    Its maximum over α and γ chooses the hyperparameters where their prior is flat (Eq. 8).
    """
    places_m, elevation_m, sigma_m = measured
    of_measured = measured_covariance(covariance, places_m, sigma_m)
    residual_m = elevation_m - mean(places_m)
    _, log_determinant = np.linalg.slogdet(of_measured)
    misfit = residual_m @ np.linalg.solve(of_measured, residual_m)
    return float(-0.5 * (misfit + log_determinant + len(residual_m) * np.log(2.0 * np.pi)))

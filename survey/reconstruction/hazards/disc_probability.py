r"""Probability that a normal vector in the plane is longer than a limit.

With the principal axes of the covariance, standard deviations σ₁ ≥ σ₂ and means μ along them,

.. math::  P(|g| > t) = 1 - \int_{-t}^{t} \phi\!\left(\frac{u - \mu_1}{\sigma_1}\right)
           \left[\Phi\!\left(\frac{s - \mu_2}{\sigma_2}\right) - \Phi\!\left(\frac{-s - \mu_2}{\sigma_2}\right)\right]
           \frac{du}{\sigma_1}, \qquad s = \sqrt{t^2 - u^2}
"""

import numpy as np
from scipy.special import ndtr

from survey.core.arrays import FloatArray

_N_NODES = 64
_REACH = 8.0
_LEAST_SHARE = 1e-6


def probability_beyond(mean: FloatArray, covariance: FloatArray, limit: float) -> FloatArray:
    """Return the probability that normal vectors in the plane are longer than a limit.

    Parameters
    ----------
    mean : (M, 2) ndarray
        Means of the vectors.
    covariance : (M, 2, 2) ndarray
        Their covariances.
    limit : float
        Length, in the unit of the vectors.

    Returns
    -------
    (M,) ndarray
        Between 0 and 1; to about 1e-6.

    Examples
    --------
    >>> known, unit = np.zeros((1, 2)), np.eye(2)[None]
    >>> probability_beyond(known, unit, 2.0).round(4).tolist()  # exp(-2)
    [0.1353]
    """
    variance, axes = np.linalg.eigh(covariance)
    sigma = np.sqrt(np.maximum(variance, (_LEAST_SHARE * limit) ** 2))
    across, along = np.einsum("mij,mi->jm", axes, mean)
    sigma_across, sigma_along = sigma.T
    low = np.clip(along - _REACH * sigma_along, -limit, limit)
    high = np.clip(along + _REACH * sigma_along, -limit, limit)
    nodes, weights = np.polynomial.legendre.leggauss(_N_NODES)
    u = 0.5 * (low + high)[:, None] + 0.5 * (high - low)[:, None] * nodes
    half = np.sqrt(np.maximum(limit**2 - u**2, 0.0))
    inside = ndtr((half - across[:, None]) / sigma_across[:, None])
    inside -= ndtr((-half - across[:, None]) / sigma_across[:, None])
    density = np.exp(-0.5 * ((u - along[:, None]) / sigma_along[:, None]) ** 2)
    density /= np.sqrt(2.0 * np.pi) * sigma_along[:, None]
    within: FloatArray = 0.5 * (high - low) * ((density * inside) @ weights)
    return np.clip(1.0 - within, 0.0, 1.0)

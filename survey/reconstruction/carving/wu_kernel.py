"""Wu's compactly supported kernel φ₂,₁."""

import numpy as np
from numba import njit

from survey.core.arrays import FloatArray


@njit(cache=True, inline="always")
def wu(rho: float) -> float:
    """Kernel at a distance of ρ length scales; 0 from 1 on, without a branch, so that loops over it run in lanes."""
    inside = max(1.0 - rho, 0.0)
    square = inside * inside
    return square * square * (1.0 + rho * (4.0 + rho * (3.0 + 0.75 * rho)))


def wu_kernel(distance_m: FloatArray, length_m: float) -> FloatArray:
    r"""Return Wu's kernel φ₂,₁ of distances, 1 at none.

    .. math::  k(\rho) = (1 - \rho)^4_+ \, (4 + 16 \rho + 12 \rho^2 + 3 \rho^3) / 4,
               \qquad \rho = d / \sigma

    Eqs. 6 and 7 of the carving paper, divided by 4 so that a weight is a height.

    Parameters
    ----------
    distance_m : array_like
        Distances d [m].
    length_m : float
        Length scale σ [m], beyond which the kernel is 0.

    Returns
    -------
    ndarray
        Between 0 and 1, positive definite in up to three dimensions, twice continuously
        differentiable.

    Examples
    --------
    >>> wu_kernel(np.array([0.0, 1.0, 2.0, 3.0]), 2.0).round(4)
    array([1.    , 0.2402, 0.    , 0.    ])
    """
    rho = np.asarray(distance_m, dtype=np.float64) / length_m
    inside = np.maximum(1.0 - rho, 0.0)
    kernel: FloatArray = inside**4 * (1.0 + rho * (4.0 + rho * (3.0 + 0.75 * rho)))
    return kernel

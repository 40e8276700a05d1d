"""Predicted variance of maps that have too many samples for one matrix: each place from the samples near it."""

import numpy as np
from scipy.spatial import cKDTree

from survey.core.arrays import FloatArray
from survey.reconstruction.gp.engines.regression import DenseGaussianProcess
from survey.reconstruction.gp.kernels import Kernel

_N_NEAREST = 120


def variance_from_nearest(kernel: Kernel, xy: FloatArray, sigma_m: float, at: FloatArray) -> FloatArray:
    """Return the variance at places, each predicted from its 120 nearest samples, which screen those beyond.

    Parameters
    ----------
    kernel : Kernel
        Covariance of the terrain [m²].
    xy : (N, 2) ndarray
        Easting and northing of the samples [m].
    sigma_m : float
        Standard deviation of a sample [m].
    at : (M, 2) ndarray
        The places [m].

    Returns
    -------
    (M,) ndarray
        Variance [m²].
    """
    nearest = cKDTree(xy).query(at, min(_N_NEAREST, len(xy)))[1].reshape(len(at), -1)
    variance = np.empty(len(at))
    for index, (place, chosen) in enumerate(zip(at, nearest, strict=True)):
        n = len(chosen)
        process = DenseGaussianProcess.fit(
            xy[chosen], np.zeros(n), np.full(n, sigma_m), kernel, trend="constant"
        )
        variance[index] = process.predict(place[None, :])[1][0]
    return variance

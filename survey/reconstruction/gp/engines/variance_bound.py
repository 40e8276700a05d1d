"""Nearest-neighbour bound on the posterior variance."""

import numpy as np
from scipy.spatial import cKDTree

from survey.core.arrays import FloatArray
from survey.reconstruction.gp.covariance.kernels import Kernel
from survey.reconstruction.gp.engines.noisy_values import NoisyValues

_N_NEAREST = 12
_BLOCK = 10_000


def variance_from_nearest(kernel: Kernel, data: NoisyValues, xy: FloatArray) -> FloatArray:
    r"""Return the posterior variance (M,) [m²] at places (M, 2) given their twelve nearest points only.

    .. math::  v = k(0) - k_n^T (K_n + N_n)^{-1} k_n

    More points never make a Gaussian process less sure, so that this is never less than
    the variance given all points. A fast engine that counts the waves it leaves out as
    noise gives another such bound: too high beside points, where this one is tight, and
    right between swaths, where this one is too high. The smaller of the two is the better.

    Parameters
    ----------
    kernel : Kernel
        Prior covariance.
    data : NoisyValues
        The points.
    xy : (M, 2) ndarray
        Places [m].

    Notes
    -----
    The mean is taken as known.

    Examples
    --------
    >>> from survey.reconstruction.gp.covariance.kernels import SquaredExponential
    >>> one = NoisyValues.of(np.zeros((1, 2)), np.zeros(1), np.array([2.0]))
    >>> variance_from_nearest(SquaredExponential(4.0, 10.0), one, np.zeros((1, 2)))
    array([2.])
    """
    tree = cKDTree(data.xy)
    blocks = [_of_block(kernel, data, tree, xy[k : k + _BLOCK]) for k in range(0, len(xy), _BLOCK)]
    return np.concatenate(blocks) if blocks else np.zeros(0)


def _of_block(kernel: Kernel, data: NoisyValues, tree: cKDTree, xy: FloatArray) -> FloatArray:
    n = min(_N_NEAREST, len(data))
    index = np.asarray(tree.query(xy, k=n)[1]).reshape(len(xy), n)
    near = data.xy[index]
    matrix = kernel.covariance_of_lag(near[:, :, None, :] - near[:, None, :, :])
    matrix[:, np.arange(n), np.arange(n)] += data.noise_m2[index]
    here = kernel.covariance_of_lag(near - xy[:, None, :])
    solved = np.linalg.solve(matrix, here[..., None])[..., 0]
    variance: FloatArray = np.maximum(kernel.variance_m2 - (here * solved).sum(axis=1), 0.0)
    return variance

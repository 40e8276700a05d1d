"""Propagation of horizontal errors to heights through the slope."""

import numpy as np

from survey.core.arrays import FloatArray


def variance_through_slope(covariance: FloatArray, slope: FloatArray) -> FloatArray:
    r"""Return the variance of the height that full 3 × 3 covariances amount to on a slope.

    .. math::  \sigma_i^2 = a_i^T \Sigma_i a_i, \qquad
               a_i = (-\partial f / \partial x, -\partial f / \partial y, 1)

    A point measured off its place by (dx, dy, dz) lies dz − f_x dx − f_y dy above the
    surface, to first order (McHutchon and Rasmussen 2011, with the covariances between
    height and place retained, which Eq. 7 of the glacier paper drops).

    Parameters
    ----------
    covariance : (N, 3, 3) ndarray
        Of easting, northing and elevation [m²].
    slope : (N, 2) ndarray
        Derivatives of the surface to the east and to the north at the points [m/m].

    Returns
    -------
    (N,) ndarray
        Variance [m²]; never less than a millionth of the trace, since a covariance may be
        singular along a.

    Notes
    -----
    First order: where the slope changes within the horizontal error, the variance is
    too small. Errors that neighbouring points share are not seen.

    Examples
    --------
    >>> variance_through_slope(np.diag([0.25, 0.25, 0.01])[None], np.array([[0.2, 0.0]]))
    array([0.02])
    """
    a = np.column_stack([-slope, np.ones(len(slope))])
    through = np.einsum("ni,nij,nj->n", a, covariance, a)
    result: FloatArray = np.maximum(through, 1e-6 * np.trace(covariance, axis1=1, axis2=2))
    return result

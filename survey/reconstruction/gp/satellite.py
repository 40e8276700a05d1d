"""Covariance of the error of a satellite's elevation model between its cells."""

from dataclasses import replace

import numpy as np

from survey.reconstruction.gp.covariance.kernel_sum import Sum
from survey.reconstruction.gp.covariance.kernels import Kernel, SquaredExponential
from survey.reconstruction.gp.selection.kernel_fit import Hyperparameters


def prior_error_kernel(cell_m: float, sigma_m: float) -> Kernel:
    r"""Return the covariance of the noise of a coarse model read bilinearly between its cells.

    Independent noise of σ per cell, spread by the bilinear weights w, has on average over
    the cell the variance and the correlation of a cubic spline,

    .. math::  \overline{\sum_c w_c^2} = (2/3)^2, \qquad
               \rho(h) \approx \exp(-h^2 / 2 l^2), \quad l = c / \sqrt 3

    with the cell's width c; l is the standard deviation of the spline.

    Parameters
    ----------
    cell_m : float
        Width of a cell [m].
    sigma_m : float
        Standard deviation of a cell's noise [m].

    Notes
    -----
    The relief within a cell, which its mean hides, is not in it: the kernel that is
    fitted to the points about the prior has it.

    Examples
    --------
    >>> prior_error_kernel(75.0, 1.5).variance_m2
    1.0
    """
    return SquaredExponential((2.0 / 3.0 * sigma_m) ** 2, float(cell_m / np.sqrt(3.0)))


def with_prior_error(found: Hyperparameters, cell_m: float, sigma_m: float) -> Hyperparameters:
    """Return the hyperparameters with the prior's own error beside the terrain's."""
    parts = found.kernel.parts if isinstance(found.kernel, Sum) else (found.kernel,)
    return replace(found, kernel=Sum(*parts, prior_error_kernel(cell_m, sigma_m)))

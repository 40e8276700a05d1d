"""Moved out of planners/swaths/wavy.py."""

import numpy as np

from survey.reconstruction.gp.kernels import Kernel


def slope_length_m(kernel: Kernel) -> float:
    r"""Return the distance over which slopes change: what the length of a wave is measured by [m].

    .. math::  \sqrt{v / -k''(0)} \approx h / \sqrt{2 (1 - k(h) / v)}

    the standard deviation of heights over that of slopes. It is ℓ for the squared
    exponential and ℓ/√3 for the Matérn 3/2 covariance, so that one number fits smooth and
    rough terrain. Of several directions the shortest counts.
    """
    angles = np.linspace(0.0, np.pi, 12, endpoint=False)
    lag_m = 0.02 * kernel.length_scales_m[0]
    lags = lag_m * np.column_stack([np.cos(angles), np.sin(angles)])
    lost = 1.0 - kernel.covariance_of_lag(lags) / kernel.variance_m2
    return lag_m / float(np.sqrt(2.0 * lost.max()))

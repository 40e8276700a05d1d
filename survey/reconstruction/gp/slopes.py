"""Steepness of a map and its standard deviation."""

import numpy as np

from survey.core.arrays import FloatArray
from survey.reconstruction.gp.engines.base import Process

_DIRECTIONS = ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0))


def steepness_on_axes(
    process: Process, x: FloatArray, y: FloatArray, mean_slope: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return steepness and its standard deviation (H, W) [m/m], with the slope (H * W, 2) of the mean surface.

    The standard deviation is that of the derivative along the steepest direction,
    σ² = eᵀ cov(∇f) e.
    """
    nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    slope = process.gradient(nodes) + mean_slope
    steepness = np.hypot(*slope.T)
    e_x, e_y = slope.T / np.maximum(steepness, 1e-12)
    along_x, along_y, diagonal = (process.derivative_variance_on_axes(x, y, np.array(e)) for e in _DIRECTIONS)
    variance = e_x**2 * along_x + e_y**2 * along_y + e_x * e_y * (diagonal - along_x - along_y)
    shape = (len(y), len(x))
    return steepness.reshape(shape), np.sqrt(np.maximum(variance, 0.0)).reshape(shape)

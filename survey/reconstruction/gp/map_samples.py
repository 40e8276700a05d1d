"""Samples, slopes and sums of the map, whichever engine carries the process."""

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.reconstruction.gp.engines.dense_gp import DenseGaussianProcess
from survey.reconstruction.gp.engines.gaussian_process import FourierGaussianProcess
from survey.reconstruction.gp.map_products import sample_on_axes, weighted_sum
from survey.reconstruction.gp.process import Process

_TILED = "a map in tiles has no joint {}; take a smaller site, or allow more memory."


def samples_on_axes(
    process: Process, x: FloatArray, y: FloatArray, n: int, rng: np.random.Generator
) -> FloatArray:
    """Draw n joint surfaces (n, H, W) [m] on the nodes of two axes."""
    if isinstance(process, FourierGaussianProcess):
        return sample_on_axes(process, x, y, n, rng)
    if isinstance(process, DenseGaussianProcess):
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        return process.sample(nodes, n, rng).reshape(n, len(y), len(x))
    raise InputError(_TILED.format("samples"))


def weighted_sum_of(process: Process, xy: FloatArray, weights: FloatArray) -> tuple[float, float]:
    """Return mean and standard deviation of the weighted sum of heights at places (M, 2)."""
    if isinstance(process, FourierGaussianProcess):
        return weighted_sum(process, xy, weights)
    if isinstance(process, DenseGaussianProcess):
        return process.weighted_sum(xy, weights)
    raise InputError(_TILED.format("sums"))


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
    along_x, along_y, diagonal = (_derivative_variance(process, x, y, np.array(e)) for e in _DIRECTIONS)
    variance = e_x**2 * along_x + e_y**2 * along_y + e_x * e_y * (diagonal - along_x - along_y)
    shape = (len(y), len(x))
    return steepness.reshape(shape), np.sqrt(np.maximum(variance, 0.0)).reshape(shape)


_DIRECTIONS = ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0))


def _derivative_variance(process: Process, x: FloatArray, y: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the variance (H * W,) of the derivative along a vector; a trend's own is left out."""
    if isinstance(process, FourierGaussianProcess):
        coefficients = process.posterior.variance_coefficients(direction)
        return process.resolution.box.evaluate_on_axes(x, y, coefficients).ravel()
    if isinstance(process, DenseGaussianProcess):
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        return process.derivative_variance(nodes, direction)
    raise InputError(_TILED.format("slopes"))

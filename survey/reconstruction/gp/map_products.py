"""More from one factorization: slopes, joint samples, and sums over the map with their standard deviations."""

import numpy as np

from survey.core.arrays import FloatArray, checked
from survey.core.errors import InputError
from survey.reconstruction.gp.engines.gaussian_process import FourierGaussianProcess
from survey.reconstruction.gp.engines.mean_solver import put_real_weights


def slope_on_axes(gp: FourierGaussianProcess, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    r"""Return the steepness of the mean and its standard deviation (H, W) [m/m] on the nodes of the axes x and y [m].

    The standard deviation is that of the derivative along the steepest direction:

    .. math::  \sigma^2 = e^T \operatorname{cov}(\nabla f) e, \qquad e = \nabla m / |\nabla m|

    Notes
    -----
    First order: on ground flatter than its own uncertainty, the steepness is biased upwards.  Relief of the
    discarded waves is not in it, so that a rough (Matérn) kernel's slope holds for the scales of the map only.
    """
    box = gp.resolution.box
    trend = gp.trend.gradient @ gp.trend_coefficients
    fields = [box.derivative(gp.mean_coefficients, axis) for axis in (0, 1)]
    g_x, g_y = (box.evaluate_on_axes(x, y, field) + t for field, t in zip(fields, trend, strict=True))
    steepness = np.hypot(g_x, g_y)
    e_x, e_y = (g / np.maximum(steepness, 1e-12) for g in (g_x, g_y))
    v_x, v_y, v_sum = (_derivative_variance(gp, x, y, np.array(e)) for e in ((1, 0), (0, 1), (1, 1)))
    variance = e_x**2 * v_x + e_y**2 * v_y + e_x * e_y * (v_sum - v_x - v_y)
    return steepness, np.sqrt(np.maximum(variance, 0.0))


def _derivative_variance(
    gp: FourierGaussianProcess, x: FloatArray, y: FloatArray, direction: FloatArray
) -> FloatArray:
    """Variance (H, W) of the terrain's derivative along a vector."""
    box = gp.resolution.box
    variance = box.evaluate_on_axes(x, y, gp.posterior.variance_coefficients(direction))
    if gp.trend.n_columns:
        constant = direction @ gp.trend.gradient
        fields = [
            direction[0] * box.derivative(field, 0) + direction[1] * box.derivative(field, 1)
            for field in gp.trend_fields
        ]
        explained = [box.evaluate_on_axes(x, y, field) for field in fields]
        variance += gp.trend_variance(constant - np.stack(explained, axis=-1))
    return variance


def sample_on_axes(
    gp: FourierGaussianProcess, x: FloatArray, y: FloatArray, n: int, rng: np.random.Generator
) -> FloatArray:
    """Joint samples (n, H, W) [m] of the terrain on the nodes of the axes x and y [m].

    Each is a draw from the prior, moved to the data by the answer to what it misses (Matheron's rule):
    ``f = f₀ + m(y - f₀(X) - ε)``.  It costs one solution for the mean, not a factorization.

    Notes
    -----
    Waves beyond those of the mean are not in the samples.
    """
    box, resolution = gp.resolution.box, gp.resolution
    noise = np.sqrt(gp.data.noise_m2 + resolution.mean_tail_m2)
    samples = np.empty((n, len(y), len(x)))
    for k in range(n):
        weights = rng.standard_normal(resolution.mean_basis.n_modes)
        spectrum = np.zeros(gp.system.amplitudes.shape, dtype=complex)
        prior = gp.system.coefficients(put_real_weights(spectrum, resolution.mean_basis.lattice, weights))
        drawn = box.evaluate(gp.data.xy, prior) + noise * rng.standard_normal(len(gp.data))
        missed = gp.for_values(gp.data.values - drawn)
        samples[k] = box.evaluate_on_axes(x, y, prior) + missed.mean_on_axes(x, y)
    return samples


def weighted_sum(gp: FourierGaussianProcess, xy: FloatArray, weights: FloatArray) -> tuple[float, float]:
    """Mean and standard deviation of ``Σ w_i f(x_i)``, such as the volume over a polygon.

    Parameters
    ----------
    gp : FourierGaussianProcess
        The terrain.
    xy : (M, 2) ndarray
        Quadrature nodes inside the polygon [m].
    weights : (M,) ndarray
        Area that each node stands for [m²].

    Returns
    -------
    mean, std : float
        Volume between the terrain and its prior mean, and its standard deviation [m³].

    Notes
    -----
    The errors of neighbouring nodes are correlated, and that is in it; relief of the discarded waves averages
    out over any area wider than a length scale, and is not.

    Examples
    --------
    >>> from survey.reconstruction.gp.covariance.kernels import SquaredExponential
    >>> xy = np.array([[5.0, 5.0], [2.0, 3.0], [8.0, 6.0]])
    >>> gp = FourierGaussianProcess.fit(xy, np.ones(3), np.full(3, 0.1), SquaredExponential(1.0, 50.0))
    >>> volume, std = weighted_sum(gp, xy, np.full(3, 10.0))
    >>> print(f"{volume:.1f} {std:.1f}")
    29.9 1.7
    """
    xy = checked(xy, (None, 2), "quadrature nodes")
    weights = checked(weights, (len(xy),), "quadrature weights")
    if len(xy) == 0:
        raise InputError("no quadrature node lies in the polygon; take a finer spacing than its width.")
    basis = gp.resolution.covariance_basis
    mean, _ = gp.predict(xy)
    transform = basis.box.transform(xy, weights, basis.half)
    features = basis.doubled(gp.posterior.amplitudes) * basis.weights_of(transform)
    variance = float(features @ gp.posterior.times(features))
    if gp.trend.n_columns:
        explained = np.stack([basis.box.evaluate(xy, field) for field in gp.trend_fields], axis=-1)
        gap = weights @ (gp.trend.columns(xy) - explained)
        variance += float(gap @ np.linalg.solve(gp.trend_precision, gap))
    return float(weights @ mean), float(np.sqrt(max(variance, 0.0)))

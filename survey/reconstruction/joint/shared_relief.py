r"""Relief too fine for a map's waves, which neighbouring points share although it counts as their noise.

A map keeps the strongest waves of a terrain. The relief of the others is noise to it, but not of
each point alone: points a metre apart lie on the same dune. Taken as independent, a hundred of
them would average it away, and slopes across a swath, which carry the map over the gaps, would
claim to be known far better than they are.
"""

from collections.abc import Callable

import numpy as np
from scipy import fft

from survey.core.arrays import FloatArray
from survey.reconstruction.gp.covariance.kernels import Kernel
from survey.reconstruction.gp.engines.fourier_basis import FourierBasis

# Cells per length scale, and how many there may be along a side: beyond that points of one cell count as one place.
_PER_LENGTH, _MOST_CELLS = 2.5, 1500.0
# Points at opposite edges must not meet around the back of the periodic grid.
_MARGIN_LENGTHS, _MARGIN_M = 20.0, 20.0


def with_shared_relief(
    xy: FloatArray,
    noise_m2: FloatArray,
    kernel: Kernel,
    basis: FourierBasis,
    tail_m2: float,
    *,
    retained: Callable[[FloatArray], FloatArray] | None = None,
) -> FloatArray:
    r"""Return noise variances (N,) [m²] of points that amount to their own noise and the relief between them.

    With own variances d and the covariance t of the relief that the waves leave out, n points
    of one place determine it with the variance ``1 / Σ 1/d + t``. Independent variances

    .. math::  D_i = d_i \left( 1 + \sum_j t(x_i - x_j) / d_j \right)

    give the same, and the same weights among them; points apart from each other keep ``d + t(0)``,
    which is the least anywhere. The sum is a convolution on a grid.

    Parameters
    ----------
    xy : (N, 2) ndarray
        Places [m].
    noise_m2 : (N,) ndarray
        The points' own variances, positive [m²].
    kernel : Kernel
        Of the terrain.
    basis : FourierBasis
        The retained waves: those of a spectral density above some limit.
    tail_m2 : float
        Variance of the others [m²], and of what the retained waves leave out.
    retained : callable, optional
        Returns the share of the variance of waves of angular frequencies (..., 2) [rad/m] that the map has; all by
        default.

    Examples
    --------
    >>> from survey.reconstruction.gp.engines.fourier_basis import FourierBox
    >>> from survey.reconstruction.gp.covariance.kernels import SquaredExponential
    >>> box = FourierBox.around((0.0, 0.0, 100.0, 100.0), 20.0)
    >>> none = FourierBasis.of(box, np.zeros((1, 2), dtype=np.int64))
    >>> relief = SquaredExponential(0.01, 3.0)
    >>> xy = np.array([[20.0, 50.0], [20.0, 50.0], [80.0, 50.0]])
    >>> with_shared_relief(xy, np.full(3, 0.04), relief, none, 0.01).round(3)
    array([0.06, 0.06, 0.05])
    """
    length_m, extent_m = kernel.length_scales_m[0], np.ptp(xy, axis=0)
    step_m = max(length_m / _PER_LENGTH, float(extent_m.max()) / _MOST_CELLS)
    margin_m = _MARGIN_LENGTHS * length_m + _MARGIN_M
    shape = [fft.next_fast_len(int(side / step_m) + 1, real=True) for side in (extent_m + margin_m).tolist()]
    spectrum = _spectrum_left_out(kernel, basis, shape, step_m, retained)
    variance_m2 = float(fft.irfft2(spectrum, shape)[0, 0])
    if variance_m2 <= 0.0:  # waves shorter than the grid's cells: no two points share them
        return noise_m2 + tail_m2
    spectrum *= tail_m2 / variance_m2
    cell = np.rint((xy - xy.min(axis=0)) / step_m).astype(np.int64)
    weight = np.zeros(shape)
    np.add.at(weight, (cell[:, 0], cell[:, 1]), 1.0 / noise_m2)
    shared = fft.irfft2(fft.rfft2(weight) * spectrum, shape)[cell[:, 0], cell[:, 1]]
    result: FloatArray = noise_m2 + np.maximum(noise_m2 * shared, tail_m2)
    return result


def _spectrum_left_out(
    kernel: Kernel,
    basis: FourierBasis,
    shape: list[int],
    step_m: float,
    retained: Callable[[FloatArray], FloatArray] | None,
) -> FloatArray:
    """Return the spectral density of relief that the waves leave out, as `scipy.fft.rfft2` orders it."""
    along_x = 2.0 * np.pi * fft.fftfreq(shape[0], step_m)
    along_y = 2.0 * np.pi * fft.rfftfreq(shape[1], step_m)
    omega = np.stack(np.meshgrid(along_x, along_y, indexing="ij"), axis=-1)
    density = kernel.spectral_density(omega)
    weakest = float(kernel.spectral_density(basis.omega).min())
    rest = 0.0 if retained is None else density * (1.0 - retained(omega))
    return np.where(density < weakest * (1.0 - 1e-9), density, rest)

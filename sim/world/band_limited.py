"""Band-limited Gaussian random fields, by the inverse Fourier transform of random spectra."""

import numpy as np
from scipy import fft

from sim.world.hazards import FloatGrid


def band_limited_field(
    shape: tuple[int, int],
    step_m: float,
    wavelengths_m: tuple[float, float],
    decay: float,
    rng: np.random.Generator,
    *,
    stretch: float = 1.0,
    angle: float = 0.0,
    periodic: bool = False,
) -> FloatGrid:
    """Draw a Gaussian random field of unit variance with wavelengths within bounds.

    Parameters
    ----------
    shape : (2,) tuple of int
        Rows and columns wanted.
    step_m : float
        Distance between nodes [m].
    wavelengths_m : (2,) tuple of float
        Shortest and longest wavelength, across the forms [m].
    decay : float
        The amplitude of waves falls with frequency to this power.
    rng : numpy.random.Generator
        Source of the draws.
    stretch, angle : float
        Forms are `stretch` times longer in the direction `angle` (from the columns' axis
        towards the rows') [rad].
    periodic : bool
        Whether opposite edges match, for tiles.

    Returns
    -------
    ndarray of float32
        The field, of the given shape.
    """
    pad = 0 if periodic else int(np.ceil(min(wavelengths_m[1], 40.0) / step_m))
    rows, columns = (n if periodic else fft.next_fast_len(n + pad, real=True) for n in shape)
    x = fft.rfftfreq(columns, step_m).astype(np.float32)[None, :]
    y = fft.fftfreq(rows, step_m).astype(np.float32)[:, None]
    cos, sin = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    squared = (np.float32(stretch) * (cos * x + sin * y)) ** 2 + (cos * y - sin * x) ** 2
    band = (squared > wavelengths_m[1] ** -2) & (squared < wavelengths_m[0] ** -2)
    amplitude = np.zeros_like(squared)
    amplitude[band] = squared[band] ** np.float32(-0.5 * decay)
    spectrum = np.zeros(squared.shape, np.complex64)
    draws = rng.standard_normal((2, int(band.sum())), np.float32)
    spectrum[band] = amplitude[band] * (draws[0] + 1j * draws[1])
    field = fft.irfft2(spectrum, s=(rows, columns), overwrite_x=True)[: shape[0], : shape[1]]
    return np.ascontiguousarray(field / field.std(), dtype=np.float32)
